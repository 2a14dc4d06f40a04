"""Seeds of every target: one small good input of each kind, made here."""

import json
import struct
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from fuzz.targets import CDR, JSON
from pfcli.formats.log_writer import LogWriter
from pfcli.formats.message_writer import header
from pfcli.formats.schemas import typestore

_T0 = 1_700_000_000_000_000_000

MESSAGES: dict[str, dict[str, Any]] = {
    "pfcli.Odometry": {"x_m": 1.0, "y_m": 2.0, "yaw_rad": 0.5},
    "pfcli.Twist": {"vx_mps": 1.0, "yaw_rate_radps": 0.1},
    "pfcli.Ackermann": {"speed_mps": 1.0, "steering_angle_rad": 0.1},
    "pfcli.WheelEncoders": {"names": ["l", "r"], "ticks": [3, 4], "ticks_per_turn": 2000},
    "pfcli.Heading": {"yaw_rad": 1.0, "sigma_rad": 0.1},
    "pfcli.Range": {"range_m": None, "range_max_m": 4.0},
    "pfcli.LaserScan": {"ranges_m": [1.0, None], "angle_min_rad": 0.0, "angle_increment_rad": 0.1, "range_max_m": 9.0},
    "pfcli.LinePoints": {"points_m": [[1.0, 2.0]]},
    "pfcli.Landmarks": {"landmarks": [{"id": "7", "range_m": 2.0, "bearing_rad": 0.1}]},
    "pfcli.Pose2D": {"x_m": 1.0, "y_m": 2.0, "yaw_rad": 0.5},
}
"""One message of each JSON type."""


def _value(kind: Any) -> Any:
    """A value of a ROS field type: arrays get one element, strings a word."""
    node, detail = kind
    if node.name == "BASE":
        return {"string": "base_link", "bool": True}.get(detail[0], 1.5 if detail[0].startswith("float") else 1)
    if node.name == "NAME":
        return message(detail)
    element, length = detail
    count = length if node.name == "ARRAY" else 1
    if element[0].name == "BASE" and element[1][0] != "string":
        dtype = {"octet": "uint8", "char": "uint8"}.get(element[1][0], element[1][0])
        return np.full(count, _value(element), dtype)
    return [_value(element)] * count


def message(schema: str) -> Any:
    """A ROS message with a value in every field."""
    return typestore().types[schema](*[_value(kind) for _, kind in typestore().fielddefs[schema][1]])


def ros_message(schema: str) -> Any:
    """One that can be used: its header is at home, and what is marked absent by -1 is there."""
    found = message(schema)
    if hasattr(found, "header"):
        found.header = header(_T0, "base_link")
    if hasattr(found, "orientation_covariance"):
        found.orientation_covariance[:] = 0.01
    if schema == "sensor_msgs/msg/PointCloud2":
        kind = type(found.fields[0])
        found.fields = [kind(name, 4 * k, 7, 1) for k, name in enumerate("xyz")]
        found.height, found.width, found.point_step, found.row_step, found.is_bigendian = 1, 1, 12, 12, False
        found.data = np.frombuffer(np.array([1.0, 2.0, 0.5], "<f4").tobytes(), np.uint8)
    return found


def _logs() -> list[bytes]:
    """Short definitions: what is fuzzed is not the text of a schema."""
    kinds = ("tf2_msgs/msg/TFMessage", "nav_msgs/msg/Odometry", "sensor_msgs/msg/LaserScan")
    topics = {kind: f"/{kind.rpartition('/')[2]}" for kind in kinds}
    topics[kinds[0]] = "/tf_static"
    made = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.mcap"
        for compression in ("none", "zstd", "lz4"):
            with LogWriter(path, compression) as log:
                for k, kind in enumerate((*kinds, *kinds[1:])):
                    payload = bytes(typestore().serialize_cdr(ros_message(kind), kind))
                    log.raw(topics[kind], kind, _T0 + k, payload, "# ")
                log.raw("/enc", "pfcli.WheelEncoders", _T0, json.dumps(MESSAGES["pfcli.WheelEncoders"]).encode(), "{}")
            made.append(path.read_bytes())
    return made


def _bag() -> bytes:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "geometry_msgs/msg/PoseStamped"
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](1, 2)
    pose = types["geometry_msgs/msg/Pose"](
        types["geometry_msgs/msg/Point"](1.0, 2.0, 0.0), types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    )
    made = types[kind](types["std_msgs/msg/Header"](0, stamp, "map"), pose)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.bag"
        with Writer(path) as bag:
            connection = bag.add_connection("/pose", kind, typestore=store)
            bag.write(connection, 1, store.serialize_ros1(made, kind))
        return path.read_bytes()


