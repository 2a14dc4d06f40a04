"""What a replay had to leave out."""

from collections import Counter


class Dropped:
    """What a replay had to leave out: counts by reason, and the sentences that say where."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.notes: list[str] = []
        self.read: Counter[str] = Counter()

    def add(self, why: str, note: str, keep: int = 1) -> None:
        """Count one dropped; the first notes of a kind are kept."""
        self.counts[why] += 1
        if self.counts[why] <= keep:
            self.notes.append(note)

    def __bool__(self) -> bool:
        return bool(self.counts)

    def take(self, other: "Dropped") -> None:
        """Add what another replay lost."""
        self.counts.update(other.counts)
        self.read.update(other.read)
        self.notes.extend(other.notes)
