"""/rules/dry-run, /rules/{id}/explanation, /rules/{id}/certificate"""

from __future__ import annotations

import time
from collections.abc import Callable, Coroutine
from typing import Annotated, Any
from uuid import UUID

from anyio import from_thread
from fastapi import APIRouter, Query
from fastapi import Request as Connected
from pydantic import Field

from semap.errors import TooLarge
from semap.model.given_up import GivenUp
from semap.rules.language.reading import parse_declaration
from semap.store.database.connection import driver_of
from semap.store.event.rules import get_rule
from semap.store.map.maps import get_map
from semap.worker import past, why
from semap_service.database.transaction import Database, Everywhere, on_whole_map, transaction
from semap_service.documents.document import (
    Document,
    InStamp,
    Name,
    Request,
    SmallId,
    Stamp,
    require_order,
)
from semap_service.documents.event import EventInstance, EventTrack, EvidenceDocument
from semap_service.documents.rule import Declaration, GivenUpDocument
from semap_service.http.problem import problems

router = APIRouter(tags=["rules"])

MOST_ROWS = 200_000
MOST_EVENTS = 1000
MOST_MADE = 100_000
LONGEST_S = 20.0
"""A dry run that takes longer is ended: others want to be answered, too."""

LOOK_S = 0.2
"""How often it is looked whether the caller of a dry run is still there."""


class DryRun(Request):
    """A rule, and the stored history that it is to run over."""

    map: Name = Field(examples=["office"])
    name: Name = Field(default="dry_run", description="Part of the events' identity.")
    declaration: Declaration
    start: InStamp | None = Field(default=None, alias="from", description="From then on; without it, all.")
    end: InStamp | None = Field(default=None, alias="to", description="Before then.")


class DryEventDocument(Document):
    """An event as it would be made."""

    event_id: UUID
    type: str
    stamp: Stamp
    since: Stamp
    track: EventTrack | None
    instance: EventInstance | None
    key: dict[str, Any]
    measures: dict[str, Any]
    confidence: float | None = Field(ge=0, le=1)
    evidence: list[EvidenceDocument]


class DryRunAnswer(Document):
    count: int = Field(description="How many events there would be.")
    events: list[DryEventDocument] = Field(description=f"The first {MOST_EVENTS} of them, in their order.")
    given_up: GivenUpDocument | None = Field(
        description="null: all that there is was found. Else too much was under way in one key at once."
    )


class ExplanationDocument(Document):
    """Why there was an event, or why there was none."""

    found: bool = Field(description="Whether the rule matched around that moment.")
    lines: list[str] = Field(
        description="The rows, and what each condition came to; else how far it came, and why not on.",
        examples=[["it found opened_then_entered at 2026-01-31T12:00:04Z."]],
    )


@router.post("/rules/dry-run", operation_id="dry_run_rule", responses=problems(404, 413))
def dry_run_rule(shards: Everywhere, wanted: DryRun, connected: Connected) -> DryRunAnswer:
    """Run a rule over stored history and give the events that it would have made; nothing is written.
    It ends when the caller goes away.

    At most 200,000 rows are read, 100,000 events made, and 20 s spent: narrow `from` and `to` beyond that.
    """
    declared = parse_declaration({**wanted.declaration, "name": wanted.name})
    given_up: list[GivenUp] = []
    with transaction(shards.of_map(wanted.map)) as connection:
        get_map(connection, wanted.map)
        on_whole_map(connection)
        events = past.dry_run(
            driver_of(connection),
            wanted.map,
            declared,
            wanted.start,
            wanted.end,
            MOST_ROWS,
            _patience(connected.is_disconnected),
            lambda _, what: given_up.append(what),
        )
    return DryRunAnswer(
        count=len(events),
        events=[DryEventDocument.model_validate(event) for event in events[:MOST_EVENTS]],
        given_up=GivenUpDocument.model_validate(given_up[0]) if given_up else None,
    )


