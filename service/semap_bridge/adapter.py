"""What an adapter is: one file that says how semap is connected with one kind of peer.

An adapter is a connection to its peer, from when it is opened until it is lost or closed; after a loss it is
made anew. It has up to three roles. A source yields what comes in, a sink is given what happens, and a
display is shown how things stand every so often. The core does the rest: it writes states, watermark and
position in one transaction, keeps cursors, waits for whoever is away, and counts what was lost or cannot be
used.

An adapter raises ServiceUnreachable, with a remedy, where its peer cannot be reached, refuses it, or went
away: the core says so once, waits, and makes it again. What it raises else of semap's errors ends the bridge.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field
from semap_ingest.named_states import MOST_AHEAD_S, NO_STATES, NamedStates, Refused
from sqlalchemy import Connection

from semap.model.object_state import NewObjectState
from semap.store.event.cloud_event import (
    cloud_event,
    cloud_event_json,
    event_json,
    written,
)
from semap.store.event.events import StoredEvent
from semap.store.motion.bridges import Position
from semap.store.motion.live import LiveMap
from semap.store.relation.changes import StoredChange
from semap_bridge.change_event import change_cloud_event
from semap_bridge.context import Context
from semap_bridge.given_out import ChangeFilter, EventFilter

Name = Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[^\x00/]*$")]


class Settings(BaseModel):
    """What every bridge of a config may say; an adapter adds its own."""

    model_config = ConfigDict(extra="forbid", frozen=True, hide_input_in_errors=True, allow_inf_nan=False)

    name: Name = Field(description="Of the bridge: one of a name runs for each map.")
    kind: str = Field(description="The adapter: see semap bridge kinds.")
    source: Name | None = Field(default=None, description="Source of the states. [default: the name]")
    concept: Name | None = Field(default=None, description="What kind of thing its tracks are.")
    ahead_s: float = Field(
        default=MOST_AHEAD_S, ge=0, description="Stamps further ahead of this clock are refused [s]."
    )
    behind_s: float | None = Field(
        default=None, gt=0, description="Stamps further behind this clock are refused [s]. [default: none]"
    )
    queue: int = Field(
        default=50_000,
        ge=1,
        description="So many records of a live source wait while the database is slow; then the oldest are"
        " dropped, and counted.",
    )
    from_start: bool = Field(
        default=False, description="Give out the events of the past, too, when it runs for the first time."
    )
    filter: EventFilter | None = Field(
        default=None, description="CQL2: only events that it fits are given out. [default: all]"
    )
    changes_filter: ChangeFilter | None = Field(
        default=None, description="CQL2: only changes of relations that it fits are given out. [default: all]"
    )


S = TypeVar("S", bound=Settings)


@dataclass(frozen=True)
class Batch:
    """What came in together.

    states        of tracks by name, in the map frame
    objects       states of objects, such as doors, by the names of instances
    ended         tracks that ended without a last state, each with when [us since 1970]
    refused       records that could not be read, with the reason
    watermark_us  no state up to it is to come after these [us since 1970]; None: the source says none
    position      where its source is after it; None: what comes live and cannot be read again
    source        name of the source of these states, if it is not that of the bridge
    also          writes what else belongs to it, in the same transaction
    """

    states: NamedStates = NO_STATES
    objects: Sequence[NewObjectState] = ()
    ended: Sequence[tuple[str, int]] = ()
    refused: Sequence[Refused] = ()
    watermark_us: int | None = None
    position: Position | None = None
    source: str | None = None
    also: Callable[[Connection], None] | None = None

    @property
    def records(self) -> int:
        """How many it has."""
        return len(self.states) + len(self.objects) + len(self.ended) + len(self.refused)

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to write of it."""
        return not (self.states or self.objects or self.ended or self.also) and (
            self.watermark_us is None and self.position is None
        )

    def __len__(self) -> int:
        """Its length in a queue: 1 at least, so that a queue of them has an end."""
        return max(1, self.records)


@dataclass(frozen=True)
class Sight:
    """What an adapter sees of its peer, for `semap bridge check`.

    what     such as the name of a topic
    is_a     such as its type
    rate_hz  None where that says nothing
    trouble  what is wrong with it; empty: nothing
    """

    what: str
    is_a: str = ""
    rate_hz: float | None = None
    trouble: str = ""
    remedy: str = ""


@dataclass(frozen=True)
class Happening:
    """An event, or a change of a relation, that is given out.

    number  its place among all of its kind, which rises, with gaps: a cursor
    """

    number: int
    made: StoredEvent | StoredChange

    @property
    def event(self) -> StoredEvent:
        """What a sink of events is given; raises TypeError for a change."""
        if isinstance(self.made, StoredChange):
            raise TypeError("This is a change of a relation.")
        return self.made

    def cloud_event(self) -> dict[str, Any]:
        """As a CloudEvent, a value for JSON."""
        if isinstance(self.made, StoredChange):
            return change_cloud_event(self.made)
        return cloud_event(self.made)

    def cloud_event_json(self) -> bytes:
        """As a CloudEvent, JSON in UTF-8 without a line break."""
        if isinstance(self.made, StoredChange):
            return written(change_cloud_event(self.made))
        return cloud_event_json(self.made, event_json(self.made))


class Source(ABC):
    """Yields what comes in."""

    @abstractmethod
    def batches(self, position: Position | None) -> AsyncIterator[Batch]:
        """What comes in after a position, until the peer is done or is lost.

        position  that of the last batch that was committed; None: from the beginning, or of a live source
        """

    async def committed(self, position: Position) -> None:  # noqa: B027  (most need not know)
        """All up to a position is stored for good, and may be acknowledged."""


class Sink(ABC):
    """Is given what happens, in the order of numbers.

    cursor_at  database: the core keeps the cursor once `deliver` has returned, so that each event is given
               out at least once; broker: the sink writes the cursor with the events, and reads it back
    """

    cursor_at: ClassVar[Literal["database", "broker"]] = "database"

    async def cursor(self) -> int | None:
        """Where the broker has it: the number of the last event that was delivered; None where none was."""
        return None

    @abstractmethod
    async def deliver(self, happenings: Sequence[Happening]) -> None:
        """Give events out; returns when the peer has them for good."""


class Display(ABC):
    """Is shown the present of the map.

    every_s  how often, at most
    """

    every_s: float = 1.0

    @abstractmethod
    async def show(self, present: LiveMap) -> None:
        """Show who is where, and how doors stand."""


class Adapter(ABC, Generic[S]):
    """A connection to a peer; what it has of the roles Source, Sink and Display the core plays with it."""

    Settings: ClassVar[type[Settings]] = Settings

    def __init__(self, settings: S, context: Context) -> None:
        self.settings = settings
        self.context = context

    async def open(self) -> None:
        """Connect; raises ServiceUnreachable."""

    async def close(self) -> None:
        """Let go of everything; called once after `open`, also where that failed."""

    def source(self) -> Source | None:
        """The role of a source, where the settings want it."""
        return self if isinstance(self, Source) else None

    def sink(self) -> Sink | None:
        return self if isinstance(self, Sink) else None

    def changes(self) -> Sink | None:
        """A sink that is given changes of relations in place of events, with a cursor of its own."""
        return None

    def display(self) -> Display | None:
        return self if isinstance(self, Display) else None

    async def look(self, seconds: float) -> Sequence[Sight]:
        """What there is to see within so many seconds, beside what the source yields; writes nothing."""
        return ()
