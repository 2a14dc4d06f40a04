"""Several scanners of one robot, as one that sees what all of them see."""

from collections.abc import Iterable, Iterator

import numpy as np

from pfcli.core.grid.deskew import deskewed
from pfcli.dropped import Dropped
from pfcli.events import Pose2, Scan, Sighting, Sounding, Sweep

_CENTRE = (0.0, 0.0)


def together(
    sweeps: Iterable[Sweep | Sounding | Sighting], scanners: int, dropped: Dropped
) -> Iterator[Sweep | Sounding | Sighting]:
    """Scans of one scanner pass as they are. Of several a round ends when all have reported, or when one reports again; it is
    one scan, seen from the base at the stamp of its last one."""
    now: dict[str, Sweep] = {}
    for sweep in sweeps:
        if not isinstance(sweep, Sweep) or scanners < 2:
            yield sweep
            continue
        if sweep.scan.topic in now:
            yield _round(now, dropped)
            now = {}
        now[sweep.scan.topic] = sweep
        if len(now) == scanners:
            yield _round(now, dropped)
            now = {}
    if now:
        yield _round(now, dropped)


def _round(found: dict[str, Sweep], dropped: Dropped) -> Sweep:
    """One scan of the scans of a round, by the odometry between them."""
    last = max(found.values(), key=lambda sweep: sweep.stamp_ns)
    parts = [_seen_from(last, found[topic]) for topic in sorted(found)]
    ranges, bearings = (np.concatenate(values) for values in zip(*parts, strict=True))
    order = np.argsort(bearings, kind="stable")
    dropped.read["rounds of several scanners"] += 1
    scan = Scan(
        stamp_ns=last.stamp_ns,
        ranges_m=ranges[order],
        angle_min_rad=float(bearings[order[0]]),
        angle_increment_rad=min(abs(s.scan.angle_increment_rad) for s in found.values()),
        range_min_m=0.0,
        range_max_m=max(s.scan.range_max_m for s in found.values()),
        mount=Pose2(),
        bearings_rad=bearings[order],
    )
    return last._replace(scan=scan)


def _seen_from(last: Sweep, sweep: Sweep) -> tuple[np.ndarray, np.ndarray]:
    """Ranges and directions of a scan, from the base at the last one."""
    scan, reference = sweep.scan, np.array(last.odometry)
    poses = np.tile(np.array(sweep.odometry), (scan.ranges_m.size, 1))
    mount, reach = (scan.mount.x_m, scan.mount.y_m), (scan.range_min_m, scan.range_max_m)
    ranges, bearings = deskewed(scan.ranges_m, scan.directions_rad(), (mount, _CENTRE), reach, poses, reference)
    return ranges, np.arctan2(np.sin(bearings), np.cos(bearings))
