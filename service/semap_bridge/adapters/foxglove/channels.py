"""What the app is given, each under its topic; the same live and in a file.

Stamps and log times are event time, so that a replay is shown at the time that it is of.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from foxglove import Channel, Context
from foxglove.channels import FrameTransformsChannel, LogChannel, SceneUpdateChannel
from foxglove.messages import (
    FrameTransform,
    FrameTransforms,
    Log,
    LogLevel,
    Quaternion,
    SceneEntity,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SceneUpdate,
    Timestamp,
    Vector3,
)

from semap.model.pose import IDENTITY
from semap.store.event.events import StoredEvent
from semap.store.map.frames import Frame
from semap.timeline.stamp import rfc3339, to_datetime, to_us

TF = "/tf"
TF_STATIC = "/tf_static"
BUILDING = "/semap/building"
DOORS = "/semap/doors"
PEOPLE = "/semap/people"
LINES = "/semap/lines"
LOG = "/semap/log"
EVENTS = "/semap/events"
STATE = "/semap/state"
OWN_TOPICS = frozenset({TF, TF_STATIC, BUILDING, DOORS, PEOPLE, LINES, LOG, EVENTS, STATE})

SECOND_US = 1_000_000
LAST_US = (1 << 32) * SECOND_US - 1

LABELLED = {
    "type": "array",
    "items": {
        "type": "object",
        "properties": {"label": {"type": "string"}, "value": {"type": ["string", "integer"]}},
    },
}
STATE_SCHEMA: Mapping[str, object] = {
    "title": "semap.State",
    "type": "object",
    "properties": {"stamp": {"type": "string"}, "rooms": LABELLED, "doors": LABELLED, "people": LABELLED},
}
EVENT_SCHEMA: Mapping[str, object] = {
    "title": "io.cloudevents.Event",
    "type": "object",
    "properties": {
        **{name: {"type": "string"} for name in ("specversion", "id", "source", "type", "time", "subject")},
        "data": {"type": "object"},
    },
}


@dataclass(frozen=True)
class State:
    """How things stand: what a timeline shows.

    rooms   how many are in each, by its name
    doors   how each stands, by its name
    people  in which rooms each is, by its name; empty: in none
    """

    rooms: Mapping[str, int]
    doors: Mapping[str, str]
    people: Mapping[str, str]


class Channels:
    """All topics of a context, which a server or a file reads."""

    def __init__(self, context: Context) -> None:
        self.tf = FrameTransformsChannel(TF, context=context)
        self.tf_static = FrameTransformsChannel(TF_STATIC, context=context)
        self.building = SceneUpdateChannel(BUILDING, context=context)
        self.doors = SceneUpdateChannel(DOORS, context=context)
        self.people = SceneUpdateChannel(PEOPLE, context=context)
        self.lines = SceneUpdateChannel(LINES, context=context)
        self.log = LogChannel(LOG, context=context)
        self.events = Channel(EVENTS, schema=dict(EVENT_SCHEMA), context=context)
        self.state = Channel(STATE, schema=dict(STATE_SCHEMA), context=context)

    def give_frames(self, frames: Iterable[Frame], stamp_us: int) -> None:
        """The tree of frames, whole: an app that seeks in a file is given the last message of a topic."""
        found = [placed(each, stamp_us) for each in frames if each.parent is not None]
        self.tf_static.log(FrameTransforms(transforms=found), log_time=log_time_ns(stamp_us))

    def give_moves(self, moved: Sequence[FrameTransform], stamp_us: int) -> None:
        """Frames that moved."""
        self.tf.log(FrameTransforms(transforms=list(moved)), log_time=log_time_ns(stamp_us))

    def give_state(self, state: State, stamp_us: int) -> None:
        """Rows with a label and a value, which the app's timeline shows as one row each."""
        rows = {
            name: [{"label": label, "value": value} for label, value in values.items()]
            for name, values in (("rooms", state.rooms), ("doors", state.doors), ("people", state.people))
        }
        self.state.log({"stamp": rfc3339(to_datetime(stamp_us)), **rows}, log_time=log_time_ns(stamp_us))

    def give_event(self, event: StoredEvent, document: bytes) -> None:
        """As a line of the log, and as its CloudEvent."""
        stamp_us = to_us(event.stamp)
        self.events.log(document, log_time=log_time_ns(stamp_us))
        self.log.log(
            Log(
                timestamp=timestamp(stamp_us),
                level=LogLevel.Warning if event.verdict == "retracted" else LogLevel.Info,
                message=told(event),
                name=event.rule,
            ),
            log_time=log_time_ns(stamp_us),
        )


def give_entities(
    channel: SceneUpdateChannel, entities: Sequence[SceneEntity], gone: Sequence[str], stamp_us: int
) -> None:
    """Entities that are new or otherwise than before, and the ids of those that are there no more."""
    deletions = [
        SceneEntityDeletion(timestamp=timestamp(stamp_us), type=SceneEntityDeletionType.MatchingId, id=each)
        for each in gone
    ]
    channel.log(SceneUpdate(deletions=deletions, entities=list(entities)), log_time=log_time_ns(stamp_us))


def placed(frame: Frame, stamp_us: int) -> FrameTransform:
    """Where a frame stands in its parent; one without a pose stands as that does."""
    pose = frame.pose or IDENTITY
    return FrameTransform(
        timestamp=timestamp(stamp_us),
        parent_frame_id=frame.parent or "",
        child_frame_id=frame.name,
        translation=Vector3(x=pose.x_m, y=pose.y_m, z=pose.z_m),
        rotation=Quaternion(x=pose.qx, y=pose.qy, z=pose.qz, w=pose.qw),
    )


def told(event: StoredEvent) -> str:
    """What happened, in words."""
    verdict = f" ({event.verdict})" if event.verdict else ""
    words = (event.track_name, event.type.replace("_", " "), event.instance_name)
    return " ".join(each for each in words if each) + verdict


def timestamp(stamp_us: int) -> Timestamp:
    """The nearest that the app knows: its clock begins in 1970 and ends in 2106."""
    shown_us = within(stamp_us)
    return Timestamp(shown_us // SECOND_US, shown_us % SECOND_US * 1000)


def log_time_ns(stamp_us: int) -> int:
    """[ns since 1970]"""
    return within(stamp_us) * 1000


def within(stamp_us: int) -> int:
    return min(max(stamp_us, 0), LAST_US)
