"""Points of a 3D laser, out of sensor_msgs/PointCloud2."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from semap_ingest.recording.header import frame_name, stamp_us
from semap_ingest.recording.passed_over import Unusable
from semap_ingest.sensing.scan import Cloud

DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""sensor_msgs/PointField's INT8 to FLOAT64."""


def decode_cloud(message: Any, log_us: int) -> Cloud:
    """Its points; those with a coordinate that is NaN or infinite are left out.

    raises  Unusable for a cloud without x, y or z, or fewer bytes than its points need
    """
    stored = _stored(message)
    points_m = np.column_stack([stored[axis].ravel().astype(np.float32) for axis in "xyz"])
    return Cloud(
        stamp_us(message.header.stamp, log_us),
        frame_name(message.header.frame_id),
        points_m[np.isfinite(points_m).all(axis=1)],
    )


def _stored(message: Any) -> NDArray[np.void]:
    """(height, width) of x, y and z where they lie in the message's bytes."""
    fields = {field.name: field for field in message.fields}
    missing = {"x", "y", "z"} - fields.keys()
    if missing:
        raise Unusable(f"a cloud without {', '.join(sorted(missing))}")
    order = ">" if message.is_bigendian else "<"
    try:
        point = np.dtype(
            {
                "names": list("xyz"),
                "formats": [order + DATATYPES[fields[axis].datatype] for axis in "xyz"],
                "offsets": [fields[axis].offset for axis in "xyz"],
                "itemsize": message.point_step,
            }
        )
    except KeyError as error:
        raise Unusable(f"a coordinate of the unknown datatype {error}") from error
    except ValueError as error:
        raise Unusable(f"points of {message.point_step} bytes: {error}") from error
    height, width, step = message.height, message.width, message.row_step
    row = width * message.point_step
    if not (height and width):
        return np.empty((0, 0), point)
    step = step if height > 1 else row  # some drivers leave it out where there is one row only
    if step < row or len(message.data) < (height - 1) * step + row:
        raise Unusable(f"{len(message.data)} bytes in rows of {step} for {width}x{height} points")
    return np.ndarray((height, width), point, message.data, strides=(step, message.point_step))
