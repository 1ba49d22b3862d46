"""What sensors say, as the app shows it: scans, images, and boxes in them."""

from __future__ import annotations

import math

from foxglove.messages import (
    Color,
    CompressedImage,
    FrameTransform,
    ImageAnnotations,
    LaserScan,
    Point2,
    PointsAnnotation,
    PointsAnnotationType,
    Quaternion,
    RawImage,
    TextAnnotation,
    Vector3,
)
from semap_ingest.sensing import boxes, image, scan, transform

from semap_bridge.adapters.foxglove.building import pose_at
from semap_bridge.adapters.foxglove.channels import timestamp

BOX = Color(r=1.0, g=0.8, b=0.1, a=1.0)
BEHIND = Color(r=0.0, g=0.0, b=0.0, a=0.6)
Shown = LaserScan | CompressedImage | RawImage | ImageAnnotations
MAGIC = {b"\x89PNG": "png"}


def shown(seen: scan.Scan | image.Image | image.CompressedImage | boxes.Boxes) -> Shown:
    """What a sensor said, or what was found in it."""
    match seen:
        case scan.Scan():
            return laser_scan(seen)
        case boxes.Boxes():
            return box_annotations(seen)
    return picture(seen)


def laser_scan(seen: scan.Scan) -> LaserScan:
    """A sweep; where nothing came back is no point."""
    count = len(seen.ranges_m)
    return LaserScan(
        timestamp=timestamp(seen.stamp_us),
        frame_id=seen.frame,
        pose=pose_at(0, 0, 0),
        start_angle=seen.angle_min_rad,
        end_angle=seen.angle_min_rad + seen.angle_step_rad * max(count - 1, 0),
        ranges=[
            range_m if is_return else math.inf
            for range_m, is_return in zip(seen.ranges_m.tolist(), seen.is_return.tolist(), strict=True)
        ],
    )


def picture(seen: image.Image | image.CompressedImage) -> CompressedImage | RawImage:
    """An image as it came."""
    if isinstance(seen, image.CompressedImage):
        return CompressedImage(
            timestamp=timestamp(seen.stamp_us),
            frame_id=seen.frame,
            data=seen.data,
            format=MAGIC.get(seen.data[:4], "jpeg"),
        )
    height, width, _ = seen.pixels.shape
    return RawImage(
        timestamp=timestamp(seen.stamp_us),
        frame_id=seen.frame,
        width=width,
        height=height,
        encoding="rgb8",
        step=3 * width,
        data=seen.pixels.tobytes(),
    )


def box_annotations(found: boxes.Boxes) -> ImageAnnotations:
    """Boxes with their labels, for the image of the same stamp."""
    stamp = timestamp(found.stamp_us)
    return ImageAnnotations(
        timestamp=stamp,
        points=[
            PointsAnnotation(
                timestamp=stamp,
                type=PointsAnnotationType.LineLoop,
                points=[Point2(x=x, y=y) for x, y in ((x1, y1), (x2, y1), (x2, y2), (x1, y2))],
                outline_color=BOX,
                thickness=2.0,
            )
            for x1, y1, x2, y2 in found.corners_px.tolist()
        ],
        texts=[
            TextAnnotation(
                timestamp=stamp,
                position=Point2(x=corners[0], y=corners[1]),
                text=f"{label} {score:.2f}" + (f" #{track}" if track >= 0 else ""),
                font_size=14.0,
                text_color=BOX,
                background_color=BEHIND,
            )
            for corners, label, score, track in zip(
                found.corners_px.tolist(),
                found.label,
                found.score.tolist(),
                found.track.tolist(),
                strict=True,
            )
        ],
    )


def frame_transform(seen: transform.Transform) -> FrameTransform:
    """Where a frame was in its parent."""
    x_m, y_m, z_m = seen.translation_m.tolist()
    qx, qy, qz, qw = seen.quaternion.tolist()
    return FrameTransform(
        timestamp=timestamp(seen.stamp_us),
        parent_frame_id=seen.parent,
        child_frame_id=seen.child,
        translation=Vector3(x=x_m, y=y_m, z=z_m),
        rotation=Quaternion(x=qx, y=qy, z=qz, w=qw),
    )
