"""How far a range finder sees, where its messages do not say it or say something that cannot be."""

FARTHEST_M = 250.0
"""No scanner of a robot's plane sees farther: a beam that ends beyond met nothing, whatever the messages say."""


def usable_m(range_max_m: float, asked_m: float = 0.0) -> float:
    """The range (m) from which on a beam met nothing: as asked (> 0), else that of the messages, never beyond `FARTHEST_M`."""
    if asked_m > 0.0:
        return asked_m
    return min(range_max_m, FARTHEST_M) if range_max_m > 0.0 else FARTHEST_M
