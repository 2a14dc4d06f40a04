"""Sample logs with one ordinary mistake in them: units, signs, mounts, stamps, clocks, counters, freezes, resets, drops."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pfcli.events import Event, Heading, Landmarks, LinePoints, Odometry, Range, Scan, Ticks, Truth, Twist
from pfcli.formats.log_writer import LogWriter
from pfcli.replay.log import Log

SECOND = 1_000_000_000
Change = Callable[[Any, float], "Event | None"]
"""An event and the seconds since the start -> the event as the mistaken log has it; None: it is not there."""


class Mutation(NamedTuple):
    """kind: the events that change; change: see `Change`; code: of the finding that `check` should have, '' where a log
    cannot tell."""

    name: str
    kind: type
    change: Change
    code: str = ""


class _Recorder(LogWriter):
    """Records every message when it really was there, whatever it says of itself."""

    log_ns = 0

    def raw(self, topic: str, schema: str, stamp_ns: int, payload: bytes, definition: str | None = None) -> None:
        super().raw(topic, schema, self.log_ns, payload, definition)


ROLES = ("odometry", "encoders", "twist", "compass", "scan", "range", "lines", "landmarks", "truth")


def write(source: Path, target: Path, *mutations: Mutation) -> Path:
    """Write `source` again with its mistakes."""
    log = Log(source)
    roles = [role for role in ROLES if log.roles().get(role)]
    mounts: set[str] = set()
    began: int | None = None
    with _Recorder(target) as out:
        for event in log.events(roles):
            began = event.stamp_ns if began is None else began
            out.log_ns = event.stamp_ns
            found: Any = event
            for m in mutations:
                if isinstance(found, m.kind):
                    found = m.change(found, (event.stamp_ns - began) * 1e-9)
            if found is not None:
                _put(out, found, mounts)
    return target


def _put(out: _Recorder, event: Any, mounts: set[str]) -> None:
    name = event.topic.rpartition("/")[2] if isinstance(event, Range) else ""
    frame = "laser" if isinstance(event, Scan) else f"range_{name}" if name else ""
    if frame and frame not in mounts:
        mounts.add(frame)
        out.tf_static(event.stamp_ns, [("base_link", frame, event.mount)])
    if isinstance(event, Range):
        out.range_finder(event.stamp_ns, event.range_m, (event.range_min_m, event.range_max_m), name)
    else:
        out.event(event)


def later(seconds: float) -> Change:
    return lambda e, t: e._replace(stamp_ns=e.stamp_ns + int(seconds * SECOND))


def _freeze(begin: float, end: float, *names: str) -> Change:
    kept: dict[str, Any] = {}

    def change(event: Any, t: float) -> Any:
        if not begin <= t < end:
            kept.clear()
            return event
        if not kept:
            kept.update({name: getattr(event, name) for name in names})
        return event._replace(**kept)

    return change


def _reset(at: float) -> Change:
    zero: list[Any] = []

    def change(event: Any, t: float) -> Any:
        if t < at:
            return event
        if not zero:
            zero.append(event)
        z = zero[0]
        dx, dy, c, s = event.x_m - z.x_m, event.y_m - z.y_m, math.cos(z.yaw_rad), math.sin(z.yaw_rad)
        return event._replace(x_m=c * dx + s * dy, y_m=-s * dx + c * dy, yaw_rad=event.yaw_rad - z.yaw_rad)

    return change


def _turned(yaw: float) -> Change:
    return lambda e, t: e._replace(angle_min_rad=e.angle_min_rad + yaw)


def _ranges(factor: float, limits: bool = True) -> Change:
    def change(e: Any, t: float) -> Any:
        k = factor if limits else 1.0
        return e._replace(
            ranges_m=e.ranges_m * np.float32(factor), range_min_m=e.range_min_m * k, range_max_m=e.range_max_m * k
        )

    return change


def _wheel(k: int, change: Callable[[int], int]) -> Change:
    def apply(e: Any, t: float) -> Any:
        ticks = e.ticks.copy()
        ticks[k] = change(int(ticks[k]))
        return e._replace(ticks=ticks)

    return apply


def _scaled(factor: float) -> Change:
    return lambda e, t: e._replace(x_m=e.x_m * factor, y_m=e.y_m * factor)


_NEAR = {"stamp_ns": 0}

STAMPS = (
    Mutation("scan-stamps-equal", Scan, lambda e, t: e._replace(stamp_ns=10 * SECOND), "W101"),
    Mutation("scan-whole-seconds", Scan, lambda e, t: e._replace(stamp_ns=e.stamp_ns // SECOND * SECOND), "W102"),
    Mutation("all-whole-seconds", object, lambda e, t: e._replace(stamp_ns=e.stamp_ns // SECOND * SECOND), "W102"),
    Mutation("all-microseconds", object, lambda e, t: e._replace(stamp_ns=e.stamp_ns // 1000), "W103"),
    Mutation("scan-3600-s-late", Scan, later(3600.0), "W104"),
    Mutation("scan-0.3-s-late", Scan, later(0.3), "W107"),
    Mutation("scan-0.3-s-early", Scan, later(-0.3), "W107"),
    Mutation("scan-1-s-late", Scan, later(1.0), "W104"),
    Mutation("restart", object, lambda e, t: e._replace(stamp_ns=e.stamp_ns - int(25 * SECOND) * (t > 30)), "W105"),
)
SCANS = (
    Mutation("scan-mm", Scan, _ranges(1000.0), "W301"),
    Mutation("scan-cm", Scan, _ranges(100.0), "W301"),
    Mutation("scan-mm-limits-m", Scan, _ranges(1000.0, limits=False)),
    Mutation("scan-mirrored", Scan, lambda e, t: e._replace(ranges_m=e.ranges_m[::-1].copy()), "W304"),
    Mutation("laser-turned-180", Scan, _turned(math.pi), "W305"),
    Mutation("laser-turned-90", Scan, _turned(math.pi / 2), "W305"),
    Mutation("laser-turned-20", Scan, _turned(math.radians(20)), "W305"),
    Mutation("scans-repeat", Scan, _freeze(10.0, 40.0, "ranges_m"), "W307"),
    Mutation("scans-missing", Scan, lambda e, t: None if 12.0 < t < 24.0 else e, "W106"),
    Mutation("range-max-zero", Scan, lambda e, t: e._replace(range_max_m=0.0), "W303"),
)
ODOMETRY = (
    Mutation("odometry-degrees", Odometry, lambda e, t: e._replace(yaw_rad=math.degrees(e.yaw_rad)), "W204"),
    Mutation("odometry-yaw-sign", Odometry, lambda e, t: e._replace(yaw_rad=-e.yaw_rad), "W204"),
    Mutation("odometry-mirrored", Odometry, lambda e, t: e._replace(y_m=-e.y_m, yaw_rad=-e.yaw_rad), "W304"),
    Mutation("odometry-mm", Odometry, _scaled(1000.0), "W205"),
    Mutation("odometry-cm", Odometry, _scaled(100.0), "W205"),
    Mutation("odometry-twice", Odometry, _scaled(2.0), "W205"),
    Mutation(
        "odometry-freezes", Odometry, _freeze(15.0, 40.0, "x_m", "y_m", "yaw_rad", "vx_mps", "yaw_rate_radps"), "W209"
    ),
    Mutation("odometry-pose-zero", Odometry, lambda e, t: e._replace(x_m=0.0, y_m=0.0, yaw_rad=0.0), "W209"),
    Mutation("odometry-yaw-zero", Odometry, lambda e, t: e._replace(yaw_rad=0.0), "W204"),
    Mutation("odometry-reset", Odometry, _reset(28.0), "W203"),
    Mutation("odometry-missing", Odometry, lambda e, t: None if 12.0 < t < 24.0 else e),
)
TICKS = (
    Mutation("ticks-left-sign", Ticks, _wheel(0, lambda n: -n)),
    Mutation("ticks-swapped", Ticks, lambda e, t: e._replace(ticks=e.ticks[::-1].copy())),
    Mutation("ticks-per-turn", Ticks, lambda e, t: e._replace(ticks_per_turn=e.ticks_per_turn * 4)),
    Mutation("ticks-left-frozen", Ticks, _wheel(0, lambda n: 0)),
    Mutation("ticks-16-bit", Ticks, lambda e, t: e._replace(ticks=(e.ticks + 32768) % 65536 - 32768)),
    Mutation("ticks-both-signs", Ticks, lambda e, t: e._replace(ticks=-e.ticks)),
    Mutation("ticks-late", Ticks, later(0.3)),
    Mutation("ticks-missing", Ticks, lambda e, t: None if 12.0 < t < 24.0 else e),
)
SOCCER = (
    Mutation("compass-degrees", Heading, lambda e, t: e._replace(yaw_rad=math.degrees(e.yaw_rad))),
    Mutation("compass-clockwise", Heading, lambda e, t: e._replace(yaw_rad=-e.yaw_rad)),
    Mutation("compass-frozen", Heading, lambda e, t: e._replace(yaw_rad=0.3)),
    Mutation("lines-mm", LinePoints, lambda e, t: e._replace(points_m=e.points_m * 1000), "W402"),
    Mutation("lines-y-right", LinePoints, lambda e, t: e._replace(points_m=e.points_m * np.array([1.0, -1.0]))),
    Mutation("lines-half", LinePoints, lambda e, t: e._replace(points_m=e.points_m * 0.6)),
    Mutation("all-whole-seconds", object, lambda e, t: e._replace(stamp_ns=e.stamp_ns // SECOND * SECOND), "W102"),
    Mutation("wheels-mirrored", Ticks, lambda e, t: e._replace(ticks=-e.ticks)),
)
LANDMARKS = (
    Mutation("bearing-sign", Landmarks, lambda e, t: e._replace(bearing_rad=-e.bearing_rad)),
    Mutation("bearing-degrees", Landmarks, lambda e, t: e._replace(bearing_rad=np.degrees(e.bearing_rad))),
    Mutation("range-cm", Landmarks, lambda e, t: e._replace(range_m=e.range_m * 100)),
    Mutation("landmarks-late", Landmarks, later(0.5)),
    Mutation("ids-shuffled", Landmarks, lambda e, t: e._replace(ids=e.ids[::-1])),
    Mutation("odometry-yaw-sign", Odometry, lambda e, t: e._replace(yaw_rad=-e.yaw_rad)),
    Mutation("twist-turns-right", Twist, lambda e, t: e._replace(yaw_rate_radps=-e.yaw_rate_radps)),
)


class Setting(NamedTuple):
    """A sample and how it is run."""

    sample: str
    words: tuple[str, ...]
    mutations: tuple[Mutation, ...]


def settings(samples: Path) -> tuple[Setting, ...]:
    """All runs of the table: six systems, each with the mistakes that its log can have."""
    drive = ("--wheel-radius-m", "0.1", "--track-width-m", "0.33")
    maps = {name: ("--map", str(samples / f"{name}.yaml")) for name in ("four-rooms", "kidnapped", "partial-partial")}
    return (
        Setting("small-loop", ("slam-gdr",), STAMPS + SCANS + ODOMETRY),
        Setting("no-ros", ("slam-gdr", "--motion", "encoders", *drive), TICKS),
        Setting("kidnapped", ("localize-reliable", *maps["kidnapped"]), STAMPS[4:7] + SCANS[3:6] + ODOMETRY[:4]),
        Setting("partial", ("localize-partial", *maps["partial-partial"]), STAMPS[5:6] + SCANS[3:6] + ODOMETRY[:3]),
        Setting("four-rooms", ("localize-lookup", *maps["four-rooms"], *drive), SCANS[:6] + TICKS),
        Setting("soccer", ("fuse-soccer", "--drive", str(samples / "soccer.toml")), SOCCER),
        Setting("landmarks", ("slam-gdr", "--landmarks"), LANDMARKS),
    )


__all__ = ["Mutation", "Setting", "Truth", "settings", "write"]
