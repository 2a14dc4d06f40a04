"""A track against true poses, wherever they are kept: what `pfcli evaluate --truth` and `pfcli.evaluate` say."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.evaluation import track_error
from pfcli.errors import LogError, reason
from pfcli.formats import reference_track
from pfcli.replay.log import Log

_HEAD = 4096


class Poses(NamedTuple):
    """Stamps (n,) ns and poses (n, 3) m, rad, of a track or of its truth; name: for messages."""

    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]
    name: str


class Rule(NamedTuple):
    """How a track is compared. align: moved onto its truth first (SE(2), least squares); max_gap_ns: stamps so far apart are
    still one; delta: RPE over so many poses."""

    align: bool = True
    max_gap_ns: int = 20_000_000
    delta: int = 1


def truth_of(path: Path) -> Poses:
    """True poses of a recording with a truth topic, or of a file (TUM, EuRoC, KITTI, CSV). Raises LogError: there are none."""
    if _is_text(path):
        stamps, poses = reference_track.read(path)
        return Poses(stamps, poses, str(path))
    events: list[Any] = list(Log(path).events(["truth"]))
    if not events:
        raise LogError(f"--truth {path}: holds no truth topic")
    return Poses(np.array([e.stamp_ns for e in events]), np.array([e[1:4] for e in events]), str(path))


def judged(track: Poses, truth: Poses, rule: Rule) -> tuple[dict[str, Any], NDArray[np.float64]]:
    """Figures of a track (ATE and RPE, m and deg), and the pose (3,) that moves it onto its truth.

    Raises LogError where too few poses have a partner.
    """
    mine, theirs = track_error.associate(track.stamps_ns, truth.stamps_ns, rule.max_gap_ns)
    a, b = track.poses[mine], truth.poses[theirs]
    if mine.size <= rule.delta:
        raise LogError(f"--truth {truth.name}: only {mine.size} poses have a partner; see --max-gap")
    moved = track_error.align_se2(a, b) if rule.align else np.zeros(3)
    summary = track_error.errors_of(a, b, moved).summary() | _relative(a, b, rule.delta) | {"aligned": rule.align}
    return summary, moved


def _relative(track: NDArray[np.float64], truth: NDArray[np.float64], delta: int) -> dict[str, float | None]:
    """RPE (m, deg); None where truth has no headings: a step is seen from a pose."""
    if not np.isfinite(truth[:, 2]).all():
        return {"rpe_m": None, "rpe_deg": None}
    step_t, step_r = track_error.relative_errors(track, truth, delta)
    found = float(np.sqrt((step_t**2).mean())), float(np.degrees(np.sqrt((step_r**2).mean())))
    return {"rpe_m": round(found[0], 6), "rpe_deg": round(found[1], 6)}


def _is_text(path: Path) -> bool:
    """Whether a file is text, as TUM is; every recording with poses is binary, whatever its name."""
    if path.is_dir():
        return False
    try:
        with open(path, "rb") as file:
            return b"\0" not in file.read(_HEAD)
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({reason(error)})") from None
