"""JSON messages -> events: the schemas `pfcli.*`, for logs without ROS."""

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from pfcli.errors import reason
from pfcli.events import (
    EVENLY,
    Event,
    Heading,
    Landmarks,
    LinePoints,
    Odometry,
    Pose2,
    Range,
    Scan,
    Steering,
    Ticks,
    Truth,
    Twist,
)


def stamp_of(payload: bytes) -> int:
    """Stamp of a JSON message (ns)."""
    try:
        stamp = json.loads(payload)["stamp_ns"]
    except (KeyError, TypeError, UnicodeDecodeError, RecursionError):
        raise ValueError("has no field 'stamp_ns'") from None
    if isinstance(stamp, bool) or not isinstance(stamp, int) or not 0 <= stamp < 1 << 63:
        raise ValueError("field 'stamp_ns' is not a whole number of nanoseconds")
    return stamp


def _floats(values: Any) -> Any:
    return np.array([math.nan if v is None else v for v in values], np.float64)


def _lines(m: Any, t: int) -> tuple[LinePoints, str]:
    name = "points_px" if "points_px" in m else "points_m"
    points = np.array(m[name], float)
    if points.size and (points.ndim != 2 or points.shape[1] != 2):
        raise ValueError(f"field {name!r} does not hold pairs")
    return LinePoints(t, points.reshape(-1, 2), name == "points_px"), str(m.get("frame_id", ""))


def _landmarks(m: Any, t: int) -> tuple[Landmarks, str]:
    rows = m["landmarks"]
    sigma = [[r.get("sigma_range_m", math.nan), r.get("sigma_bearing_rad", math.nan)] for r in rows]
    ids = tuple(str(r.get("id", "")) for r in rows)
    ranges, bearings = _floats([r["range_m"] for r in rows]), _floats([r["bearing_rad"] for r in rows])
    return Landmarks(t, ids, ranges, bearings, np.array(sigma, float).reshape(-1, 2)), str(m.get("frame_id", ""))


def _scan(m: Any, t: int) -> tuple[Scan, str]:
    ranges = np.array([math.inf if v is None else v for v in m["ranges_m"]], np.float32)
    low, step = float(m["angle_min_rad"]), float(m["angle_increment_rad"])
    limits = float(m.get("range_min_m", 0.0)), float(m.get("range_max_m", math.inf))
    between, period = float(m.get("time_increment_s", 0.0)), float(m.get("scan_time_s", 0.0))
    return Scan(t, ranges, low, step, *limits, Pose2(), EVENLY, between, period), str(m.get("frame_id", ""))


def _range(m: Any, t: int) -> tuple[Range, str]:
    value = math.inf if m["range_m"] is None else float(m["range_m"])
    limits = float(m.get("range_min_m", 0.0)), float(m.get("range_max_m", math.inf))
    return Range(t, "", value, *limits, Pose2()), str(m.get("frame_id", ""))


def _odometry(m: Any, t: int) -> tuple[Odometry, str]:
    twist = [float(m.get(k, math.nan)) for k in ("vx_mps", "vy_mps", "yaw_rate_radps")]
    return Odometry(t, float(m["x_m"]), float(m["y_m"]), float(m["yaw_rad"]), *twist), ""


def _ticks(m: Any, t: int) -> tuple[Ticks, str]:
    names, ticks = tuple(m["names"]), np.array(m["ticks"], np.int64)
    if len(names) != ticks.size:
        raise ValueError("fields 'names' and 'ticks' differ in length")
    if not float(m["ticks_per_turn"]) > 0.0:
        raise ValueError("field 'ticks_per_turn' is not positive")
    return Ticks(t, names, ticks, float(m["ticks_per_turn"]), bool(m.get("cumulative", True))), ""


def heading(yaw_rad: float, sigma_rad: float, t: int) -> Heading:
    """A reading of a compass; NaN for a spread that is none. Raises ValueError."""
    if not math.isfinite(yaw_rad):
        raise ValueError("field 'yaw_rad' is not a number")
    return Heading(t, yaw_rad, sigma_rad if sigma_rad > 0 else math.nan)


_KINDS: dict[str, Callable[[Any, int], tuple[Any, str]]] = {
    "pfcli.Odometry": _odometry,
    "pfcli.Twist": lambda m, t: (
        Twist(t, float(m["vx_mps"]), float(m.get("vy_mps", 0.0)), float(m["yaw_rate_radps"])),
        "",
    ),
    "pfcli.Ackermann": lambda m, t: (Steering(t, float(m["speed_mps"]), float(m["steering_angle_rad"])), ""),
    "pfcli.WheelEncoders": _ticks,
    "pfcli.Heading": lambda m, t: (heading(float(m["yaw_rad"]), float(m.get("sigma_rad", math.nan)), t), ""),
    "pfcli.Range": _range,
    "pfcli.LaserScan": _scan,
    "pfcli.LinePoints": _lines,
    "pfcli.Landmarks": _landmarks,
    "pfcli.Pose2D": lambda m, t: (Truth(t, float(m["x_m"]), float(m["y_m"]), float(m["yaw_rad"])), ""),
}


def decoder(schema: str) -> Callable[[Any, int, int, int], tuple[Event, str]]:
    """What reads messages of the type `schema`: (buffer, offset, length, stamp_ns) -> the event and its frame."""
    convert = _KINDS[schema]

    def decode(buffer: Any, offset: int, length: int, stamp_ns: int) -> tuple[Event, str]:
        try:
            message = json.loads(bytes(buffer[offset : offset + length]))
            return convert(message, stamp_ns)
        except KeyError as error:
            raise ValueError(f"has no field {error.args[0]!r}") from None
        except (TypeError, AttributeError, OverflowError, UnicodeDecodeError, RecursionError) as error:
            raise ValueError(f"does not follow its schema ({reason(error)})") from None

    return decode
