"""/rules/dry-run, /rules/{id}/explanation"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Annotated, Any

import psycopg
from fastapi import APIRouter, Query
from pydantic import Field
from sqlalchemy import Connection

from semap.errors import TooLarge
from semap.model.event import Event
from semap.model.given_up import GivenUp
from semap.rules.language.reading import parse_declaration
from semap.store.maps import get_map
from semap.store.rules import get_rule
from semap.worker import past, why
from semap_service.database.transaction import Database, on_whole_map, transaction
from semap_service.documents.document import Document, InStamp, Name, Request, SmallId, Stamp
from semap_service.documents.event import EventInstance, EventTrack, EvidenceDocument
from semap_service.documents.rule import Declaration, GivenUpDocument
from semap_service.http.problem import problems

router = APIRouter(tags=["rules"])

MOST_ROWS = 200_000
MOST_EVENTS = 1000
MOST_MADE = 100_000
LONGEST_S = 20.0
"""A dry run that takes longer is ended: others want to be answered, too."""


class DryRun(Request):
    """A rule, and the stored history that it is to run over."""

    map: Name = Field(examples=["office"])
    name: Name = Field(default="dry_run", description="Part of the events' identity.")
    declaration: Declaration
    start: InStamp | None = Field(default=None, alias="from", description="From then on; without it, all.")
    end: InStamp | None = Field(default=None, alias="to", description="Before then.")


class DryEventDocument(Document):
    """An event as it would be made."""

    event_id: str
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
def dry_run_rule(database: Database, wanted: DryRun) -> DryRunAnswer:
    """Run a rule over stored history and give the events that it would have made; nothing is written.

    At most 200,000 rows are read, 100,000 events made, and 20 s spent: narrow `from` and `to` beyond that.
    """
    declared = parse_declaration({**wanted.declaration, "name": wanted.name})
    given_up: list[GivenUp] = []
    with transaction(database) as connection:
        get_map(connection, wanted.map)
        on_whole_map(connection)
        events = past.dry_run(
            _psycopg(connection),
            wanted.map,
            declared,
            wanted.start,
            wanted.end,
            MOST_ROWS,
            _patience(),
            lambda _, what: given_up.append(what),
        )
    return DryRunAnswer(
        count=len(events),
        events=[_document(event) for event in events[:MOST_EVENTS]],
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
        found = why.explain(_psycopg(connection), rule.map, declared, at, named, most_rows=MOST_ROWS)
    lines = found.as_text().splitlines()
    if rule.given_up is not None:
        lines.append(f"Since version {rule.version} is in force: {rule.given_up.as_text()}")
    return ExplanationDocument(found=found.match is not None, lines=lines)


def _patience() -> Callable[[int], None]:
    """Ends a run that makes too much, or takes too long, with TooLarge."""
    until_s = time.monotonic() + LONGEST_S

    def watch(count: int) -> None:
        if count > MOST_MADE:
            raise TooLarge(f"It makes more than {MOST_MADE} events.", "Choose a shorter span, or skip more.")
        if time.monotonic() > until_s:
            raise TooLarge(f"It takes longer than {LONGEST_S:g} s.", "Choose a shorter span.")

    return watch


def _psycopg(connection: Connection) -> psycopg.Connection:
    """The driver's connection, in the same transaction."""
    driver: psycopg.Connection = connection.connection.driver_connection  # type: ignore[assignment]
    return driver


def _document(event: Event) -> DryEventDocument:
    track = instance = None
    if event.track_id is not None:
        track = EventTrack(id=event.track_id, name=event.track_name or "")
    if event.instance_id is not None:
        instance = EventInstance(id=event.instance_id, name=event.instance_name or "")
    return DryEventDocument(
        event_id=str(event.event_id),
        type=event.type,
        stamp=event.stamp,
        since=event.since,
        track=track,
        instance=instance,
        key=dict(event.key),
        measures=dict(event.measures),
        confidence=event.confidence,
        evidence=[EvidenceDocument.model_validate(each) for each in event.evidence],
    )
