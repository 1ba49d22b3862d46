"""Takes what clients send of tracks: read, sifted, and written in one transaction with its sequence number.

The number is the client's position, and is kept as those of bridges are: a message that comes again is passed
over, and of two clients that count for one source the second is told so.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError
from semap_ingest.named_states import NamedStates, Refused, sifted, without_repeats
from semap_ingest.state_intake import Said, StateIntake, Taken
from semap_ingest.state_json import states_of
from sqlalchemy import Connection, Engine

from semap.errors import Conflict, InvalidInput
from semap.store.database.connection import translated
from semap.store.motion.bridges import Place, move_position, read_position
from semap.timeline.stamp import EARLIEST, LATEST, to_us
from semap_service.documents.document import InStamp, Name
from semap_service.documents.json_values import require_few_values
from semap_service.documents.state import TOLD, RefusedState, TakenStates
from semap_service.documents.state import Sequence as Number

T = TypeVar("T")

NAME: TypeAdapter[Any] = TypeAdapter(Name)
NUMBER: TypeAdapter[Any] = TypeAdapter(Number)
STAMP: TypeAdapter[Any] = TypeAdapter(InStamp)
KNOWN = ("sequence", "watermark", "states")


@dataclass(frozen=True)
class Message:
    """States of one source, read.

    count  how many were sent, also those that cannot be read
    """

    source: str
    states: NamedStates
    refused: Sequence[Refused]
    sequence: int | None
    watermark_us: int | None


def read_message(body: bytes, source: str | None = None) -> Message:
    """A JSON document of states.

    source  of a socket, whose messages do not say it
    raises  InvalidInput where the whole is none; TooLarge
    """
    require_few_values(body)
    try:
        document = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise InvalidInput(
            f"not JSON: {error}", "Send a JSON document; see /openapi.json.", "body"
        ) from error
    if not isinstance(document, dict) or "states" not in document:
        raise InvalidInput("there are no states", 'Send {"source": ..., "states": [...]}.', "body")
    known = [*KNOWN, "source" if source is None else "type"]
    unknown = sorted(document.keys() - set(known))
    if unknown:
        raise InvalidInput(f"unknown: {', '.join(unknown[:3])}", f"Known are {', '.join(known)}.", "body")
    states, refused = states_of(document["states"])
    return Message(
        _checked(NAME, document.get("source"), "source") if source is None else source,
        states,
        refused,
        _checked(NUMBER, document.get("sequence"), "sequence"),
        watermark_us(_checked(STAMP, document.get("watermark"), "watermark")),
    )


def watermark_us(said: datetime | None) -> int | None:
    """raises InvalidInput for one that cannot be kept"""
    if said is not None and not EARLIEST <= said < LATEST:
        raise InvalidInput(f"the stamp {said.isoformat()}", "Give one from 1800 to 9998.", "watermark")
    return None if said is None else to_us(said)


def _checked(kind: TypeAdapter[Any], value: object, where: str) -> Any:
    if value is None and kind is not NAME:
        return None
    try:
        return kind.validate_json(json.dumps(value), strict=True)
    except ValidationError as error:
        raise InvalidInput(error.errors()[0]["msg"], "See /openapi.json.", where) from error


class StateTaking:
    """Mutable: what is known of the tracks of a map, for one client at a time.

    engine  of connections as semap_ingest; whoever asks for the map was found to see it
    """

    def __init__(self, engine: Engine, map_name: str) -> None:
        self._engine = engine
        self._intake = self._ask(lambda c: StateIntake(c, map_name))

    def last(self, source: str) -> int:
        """The last sequence number of a source; 0 where there was none."""
        return self._ask(lambda c: self._last(c, source))

    def take(self, message: Message, after: int | None = None) -> TakenStates:
        """Write what can be written.

        after   the number after which a client counts that is alone with its source; None: that is not known
        raises  Conflict where somebody else counts for the source, too
        """
        good, flawed = sifted(message.states, to_us(datetime.now(UTC)))
        states, repeated = without_repeats(good)
        said = Said(message.source, states, watermark_us=message.watermark_us)
        try:
            taken: Taken | None = self._put(self._intake.write, said, message.sequence, after)
        except (Conflict, InvalidInput):
            taken = self._again(said, message.sequence, after)
        if taken is None:
            return _answer(Taken(), message, repeated=True)
        return _answer(
            replace(taken, refused=[*message.refused, *flawed, *repeated, *taken.refused]), message
        )

    def _again(self, said: Said, sequence: int | None, after: int | None) -> Taken | None:
        """Write what can be; None where it has been taken already."""
        last = 0 if sequence is None else self.last(said.source)
        if after is not None and last != after:
            raise Conflict(
                "Another client counts for this source, too.", "Give each client a source of its own."
            )
        if sequence is not None and sequence <= last:
            return None
        self._intake.forget()
        return self._put(self._intake.write_some, said, sequence, after)

    def _put(
        self,
        write: Callable[[Connection, Sequence[Said]], list[Taken]],
        said: Said,
        sequence: int | None,
        after: int | None,
    ) -> Taken:
        """raises Conflict where it has been taken already"""
        if not self._intake.is_prepared(said):
            self._ask(lambda c: self._intake.prepare(c, said))

        def work(connection: Connection) -> Taken:
            (taken,) = write(connection, [said])
            if sequence is not None:
                last = self._last(connection, said.source) if after is None else after
                if sequence <= last:
                    raise Conflict("It was taken already.")
                was = {"sequence": last} if last else None
                move_position(connection, self._place(said.source), was, {"sequence": sequence})
            return taken

        return self._ask(work)

    def _last(self, connection: Connection, source: str) -> int:
        found = read_position(connection, self._place(source))
        return 0 if found is None else int(str(found["sequence"]))

    def _place(self, source: str) -> Place:
        return Place(self._intake.map_id, source, "client")

    def _ask(self, question: Callable[[Connection], T]) -> T:
        with translated(), self._engine.begin() as connection:
            return question(connection)


def _answer(taken: Taken, message: Message, *, repeated: bool = False) -> TakenStates:
    refused = sorted(taken.refused, key=lambda each: each.index)
    return TakenStates(
        accepted=taken.stored,
        repeated=repeated,
        sequence=message.sequence,
        late=len(taken.late),
        late_indexes=taken.late[:TOLD],
        refused=len(refused),
        refusals=[RefusedState.model_validate(each) for each in refused[:TOLD]],
    )