_MAP = (
    b"image: map.pgm\nmode: trinary\nresolution: 0.05\norigin: [0.0, 0.0, 0.0]\n"
    b"negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
)
_PNG = (
    b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01\x08\0\0\0\0:~\x9bU\0\0\0\nIDATx\x9cc\xf8\x0f\0\x01\x01\x01\0\x1b\xb6\xee"
    b"V\0\0\0\0IEND\xaeB`\x82"
)
_CARMEN = (
    b"ODOM 1.0 2.0 0.5 0.1 0.2 0.0 10.5 host 10.5\n"
    b"FLASER 3 1.0 2.0 3.0 1.0 2.0 0.5 1.0 2.0 0.5 10.6 host 10.6\n"
    b"ROBOTLASER1 0 -1.57 3.14 1.57 80 0.01 0 2 1.0 2.0 0 1 2 0.5 1 2 0.5 0 0 0 0 0 10.7 host 10.7\n"
    b"O 100 200 0.5 11.0\nL 100 200 0.5 100 200 0.5 150 160 11.1\n"
)


def seeds(target: str) -> list[bytes]:
    """Good inputs of a target."""
    if target == "mcap":
        return _logs()
    if target == "cdr":
        return [
            bytes([k]) + bytes(typestore().serialize_cdr(ros_message(kind), kind)) for k, (_, kind) in enumerate(CDR)
        ]
    if target == "json":
        return [bytes([k]) + json.dumps({"stamp_ns": 1} | MESSAGES[kind]).encode() for k, (_, kind) in enumerate(JSON)]
    if target == "map":
        return [_MAP + b"\fP5\n3 2\n255\n" + bytes([0, 254, 205] * 2), _MAP.replace(b"trinary", b"raw") + b"\f" + _PNG]
    if target == "carmen":
        import bz2
        import gzip

        return [_CARMEN, gzip.compress(_CARMEN, mtime=0), bz2.compress(_CARMEN)]
    if target == "ticks":
        row = b"1000 " + b"0 " * 23 + b"1500 " * 682 + b"\n"
        return [
            b"t" + row,
            b"c#kinematic_model: x\n#joints_max_enc_values: 8192 5000\ntime: 1.5 ticks: 3 4 model_pose: 1 2 3 tracker_pose: 1 2 3\n",  # noqa: E501
            b"otype,omni3\nngear,1\nencRes,1024\nLi,0.2\nDi,0.1\n\f0.1,1,2,3,4,5,6\n0.2,1,2,3,4,5,6\n",
            b"lM 10 5 0 0 0 6\n\fS 11 2 1000 1200\n",
        ]
    if target == "landmarks":
        return [
            b"s1 2 3\n\fODOMETRY 0.1 1.0 0.1\nSENSOR 1 2.0 0.5\n",
            b"m6 63\n\f6 1 2\n\f1.0 0.1 0.2\n\f1.0 1 2 0.5\n\f1.0 63 2 0.5\n",
        ]
    if target == "frames":
        text = b'f{"Input": {"landmarks": [{"x": 1, "y": 2}]}, "Output": {"candidates": [{"pose": {"x": 1, "y": 2, "rz": 0.1}}]}}'
        return [text, b"c1000 2000 0.5\n1100 2100 0.5\n"]
    if target == "tables":
        return [
            b"t1.5 1 2 0 0 0 0 1\n",
            b"r1.0 2.0 1 2 0 0 0 0.5\n",
            b"lid,x_m,y_m\n7,1.0,2.0\n",
            b"ylength: 18\nwidth: 12\nline_width: 0.125\ncentre_circle: 2.0\nlandmarks:\n- {name: a, kind: post, x: 1, y: 2}\n",
        ]
    return [_bag()]


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """A copy with a few bits flipped, bytes overwritten by telling ones, and pieces cut, doubled or moved."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        at = int(rng.integers(len(out) + 1)) if out else 0
        size = int(rng.integers(1, 16))
        what = rng.integers(6)
        if what == 0 and at < len(out):
            out[at] ^= 1 << int(rng.integers(8))
        elif what == 1:
            out[at : at + 4] = struct.pack("<I", int(rng.choice([0, 1, 0x7FFFFFFF, 0xFFFFFFFF, 0x10000, 255])))
        elif what == 2:
            del out[at : at + size]
        elif what == 3:
            out[at:at] = out[at : at + size]
        elif what == 4:
            out[at:at] = bytes(
                rng.choice([b"nan", b"1e999", b"-1", b"9" * 30, b"\0", b"[" * 40, b"\xff\xfe", b"\n", b" "])
            )
        else:
            del out[at:]
    return bytes(out)