@router.get("/rules/{id}/explanation", operation_id="explain_rule", responses=problems(404, 413))
def explain_rule(
    database: Database,
    id: SmallId,  # noqa: A002
    at: Annotated[InStamp, Query(description="The moment.")],
    key: Annotated[
        list[str] | None,
        Query(description="For each property of `partition_by` name=value.", examples=[["room=Room07"]]),
    ] = None,
) -> ExplanationDocument:
    """Say why a rule matched around a moment, or how far it came and which condition failed."""
    named = dict(each.partition("=")[::2] for each in key or ())
    with transaction(database) as connection:
        rule = get_rule(connection, id)
        on_whole_map(connection)
        declared = parse_declaration(rule.declaration, rule.name)
        found = why.explain(driver_of(connection), rule.map, declared, at, named, most_rows=MOST_ROWS)
    lines = found.as_text().splitlines()
    if rule.given_up is not None:
        lines.append(f"Since version {rule.version} is in force: {rule.given_up.as_text()}")
    return ExplanationDocument(found=found.match is not None, lines=lines)


class CertificateDocument(Document):
    """What a rule found in a span, and how far it came, with all that this rests on. Instants are in us.

    `semap rule verify` checks it by itself, as does `python -m semap.certificate FILE`; no engine.
    """

    certificate: int = Field(description="Version of this form.", examples=[1])
    map: str
    version: int = Field(description="Of the rule.")
    rule: dict[str, Any] = Field(description="Its name and clauses.")
    key: dict[str, str] = Field(description="Only keys with these names; empty: all.")
    from_us: int = Field(description="What is claimed is all that meets this span, both ends included.")
    until_us: int
    known_us: int = Field(description="Up to here all rows of these keys are listed.")
    streams: list[dict[str, Any]] = Field(
        description="For each key in which there was something its ids and its rows, from where they count."
    )
    events: list[dict[str, Any]] = Field(
        description="The events, each with its rows by variable and uid, and its measures."
    )
    attempts: list[dict[str, Any]] = Field(
        description="Those that came to nothing, the furthest first, each with what it waited for, and the"
        " row or the silence that ended it."
    )
    other_attempts: int = Field(description="Those that came no further than these.")


@router.get("/rules/{id}/certificate", operation_id="certify_rule", responses=problems(404, 413))
def certify_rule(
    database: Database,
    id: SmallId,  # noqa: A002
    start: Annotated[InStamp, Query(alias="from", description="From then on.")],
    end: Annotated[
        InStamp | None, Query(alias="to", description="To then, included. [default: the moment `from` alone]")
    ] = None,
    key: Annotated[
        list[str] | None,
        Query(
            description="Properties of `partition_by` as name=value; of all keys without.",
            examples=[["room=Room07"]],
        ),
    ] = None,
) -> CertificateDocument:
    """What a rule found in a span of time, over all keys or some, and why not more, to be verified."""
    end = start if end is None else end
    require_order(start, end)
    named = dict(each.partition("=")[::2] for each in key or ())
    with transaction(database) as connection:
        rule = get_rule(connection, id)
        on_whole_map(connection)
        declared = parse_declaration(rule.declaration, rule.name)
        span = start, end
        found = why.certify(driver_of(connection), rule.map, declared, span, named, rule.version, MOST_ROWS)
    return CertificateDocument.model_validate(found)


def _patience(is_gone: Callable[[], Coroutine[Any, Any, bool]]) -> Callable[[int], None]:
    """Ends a run that makes too much, takes too long, or that nobody waits for any more, with TooLarge."""
    until_s = time.monotonic() + LONGEST_S
    look_s = 0.0

    def watch(count: int) -> None:
        nonlocal look_s
        if count > MOST_MADE:
            raise TooLarge(f"It makes more than {MOST_MADE} events.", "Choose a shorter span, or skip more.")
        if time.monotonic() > until_s:
            raise TooLarge(f"It takes longer than {LONGEST_S:g} s.", "Choose a shorter span.")
        if time.monotonic() < look_s:
            return
        look_s = time.monotonic() + LOOK_S
        if from_thread.run(is_gone):
            raise TooLarge("Whoever asked has gone.", "Wait for the answer.")

    return watch
