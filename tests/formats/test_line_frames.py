"""Frames of field lines that teams have published."""

import json
import math
from pathlib import Path

import pytest

from pfcli.errors import LogError
from pfcli.events import Heading, LinePoints, Truth
from pfcli.formats import line_frames


def test_a_frame_of_the_falcons_has_its_pose_along_the_length(tmp_path: Path) -> None:
    path = tmp_path / "frame.json"
    pose = {"x": 0.6, "y": 3.0, "rz": 1.7}
    path.write_text(
        json.dumps({"Input": {"landmarks": [{"x": 1, "y": 2}]}, "Output": {"candidates": [{"pose": pose}]}})
    )
    reader = line_frames.reader_of(path)
    assert reader is not None
    events = {type(e): e for e in reader(path).events}
    truth, points = events[Truth], events[LinePoints]
    assert isinstance(truth, Truth)
    assert isinstance(points, LinePoints)
    assert tuple(truth[1:4]) == pytest.approx((3.0, -0.6, 1.7 - math.pi / 2))
    assert points.points_m.tolist() == [[1.0, 2.0]]


def test_a_frame_of_carpe_noctem_is_in_millimetres_with_a_heading(tmp_path: Path) -> None:
    path = tmp_path / "LinePoints.txt"
    path.write_text("1000 -500 0.25\n2000 0 0.25\n")
    events = {type(e): e for e in line_frames.carpe_noctem(path).events}
    heading, points = events[Heading], events[LinePoints]
    assert isinstance(heading, Heading)
    assert isinstance(points, LinePoints)
    assert heading.yaw_rad == 0.25
    assert points.points_m.tolist() == [[1.0, -0.5], [2.0, 0.0]]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.json", "{"),
        ("a.json", "[]"),
        ("a.json", '{"Input": {}}'),
        ("a.json", '{"Input": {"landmarks": []}}'),
        ("a.json", '{"Input": {"landmarks": [{"x": "y"}]}}'),
        ("a.json", '{"Input": {"landmarks": [{"x": 1, "y": NaN}]}}'),
        ("LinePoints.txt", "1 2\n"),
        ("LinePoints.txt", "a b c\n"),
        ("LinePoints.txt", ""),
    ],
)
def test_what_is_no_frame_is_one_line(name: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(text)
    reader = line_frames.reader_of(path)
    assert reader is not None
    with pytest.raises(LogError, match=name) as caught:
        reader(path)
    assert "\n" not in str(caught.value)
