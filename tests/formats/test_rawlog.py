"""MRPT's logs: values against an independent reading by hand."""

import gzip
import math
import struct
from pathlib import Path

import numpy as np
import pytest

from pfcli.errors import LogError
from pfcli.events import Landmarks, Odometry, Scan
from pfcli.replay.log import Log
from tests.conftest import needs

_EPOCH = 116_444_736_000_000_000


def _object(name: str, version: int, body: bytes) -> bytes:
    return bytes([0x80 + len(name)]) + name.encode() + bytes([version]) + body + b"\x88"


def _move(x: float, y: float, yaw: float) -> bytes:
    pose = _object("CPose2D", 1, struct.pack("<3d", x, y, yaw))
    action = _object("CActionRobotMovement2D", 6, struct.pack("<I", 0) + pose + bytes(78))
    return _object("CActionCollection", 0, struct.pack("<I", 1) + action)


def _scan(stamp_s: float, ranges: list[float], valid: list[int], mount: tuple[float, float, float]) -> bytes:
    x, y, yaw = mount
    turn = (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))
    pose = _object("mrpt::poses::CPose3D", 2, struct.pack("<7d", x, y, 0.3, *turn))
    body = struct.pack("<f?f", math.pi, True, 80.0) + pose + struct.pack("<I", len(ranges))
    body += np.array(ranges, np.float32).tobytes() + bytes(valid)
    body += struct.pack("<fQ", 0.01, _EPOCH + round(stamp_s * 1e7)) + bytes(16)
    scan = _object("mrpt::obs::CObservation2DRangeScan", 6, body)
    return _object("mrpt::obs::CSensoryFrame", 2, struct.pack("<I", 1) + scan)


@pytest.mark.parametrize("packed", [True, False])
def test_increments_and_scans(packed: bool, tmp_path: Path) -> None:
    data = b"".join(
        _move(1.0, 0.0, math.pi / 2) + _scan(100.0 + k, [1.0, 2.0, 80.0], [1, 1, 0], (0.5, 0.1, 0.2)) for k in range(4)
    )
    path = tmp_path / "x.rawlog"
    path.write_bytes(gzip.compress(data) if packed else data)
    events = list(Log(path).events(["odometry", "scan"]))
    odometry = [e for e in events if isinstance(e, Odometry)]
    scans = [e for e in events if isinstance(e, Scan)]
    assert [e.stamp_ns for e in scans] == [100 * 10**9 + k * 10**9 for k in range(4)]
    ways = [(1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0)]
    assert np.allclose([o[1:3] for o in odometry], ways, atol=1e-12)
    assert scans[0].ranges_m.tolist() == [1.0, 2.0, math.inf]
    assert scans[0].mount == pytest.approx((0.5, 0.1, 0.2), abs=1e-6)
    assert (scans[0].angle_min_rad, scans[0].range_max_m) == (pytest.approx(-math.pi / 2), 80.0)


def test_other_classes_are_named(tmp_path: Path) -> None:
    image = _object("mrpt::obs::CObservationImage", 4, bytes(40))
    path = tmp_path / "x.rawlog"
    path.write_bytes(image * 3 + _move(1, 0, 0) + _scan(5.0, [1.0, 1.0], [1, 1], (0, 0, 0)))
    log = Log(path)
    assert len(list(log.events(["scan"]))) == 1
    assert "3 objects of the class CObservationImage (version 4) cannot be read" in log.dropped.notes[0]
    path.write_bytes(image)
    with pytest.raises(LogError, match=r"no laser scan and no landmark .* 1 x CObservationImage"):
        Log(path)
    path.write_bytes(_object("mrpt::maps::CSimpleMap", 1, bytes(40)))
    with pytest.raises(LogError, match="holds a CSimpleMap of MRPT, which is no log"):
        Log(path)
    path.write_bytes(b"\x1f\x8b" + bytes(20))
    with pytest.raises(LogError, match="cannot be read"):
        Log(path)


@pytest.mark.real
def test_recorded_logs() -> None:
    """By hand with struct: offsets of the first objects of both files."""
    folder = needs("field/localization_demo.rawlog", "field/kf-slam_demo.rawlog") / "field"
    events = list(Log(folder / "localization_demo.rawlog").events(["odometry", "scan"]))
    scans = [e for e in events if isinstance(e, Scan)]
    data = gzip.decompress((folder / "localization_demo.rawlog").read_bytes())
    assert len(scans) == data.count(b"\x97CObservation2DRangeScan") == 37
    at = 231 + 56 + 1
    assert struct.unpack_from("<I", data, at) == (361,)
    assert scans[0].ranges_m[:4].tolist() == list(struct.unpack_from("<4f", data, at + 4))
    assert scans[0].stamp_ns == (struct.unpack_from("<Q", data, at + 8 + 5 * 361)[0] - _EPOCH) * 100
    assert scans[0].stamp_ns * 1e-9 == pytest.approx(1137772793.0948524, abs=1e-6)
    assert scans[0].mount == pytest.approx((0.78, 0.0, 0.0), abs=1e-6)
    first = next(e for e in events if isinstance(e, Odometry))
    assert first[1:4] == pytest.approx((0.2477942705154419, 0.018788695335388184, 0.14207422733306885))
    seen = [e for e in Log(folder / "kf-slam_demo.rawlog").events(["landmarks"]) if isinstance(e, Landmarks)]
    assert len(seen) == 250
    assert (len(seen[0].ids), seen[0].ids[:2]) == (27, ("7", "17"))
    assert seen[0].range_m[0] == pytest.approx(3.3538661003112793, abs=1e-5)
    assert seen[0].bearing_rad[0] == pytest.approx(1.1097822189331055, abs=1e-5)
    assert seen[0].sigma[0].tolist() == pytest.approx([0.01, 0.001745329], abs=1e-5)
    assert [e.stamp_ns for e in seen[:3]] == [0, 10**9, 2 * 10**9]
