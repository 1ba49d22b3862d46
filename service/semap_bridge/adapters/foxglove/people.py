"""Who is on a map, as entities of a scene: where, which way, and how certain that is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from foxglove.messages import (
    ArrowPrimitive,
    Color,
    CylinderPrimitive,
    KeyValuePair,
    LinePrimitive,
    LinePrimitiveLineType,
    Point3,
    SceneEntity,
    Vector3,
)

from semap.store.map.placement import ROOT_FRAME
from semap.store.motion.live import LiveMap, ShownTrack
from semap.timeline.stamp import to_us
from semap_bridge.adapters.foxglove.building import pose_at, text
from semap_bridge.adapters.foxglove.channels import State, timestamp

RADII_95 = 2.447746830680816
"""The square root of the 95 % quantile of chi-squared with two degrees of freedom."""
BODY_M = (0.45, 1.0)
"""Width where the track has none, and height, about the point that was seen."""
BODY = Color(r=0.1, g=0.45, b=0.85, a=0.9)
ELLIPSE = Color(r=0.1, g=0.45, b=0.85, a=0.25)
SEEN = Color(r=0.9, g=0.45, b=0.1, a=1.0)
DISC_M = 0.02
ARROW_M = 0.5
Ends = tuple[float, float, float, float, float | None]
STANDING_M = 1.0
"""The height of who was seen from above only."""


def track_id_of(track_id: int) -> str:
    """The id of its entity."""
    return f"track/{track_id}"


def person_entity(track: ShownTrack) -> SceneEntity:
    """A body, the ellipse that has 95 % of the probability, an arrow along the heading, the name."""
    z_m = STANDING_M if track.z_m is None else track.z_m
    yaw_rad = track.heading_rad or 0.0
    size = Vector3(x=track.length_m or BODY_M[0], y=track.width_m or BODY_M[0], z=BODY_M[1])
    cylinders = [
        CylinderPrimitive(
            pose=pose_at(track.x_m, track.y_m, z_m, yaw_rad),
            size=size,
            bottom_scale=1,
            top_scale=1,
            color=BODY,
        )
    ]
    if track.std_m is not None:
        across_m = track.std_m if track.std_across_m is None else track.std_across_m
        cylinders.append(
            CylinderPrimitive(
                pose=pose_at(track.x_m, track.y_m, z_m, track.std_yaw_rad or 0.0),
                size=Vector3(x=2 * RADII_95 * track.std_m, y=2 * RADII_95 * across_m, z=DISC_M),
                bottom_scale=1,
                top_scale=1,
                color=ELLIPSE,
            )
        )
    return SceneEntity(
        timestamp=timestamp(to_us(track.stamp)),
        frame_id=ROOT_FRAME,
        id=track_id_of(track.track_id),
        metadata=[
            KeyValuePair(key=key, value=str(value))
            for key, value in (("name", track.name), ("std_m", track.std_m), ("speed_mps", track.speed_mps))
            if value is not None
        ],
        cylinders=cylinders,
        arrows=[]
        if track.heading_rad is None
        else [
            ArrowPrimitive(
                pose=pose_at(track.x_m, track.y_m, z_m, yaw_rad),
                shaft_length=ARROW_M,
                shaft_diameter=0.06,
                head_length=0.15,
                head_diameter=0.15,
                color=BODY,
            )
        ],
        texts=[text(track.name, track.x_m, track.y_m, z_m + BODY_M[1], 0.25)],
    )


def lines_entity(source: str, ends_m: Sequence[Ends], stamp_us: int) -> SceneEntity:
    """The straight lines that a source saw at once: x and y [m] of both ends, and z [m]."""
    return SceneEntity(
        timestamp=timestamp(stamp_us),
        frame_id=ROOT_FRAME,
        id=f"lines/{source}",
        metadata=[KeyValuePair(key="source", value=source)],
        lines=[
            LinePrimitive(
                type=LinePrimitiveLineType.LineList,
                pose=pose_at(0, 0, 0),
                thickness=3.0,
                scale_invariant=True,
                points=[
                    Point3(x=x_m, y=y_m, z=z_m or 0.0)
                    for x1_m, y1_m, x2_m, y2_m, z_m in ends_m
                    for x_m, y_m in ((x1_m, y1_m), (x2_m, y2_m))
                ],
                color=SEEN,
            )
        ],
    )


def state_of(present: LiveMap, rooms: Mapping[int, str]) -> State:
    """How things stand, in names."""
    people = {
        each.name: ", ".join(rooms[room] for room in each.rooms if room in rooms)
        for each in present.tracks.values()
    }
    counts = dict.fromkeys(sorted(rooms.values()), 0)
    for each in present.tracks.values():
        for room in each.rooms:
            if room in rooms:
                counts[rooms[room]] += 1
    return State(counts, {each.name: each.state for each in present.doors.values()}, people)
