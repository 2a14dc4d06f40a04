"""A recording is one thing: parts, folders, patterns; one time zero, and what is missing has a name."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from pfcli.errors import LogError
from pfcli.events import Pose2, Scan
from pfcli.formats.log_writer import LogWriter
from pfcli.replay.log import Log
from tests.formats.odd_logs import T0, numbers, write


def _split(folder: Path, cuts: list[int], name: str = "bag_{}.mcap") -> list[Path]:
    """Messages cuts[0] .. cuts[-1], a part between each two cuts."""
    folder.mkdir(exist_ok=True)
    paths = [folder / name.format(k) for k in range(len(cuts) - 1)]
    for path, begin, end in zip(paths, cuts, cuts[1:], strict=False):
        write(path, list(range(begin, end)))
    return paths


def _describe(folder: Path, names: list[str]) -> None:
    about = [{"path": n, "message_count": 7, "duration": {"nanoseconds": 700_000_000}} for n in names]
    table = {"rosbag2_bagfile_information": {"version": 8, "relative_file_paths": names, "files": about}}
    (folder / "metadata.yaml").write_text(yaml.safe_dump(table))


def test_parts_in_any_order_folder_or_pattern_are_one_recording(tmp_path: Path) -> None:
    paths = _split(tmp_path / "bag", list(range(0, 130, 10)))
    assert len(paths) == 12
    for given in (paths, sorted(paths, reverse=True), [tmp_path / "bag"], [tmp_path / "bag" / "bag_*.mcap"]):
        log = Log(given)
        assert numbers(log) == list(range(120))
        assert not log.dropped
    _describe(tmp_path / "bag", [path.name for path in paths])
    assert numbers(Log(tmp_path / "bag")) == list(range(120))


def test_the_window_counts_from_the_first_part(tmp_path: Path) -> None:
    paths = _split(tmp_path, [0, 40, 100])
    assert numbers(paths, start_s=3.0, end_s=5.0) == list(range(30, 51))


def test_parts_that_overlap_are_put_in_order(tmp_path: Path) -> None:
    write(tmp_path / "a_0.mcap", list(range(60)))
    write(tmp_path / "a_1.mcap", list(range(50, 100)))
    log = Log(tmp_path)
    assert numbers(log) == sorted([*range(60), *range(50, 100)])
    assert not log.dropped
    assert "overlaps a_0.mcap by 0.900 s" in log.dropped.notes[0]


def test_recordings_of_the_same_time_are_not_mixed(tmp_path: Path) -> None:
    write(tmp_path / "a_0.mcap", list(range(300)))
    write(tmp_path / "a_1.mcap", list(range(100, 300)))
    with pytest.raises(LogError, match=r"a_1.mcap: overlaps .*a_0.mcap by 19.9 s, and both hold /odom"):
        Log(tmp_path)


def test_what_is_missing_between_parts_is_named(tmp_path: Path) -> None:
    paths = _split(tmp_path, [0, 30, 60, 90])
    paths[1].unlink()
    log = Log(tmp_path)
    assert numbers(log) == [*range(30), *range(60, 90)]
    told = " ".join(log.dropped.notes)
    assert "parts 0 to 2 of bag, but not bag_1" in told
    assert "bag_2.mcap: begins 3.100 s after bag_0.mcap ends" in told
    _describe(tmp_path, [path.name for path in paths])
    log = Log(tmp_path)
    numbers(log)
    assert "names bag_1.mcap, which is not there: 7 messages of 0.7 s are missing" in log.dropped.notes[0]


def test_a_folder_of_two_recordings_names_both(tmp_path: Path) -> None:
    _split(tmp_path, [0, 10, 20], "a_{}.mcap")
    _split(tmp_path, [0, 10], "b_{}.mcap")
    with pytest.raises(LogError, match=r"holds 2 recordings: a \(2 parts\), b_0.mcap; name one"):
        Log(tmp_path)


def test_a_folder_of_one_bag_is_that_bag(tmp_path: Path) -> None:
    (path,) = _split(tmp_path / "bag", [0, 10])
    _describe(tmp_path / "bag", [path.name])
    assert numbers(tmp_path) == list(range(10))
    (path.parent / "metadata.yaml").write_text("nothing: here\n")
    with pytest.raises(LogError, match="relative_file_paths"):
        Log(tmp_path)


def test_the_mounts_of_one_part_hold_for_all(tmp_path: Path) -> None:
    for k in range(2):
        with LogWriter(tmp_path / f"bag_{k}.mcap") as out:
            if k == 0:
                out.tf_static(T0, [("base_link", "laser", Pose2(0.1, 0.2, 0.3))])
            for n in range(10 * k, 10 * k + 10):
                out.scan(Scan(T0 + n * 100_000_000, np.ones(2, np.float32), 0.0, 0.1, 0.0, 9.0, Pose2()))
    scans = list(Log(tmp_path).events(["scan"]))
    assert len(scans) == 20
    assert all(scan.mount == pytest.approx((0.1, 0.2, 0.3)) for scan in scans)  # type: ignore[union-attr]


def test_an_empty_last_part_is_named_and_costs_nothing_else(tmp_path: Path) -> None:
    paths = _split(tmp_path, [0, 10, 20, 30])
    paths[2].write_bytes(b"")
    log = Log(tmp_path)
    assert numbers(log) == list(range(20))
    assert "bag_2.mcap: is empty" in log.dropped.notes[0]
