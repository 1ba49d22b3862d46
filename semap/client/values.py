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

from semap.model.event import Evidence, Named
from semap.model.given_up import GivenUp
from semap.model.object_state import NewObjectState, ObjectState
from semap.model.relation import Occupant
from semap.model.route import Gap, Part, Route, RouteStep
from semap.model.selection import Selection
from semap.model.track_state import Seen

__all__ = [
    "Evidence",
    "Gap",
    "GivenUp",
    "Named",
    "NewObjectState",
    "ObjectState",
    "Occupant",
    "Part",
    "Route",
    "RouteStep",
    "Selection",
]
"""Nouns that the store, the service and its clients share."""


def _in_utc(stamp: datetime) -> datetime:
    return stamp.astimezone(UTC)


Stamp = Annotated[AwareDatetime, AfterValidator(_in_utc)]

Shape = Mapping[str, Any]
"""A GeoJSON geometry, in metres instead of degrees."""


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
class TrackState(Seen):
    """Where a track is; what its source does not know is None."""


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
class RefusedState:
    """A state that was not taken: its place among those sent, why, and in detail."""

    index: int
    reason: str
    detail: str


@dataclass(frozen=True)
class TakenStates:
    """What came of the states of one message.

    sequence      its number; None where it was sent without one
    late          how many of the accepted came after later ones of their track; late_indexes: the first 20
    refused       how many were not taken; refusals: the first 20
    """

    sequence: int | None
    accepted: int
    late: int
    late_indexes: tuple[int, ...]
    refused: int
    refusals: tuple[RefusedState, ...]


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
