"""Point clouds of any layout."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pfcli.formats.point_cloud import points_of

KINDS = {"f4": 7, "f8": 8, "i2": 3}


def cloud(points: Any, kind: str, order: str, gap: int, rows: int, padding: int) -> Any:
    """A message with these points (n, 3), `gap` bytes before each field, `padding` bytes behind each row."""
    size = np.dtype(kind).itemsize
    step = 3 * (gap + size) + 1
    columns = len(points) // rows
    data = bytearray()
    for k, point in enumerate(points):
        for value in point:
            data += bytes(gap) + np.array([value], order + kind).tobytes()
        data += b"\x07"
        if (k + 1) % columns == 0:
            data += bytes(padding)
    fields = [
        SimpleNamespace(name=name, offset=i * (gap + size) + gap, datatype=KINDS[kind], count=1)
        for i, name in enumerate("xyz")
    ]
    return SimpleNamespace(
        fields=[SimpleNamespace(name="rgb", offset=0, datatype=2, count=1), *reversed(fields)],
        height=rows,
        width=columns,
        point_step=step,
        row_step=step * columns + padding,
        is_bigendian=order == ">",
        data=np.frombuffer(bytes(data), np.uint8),
    )


@given(
    st.sampled_from(["f4", "f8", "i2"]),
    st.sampled_from("<>"),
    st.integers(0, 5),
    st.integers(1, 3),
    st.integers(0, 7),
    st.integers(1, 5),
)
def test_points_are_read_from_any_layout(
    kind: str, order: str, gap: int, rows: int, padding: int, columns: int
) -> None:
    points = np.arange(rows * columns * 3).reshape(-1, 3) - 4
    assert (points_of(cloud(points, kind, order, gap, rows, padding)) == points).all()


def test_what_is_missing_is_named() -> None:
    message = cloud(np.ones((4, 3)), "f4", "<", 0, 1, 0)
    message.fields = message.fields[:2]
    with pytest.raises(ValueError, match="no field 'x'; its fields are rgb, z"):
        points_of(message)
    message = cloud(np.ones((4, 3)), "f4", "<", 0, 1, 0)
    message.data = message.data[:-5]
    with pytest.raises(ValueError, match="holds 47 bytes"):
        points_of(message)
