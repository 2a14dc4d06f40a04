"""Fields of play: the ones that come with pfcli, one's own, and files that are wrong."""

from pathlib import Path

import numpy as np
import pytest

from pfcli.errors import PfcliError
from pfcli.formats import field_yaml


def test_the_shipped_fields_have_the_leagues_dimensions() -> None:
    assert field_yaml.names() == ["msl-18x12", "msl-22x14"]
    for name, x, y in (("msl-18x12", 9.0, 6.0), ("msl-22x14", 11.0, 7.0)):
        field = field_yaml.read(name)
        assert field.symmetric
        assert np.allclose(field.lines.high, [x, y])
        # dimensions run to the outer edges, lines are kept by their middles
        assert field.lines.segments[:, 0].max() == pytest.approx(x - 0.0625)
        assert sorted(field.lines.arcs[:, 2])[-1] == pytest.approx(2.0 - 0.0625)
        assert len({mark.name for mark in field.landmarks}) == len(field.landmarks)
        assert {mark.kind for mark in field.landmarks} == {"post", "corner", "tee", "cross", "circle", "spot"}


def test_ones_own_lines_arcs_and_landmarks_are_added(tmp_path: Path) -> None:
    path = tmp_path / "hall.yaml"
    path.write_text(
        "length: 8\nwidth: 5\nhalfway: false\nsegments: [[-1, 0, 1, 0]]\narcs: [[2, 1, 0.5, 0, 90]]\n"
        "landmarks: [{name: door, kind: door, x: 4, y: 0}]\n"
    )
    field = field_yaml.read(str(path))
    assert field.lines.segments.shape[0] == 5
    assert field.lines.arcs.shape[0] == 1
    assert not field.symmetric
    assert [mark.name for mark in field.landmarks if mark.kind == "door"] == ["door"]
    assert field_yaml.drawn(field).cells.max() == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("length: 8\n", "'width' is missing"),
        ("length: 8\nwidth: x\n", "'width'"),
        ("length: 8\nwidth: .nan\n", "'width'"),
        ("length: 8\nwidth: 5\ncolour: green\n", "'colour' is unknown"),
        ("length: 8\nwidth: 5\nsegments: [[0, 1, 0, 1]]\n", "has no length"),
        ("length: 8\nwidth: 5\nsegments: [[-1, -1, 1, 1], [-1, 1, 1, -1]]\n", "cross"),
        ("length: 8\nwidth: 5\nsegments: [[0, 1]]\n", "4 numbers"),
        ("length: 8\nwidth: 5\narcs: [[0, 1, -1, 0, 90]]\n", "radius"),
        ("length: 8\nwidth: 5\npenalty_area: [3]\n", "2 positive lengths"),
        ("length: 8\nwidth: 5\nlandmarks: [{name: a}]\n", "landmarks"),
        ("- 1\n", "is no field"),
        ("a: [\n", "cannot be read"),
    ],
)
def test_a_wrong_field_is_refused_in_one_line_that_names_it(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(PfcliError, match=r"bad\.yaml") as caught:
        field_yaml.read(str(path))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
