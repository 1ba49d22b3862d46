"""What the service gives out, as values.

Lengths are metres in the frame of the map (right-handed, z up), stamps are aware UTC, in event time unless
they say otherwise. A shape is a GeoJSON geometry in metres. What a newer service adds
is passed over.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Annotated, Any, Literal
from uuid import UUID

from pydantic import AfterValidator, AwareDatetime


def _in_utc(stamp: datetime) -> datetime:
    return stamp.astimezone(UTC)


Stamp = Annotated[AwareDatetime, AfterValidator(_in_utc)]

Shape = Mapping[str, Any]
"""A GeoJSON geometry, in metres instead of degrees."""


@dataclass(frozen=True)
class Named:
    """Something that another thing refers to."""

    id: int
    name: str | None


@dataclass(frozen=True)
class Map:
    """A map, with how much is on it."""

    uid: UUID
    name: str
    instances: int
    tracks: int
    created_at: Stamp


@dataclass(frozen=True)
class Pose:
    """Translation [m] and quaternion (x y z w) in the frame of the map."""

    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0
    qx: float = 0.0
    qy: float = 0.0
    qz: float = 0.0
    qw: float = 1.0


@dataclass(frozen=True)
class Band:
    """Heights from z_min_m up to, but not including, z_max_m."""

    z_min_m: float
    z_max_m: float


@dataclass(frozen=True)
class Instance:
    """A thing on a map, as lists show it."""

    id: int
    uid: UUID
    map: str
    name: str
    alias: str | None
    concept: str
    storey: str | None


@dataclass(frozen=True)
class Room(Instance):
    """A room, and how many tracks are in it now."""

    occupants: int


@dataclass(frozen=True)
class InstanceDetail(Instance):
    """All that is known of an instance.

    band       heights that it answers for, such as those of its storey
    body_band  heights that its body has itself
    etag  names this state of it: `change_instance` with it is refused where another was faster
    """

    pose: Pose | None
    footprint: Shape | None
    band: Band | None
    body_band: Band | None
    joins: tuple[Named, ...]
    has_body: bool
    attributes: Mapping[str, Any]
    created_at: Stamp
    updated_at: Stamp
    etag: str = ""


@dataclass(frozen=True)
class Feature:
    """A thing with its shape; None where it has none."""

    uid: UUID
    name: str
    alias: str | None
    concept: str
    storey: str | None
    attributes: Mapping[str, Any]
    geometry: Shape | None


@dataclass(frozen=True)
class Whereabouts:
    """Where an instance is or was; `rooms` contain it, the smallest first. `at` None: now."""

    instance: Named
    map: str
    at: Stamp | None
    pose: Pose | None
    rooms: tuple[Named, ...]


@dataclass(frozen=True)
class Extent:
    """The first and the last stamp of what is known; None where nothing is."""

    first: Stamp | None
    last: Stamp | None


@dataclass(frozen=True)
class RouteStep:
    """A room on the way, the door by which it is entered, and the way to that door [m]."""

    room_id: int
    room: str
    door_id: int | None
    door: str | None
    length_m: float


@dataclass(frozen=True)
class Part:
    """Rooms between which there are ways: how many, names of 20, and the storeys that they are on."""

    rooms: int
    names: tuple[str, ...]
    storeys: tuple[str, ...]


@dataclass(frozen=True)
class Gap:
    """Why there is no way: the part of the building where it begins, and that where it ends."""

    reason: str
    start: Part
    end: Part


@dataclass(frozen=True)
class Route:
    """The shortest way through doors, openings, stairs and lifts; `length_m` is None where there is none.

    line  x, y and, where it is known, z [m] of each place that it passes
    gap   where there is none: which parts of the building are not connected
    """

    length_m: float | None
    steps: tuple[RouteStep, ...]
    line: tuple[tuple[float, ...], ...]
    gap: Gap | None = None


@dataclass(frozen=True)
class Occupant:
    """Someone in a room, and since when."""

    track_id: int
    name: str
    since: Stamp


@dataclass(frozen=True)
class TrackState:
    """Where a track is; what its source does not know is None."""

    stamp: Stamp
    x_m: float
    y_m: float
    z_m: float | None
    std_m: float | None
    heading_rad: float | None
    speed_mps: float | None
    length_m: float | None
    width_m: float | None
    std_across_m: float | None = None
    std_yaw_rad: float | None = None


@dataclass(frozen=True)
class Track:
    """Someone or something that a source follows.

    concept  None: nobody said what it is
    """

    id: int
    uid: UUID
    map: str
    source: str
    name: str
    live: bool
    ended_at: Stamp | None
    state: TrackState | None
    concept: str | None = None
    attributes: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Relation:
    """A subject is related to an object, as a continuous query sees it: a track or an instance each.

    until        None while it holds
    duration_s   how long it held; None while it holds
    probability  how probable it is now; None where the query asks for no certainty
    """

    map: str
    query: str
    track_id: int | None
    track: str | None
    subject_instance_id: int | None
    subject_instance: str | None
    instance_id: int | None
    instance: str | None
    object_track_id: int | None
    object_track: str | None
    since: Stamp
    until: Stamp | None
    duration_s: float | None
    probability: float | None


@dataclass(frozen=True)
class Evidence:
    """A row that an event rests on; `variable` is that of the rule's pattern."""

    uid: UUID
    variable: str
    source: str
    stamp: Stamp


