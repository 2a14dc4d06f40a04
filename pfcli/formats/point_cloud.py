"""sensor_msgs/PointCloud2 as an array of points, whatever its fields and their order."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

_KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""sensor_msgs/PointField datatypes."""


def points_of(message: Any) -> NDArray[np.float32]:
    """Points (n, 3) in the cloud's own frame (m); NaN where a cell of an organised cloud holds nothing.

    Raises ValueError naming the field that is missing or does not fit the data.
    """
    fields = {field.name: field for field in message.fields}
    for name in "xyz":
        if name not in fields:
            raise ValueError(f"has no field {name!r}; its fields are {', '.join(fields) or 'none'}")
        if fields[name].datatype not in _KINDS:
            raise ValueError(f"field {name!r} has the unknown datatype {fields[name].datatype}")
    order = ">" if message.is_bigendian else "<"
    dtype = np.dtype(
        {
            "names": list("xyz"),
            "formats": [order + _KINDS[fields[name].datatype] for name in "xyz"],
            "offsets": [int(fields[name].offset) for name in "xyz"],
            "itemsize": int(message.point_step),
        }
    )
    rows, columns, row_step = int(message.height), int(message.width), int(message.row_step)
    data = np.asarray(message.data, np.uint8)
    if row_step < columns * dtype.itemsize or data.size < rows * row_step - (row_step - columns * dtype.itemsize):
        raise ValueError(f"field 'data' holds {data.size} bytes, less than {rows} rows of {row_step}")
    parts = [np.frombuffer(data, dtype, columns, row * row_step) for row in range(rows)] if columns else []
    if not parts:
        return np.empty((0, 3), np.float32)
    points = parts[0] if rows == 1 else np.concatenate(parts)
    return np.stack([points[name].astype(np.float32) for name in "xyz"], axis=1)
