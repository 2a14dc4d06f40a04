"""What is fuzzed: everything that reads bytes from the outside. Each target takes bytes and may raise PfcliError, no more."""

import contextlib
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

from pfcli.errors import PfcliError
from pfcli.formats import (
    carmen,
    conversion,
    field_yaml,
    landmark_csv,
    landmark_logs,
    line_frames,
    map_yaml,
    messages,
    relations,
    tick_logs,
    tum,
)
from pfcli.formats.limits import AS_IT_IS, Limits
from pfcli.formats.roles import ROLES
from pfcli.replay import plausible
from pfcli.replay.log import Log
from pfcli.replay.settings import Settings

LIMITS = Limits(chunk_mib=4, buffer_mib=16)
CDR = [(role, kind) for role, kinds in ROLES.items() for kind in kinds if not kind.startswith("pfcli.")]
JSON = [(role, kind) for role, kinds in ROLES.items() for kind in kinds if kind.startswith("pfcli.")]


@cache
def _folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="pfcli-fuzz-"))


def _file(name: str, data: bytes) -> Path:
    path = _folder() / name
    path.write_bytes(data)
    return path


def mcap(data: bytes) -> None:
    """A whole log, read in every role that its topics can play."""
    path = _file("x.mcap", data)
    roles = Log(path, Settings(limits=LIMITS)).roles()
    topics = {role: found[0] for role, found in roles.items() if found}
    log = Log(path, Settings(topics=topics, extrinsics=("base_link:laser=0,0,0",), limits=LIMITS))
    for _ in log.events(list(topics)):
        pass


@cache
def _decoder(role: str, kind: str) -> messages.Decoder:
    return messages.decoder(role, kind)


def _message(kinds: list[tuple[str, str]], data: bytes) -> None:
    if not data:
        return
    decode = _decoder(*kinds[data[0] % len(kinds)])
    try:
        event, _ = decode(data, 1, len(data) - 1, 1)
    except (ValueError, OverflowError, messages.struct.error):
        return
    plausible.fault(event)


def cdr(data: bytes) -> None:
    """A CDR message; the first byte chooses the role and the type."""
    _message(CDR, data)
    messages.transforms(data, 1, len(data) - 1)


def json(data: bytes) -> None:
    """A JSON message; the first byte chooses the type."""
    from pfcli.formats import json_messages

    _message(JSON, data)
    try:
        json_messages.stamp_of(data[1:])
    except ValueError:
        return


def map(data: bytes) -> None:
    """A map's YAML, and behind a form feed its image."""
    text, _, image = data.partition(b"\f")
    _file("map.pgm", image)
    map_yaml.read(_file("map.yaml", text))


def carmen_log(data: bytes) -> None:
    """A CARMEN log; gzip and bzip2 by their magic."""
    ending = {b"\x1f\x8b": ".gz", b"BZ": ".bz2"}.get(data[:2], "")
    records, _ = carmen.read(_file(f"x.log{ending}", data))
    stamps, _ = carmen.stamps_ns([r.stamp for r in records], repair=True)
    carmen.usable_range_m(records)
    for _ in carmen.events(records, stamps, 10.0):
        pass


def ticks(data: bytes) -> None:
    """Logs of wheel ticks; the first byte chooses which."""
    kind, body = data[:1], data[1:]
    if kind == b"t":
        tick_logs.tinyslam(_file("x.dat", body))
    elif kind == b"c":
        tick_logs.tricycle(_file("x.txt", body))
    elif kind == b"o":
        meta, _, run = body.partition(b"\f")
        _file("o_metadata.csv", meta)
        tick_logs.optiodom(_file("o_run-01.csv", run))
    else:
        motors, _, scans = body.partition(b"\f")
        _file("robot_motors.txt", motors)
        _file("robot_scan.txt", scans)
        tick_logs.lego(_folder())


def landmarks(data: bytes) -> None:
    """Logs of landmarks; the first byte chooses which, a form feed parts the files."""
    kind, parts = data[:1], [*data[1:].split(b"\f"), *[b""] * 5]
    if kind == b"s":
        _file("world.dat", parts[0])
        landmark_logs.stachniss(_file("sensor_data.dat", parts[1]))
    else:
        names = ("Barcodes", "Landmark_Groundtruth", "Robot1_Odometry", "Robot1_Groundtruth")
        for name, part in zip(names, parts, strict=False):
            _file(f"{name}.dat", part)
        landmark_logs.mrclam(_file("Robot1_Measurement.dat", parts[4]))


def frames(data: bytes) -> None:
    """Frames of field lines; the first byte chooses which."""
    if data[:1] == b"f":
        line_frames.falcons(_file("x.json", data[1:]))
    else:
        line_frames.carpe_noctem(_file("x_LinePoints.txt", data[1:]))


def tables(data: bytes) -> None:
    """Tracks, relations, landmarks and fields; the first byte chooses which."""
    kind, body = data[:1], data[1:]
    if kind == b"t":
        tum.read(_file("x.tum", body))
    elif kind == b"r":
        relations.read(_file("x.relations", body))
    elif kind == b"l":
        landmark_csv.read(_file("x.csv", body))
    else:
        field_yaml.read(str(_file("x.yaml", body)))


def bag(data: bytes) -> None:
    """A ROS 1 bag."""
    conversion.convert([_file("x.bag", data)], _folder() / "bag.mcap", "none", AS_IT_IS)


TARGETS: dict[str, Callable[[bytes], None]] = {
    "mcap": mcap,
    "cdr": cdr,
    "json": json,
    "map": map,
    "carmen": carmen_log,
    "ticks": ticks,
    "landmarks": landmarks,
    "frames": frames,
    "tables": tables,
    "bag": bag,
}


def check(name: str, data: bytes) -> None:
    """Run a target; anything but PfcliError is a finding."""
    with contextlib.suppress(PfcliError):
        TARGETS[name](data)