@dataclass(frozen=True)
class FoundEvent:
    """An event as a rule finds it, whether or not it was written."""

    event_id: UUID
    type: str
    stamp: Stamp
    since: Stamp
    track: Named | None
    instance: Named | None
    key: Mapping[str, Any]
    measures: Mapping[str, Any]
    confidence: float | None
    evidence: tuple[Evidence, ...]


@dataclass(frozen=True)
class Event(FoundEvent):
    """An event of the log. `seq` is its number, which is the cursor; numbers rise, with gaps."""

    seq: int
    map: str
    rule: str
    rule_version: int
    cause: str | None
    by_batch: bool
    verdict: str | None
    amended_by: UUID | None


@dataclass(frozen=True)
class ObjectState:
    """A property of an instance has a value from a stamp on."""

    id: int
    uid: UUID
    map: str
    source: str
    instance_id: int
    instance: str
    property: str
    value: str
    previous: str | None
    stamp: Stamp
    attributes: Mapping[str, Any]


@dataclass(frozen=True)
class NewObjectState:
    """What is told of an object: a property of an instance has a value from an aware stamp on."""

    instance: str
    property: str
    value: str
    stamp: datetime
    attributes: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class GivenUp:
    """Where a rule began to give up, as too much was under way in one key: what begins later may lack."""

    first: Stamp
    key: Mapping[str, Any]


@dataclass(frozen=True)
class Rule:
    """A rule: which events are made of what; `version` rises with each change of the declaration."""

    id: int
    map: str
    name: str
    version: int
    queries: tuple[str, ...]
    declaration: Mapping[str, Any]
    enabled: bool
    backfill_from: Stamp | None
    given_up: GivenUp | None = None


@dataclass(frozen=True)
class DryRun:
    """What a rule would have found in stored history: how many events, and the first thousand of them."""

    count: int
    events: tuple[FoundEvent, ...]
    given_up: GivenUp | None = None


@dataclass(frozen=True)
class Explanation:
    """Why a rule found something, or how far it came."""

    found: bool
    lines: tuple[str, ...]

    def __str__(self) -> str:
        return "\n".join(self.lines)


@dataclass(frozen=True)
class Parameter:
    """A parameter of an operator."""

    name: str
    kind: str
    answers: str
    required: bool
    default: Any
    choices: tuple[str, ...]


@dataclass(frozen=True)
class Operator:
    """A question of space: what it answers, takes and gives."""

    name: str
    answers: str
    function: str
    takes_references: bool
    takes_targets: bool
    edits: bool
    parameters: tuple[Parameter, ...]
    columns: tuple[str, ...]


@dataclass(frozen=True)
class Selection:
    """Instances of a map that meet all that is given; `filter` is CQL2, as text or JSON."""

    ids: tuple[int, ...] | None = None
    names: tuple[str, ...] | None = None
    concept: str | None = None
    attributes: Mapping[str, Any] | None = None
    filter: str | Mapping[str, Any] | None = None


@dataclass(frozen=True)
class Finding:
    """What an import did to what, and why; `action` is repaired, skipped or note."""

    action: str
    subject: str
    reason: str


@dataclass(frozen=True)
class ImportReport:
    """What an import brought into a map: how many instances of each concept."""

    map: str
    concepts: Mapping[str, int]
    findings: tuple[Finding, ...]


@dataclass(frozen=True)
class Job:
    """Work that goes on after its request was answered; `progress` from 0 to 1."""

    job_id: Any
    kind: str
    state: Literal["waiting", "running", "done", "failed", "cancelled"]
    progress: float
    message: str | None
    result: Mapping[str, Any] | None
    problem: Mapping[str, Any] | None
    created_at: Stamp
    finished_at: Stamp | None

    @property
    def is_over(self) -> bool:
        return self.state in ("done", "failed", "cancelled")
