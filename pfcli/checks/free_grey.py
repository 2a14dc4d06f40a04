"""W501: grey 205 of a map counts as free."""

from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding
from pfcli.formats import map_yaml

_SHARE = 0.005


def check(evidence: Evidence) -> Finding | None:
    """map_saver draws unknown cells in grey 205, which is free where free_thresh is above 0.196, as it wrote itself for years."""
    if evidence.map_file is None:
        return None
    share, free = map_yaml.free_unknown(evidence.map_file)
    if share < _SHARE:
        return None
    return Finding(
        code="W501",
        severity="doubt",
        where=str(evidence.map_file),
        seen=f"{100 * share:.0f} % of its pixels are grey 205, which free_thresh {free:g} makes free",
        effect="what nobody has seen is free, and the map has no frontier",
        way_out="--unknown-grey 205 keeps them unknown",
    )
