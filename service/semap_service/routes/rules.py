"""/rules"""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal

from fastapi import APIRouter, Response
from pydantic import Field
from sqlalchemy import Connection

from semap.errors import InvalidInput
from semap.rules.language.reading import parse_declaration
from semap.store.event import rules
from semap.store.map.maps import get_map
from semap_service.database import rule_edit as rule_editing
from semap_service.database.rule_edit import ALL
from semap_service.database.transaction import Database, Edit, Write, transaction
from semap_service.documents.document import (
    LARGEST_SMALL_ID,
    After,
    Document,
    InStamp,
    Limit,
    MapFilter,
    Name,
    Next,
    Request,
    SmallId,
    Stamp,
    next_after,
    stored,
)
from semap_service.documents.rule import Declaration, GivenUpDocument
from semap_service.http.etag import TaggedRoute, edits, reads
from semap_service.http.problem import problems

router = APIRouter(tags=["rules"], route_class=TaggedRoute)

Backfill = Annotated[
    InStamp | Literal["all"] | None,
    Field(
        description="Run over what was stored from this stamp on (`all`: over everything) as well, as if the"
        " rule had been there; without it, it is for what happens from now on.",
        examples=["all"],
    ),
]


class RuleDocument(Document):
    """A rule: which events are made of what."""

    id: int = stored("rule_id")
    map: str = Field(examples=["office"])
    name: str = Field(examples=["room_visits"])
    version: int = Field(description="Rises with each change of the declaration.")
    queries: list[str] = Field(
        description="The continuous queries that it reads.", examples=[["track_in_room"]]
    )
    declaration: Declaration
    enabled: bool
    backfill_from: Stamp | None = Field(
        description="From when on this version runs over what was stored before it; null: it does not."
    )
    given_up: GivenUpDocument | None = Field(
        description="null: nothing was lost since this version is in force. Else give the rule a window,"
        " a finer `partition_by`, or an `after_match` that skips more."
    )


class RuleList(Document):
    rules: list[RuleDocument] = Field(description="In the order of their ids.")
    next: Next


class RuleVersionDocument(Document):
    """A version of a rule, and since when it is valid."""

    version: int
    name: str
    declaration: Declaration
    declared_at: Stamp


class RuleVersionList(Document):
    versions: list[RuleVersionDocument] = Field(description="In their order.")
    next: Next


class NewRule(Request):
    """A rule for new events, and optionally for the past."""

    map: Name = Field(examples=["office"])
    name: Name = Field(examples=["room_visits"])
    declaration: Declaration
    backfill_from: Backfill = None


class RuleChanges(Request):
    """The changes; omitted members stay unchanged."""

    enabled: bool | None = None
    declaration: Declaration | None = None
    backfill_from: Backfill = None


@router.get("/rules", operation_id="list_rules", responses=reads(404))
def list_rules(
    database: Database, map_name: MapFilter = None, limit: Limit = 100, after: After = 0
) -> RuleList:
    """Rules: which events are made."""
    with transaction(database) as connection:
        if map_name is not None:
            get_map(connection, map_name)
        found = rules.list_rules(connection, map_name=map_name, after=after, limit=limit)
    return RuleList(
        rules=[RuleDocument.model_validate(each) for each in found],
        next=next_after([each.rule_id for each in found], limit),
    )


@router.post("/rules", operation_id="add_rule", status_code=201, responses=problems(404, 409))
def add_rule(write: Write, new: NewRule, response: Response) -> RuleDocument:
    """Add a rule: it makes events from now on, and with `backfill_from` over stored history.

    A name in `input` is looked up among the queries of the map, then among its rules; any other is a property
    of objects. Rules that would read one another in a circle are refused.
    """
    declared = parse_declaration({**new.declaration, "name": new.name})
    with write.to(new.map).begin() as connection:
        made = rule_editing.add_rule(connection, new.map, declared, _stamp(new.backfill_from))
    response.headers["Location"] = f"/rules/{made.rule_id}"
    return RuleDocument.model_validate(made)


@router.get("/rules/{id}", operation_id="get_rule", responses=reads(404))
def get_rule(database: Database, id: SmallId) -> RuleDocument:  # noqa: A002
    """A rule."""
    with transaction(database) as connection:
        return _read(connection, id)


@router.patch("/rules/{id}", operation_id="change_rule", responses=edits(404, 409))
def change_rule(edit: Edit, id: SmallId, changes: RuleChanges) -> RuleDocument:  # noqa: A002
    """Enable or disable a rule, or replace its declaration.
    A declaration is a new version. It applies from now on, and with `backfill_from` to stored history, too.
    """
    if changes.declaration is None and changes.backfill_from is not None:
        raise InvalidInput(
            "a stamp without a declaration", "Give the declaration that is to run.", "backfill_from"
        )
    with edit.begin(lambda connection: _read(connection, id)) as connection:
        rule = rules.get_rule(connection, id)
        if changes.declaration is not None:
            declared = parse_declaration(changes.declaration, rule.name)
            rule = rule_editing.replace_rule(connection, id, declared, _stamp(changes.backfill_from))
        if changes.enabled is not None:
            rule = rules.enable_rule(connection, id, changes.enabled)
    return RuleDocument.model_validate(rule)


@router.get("/rules/{id}/versions", operation_id="list_rule_versions", responses=reads(404))
def list_rule_versions(
    database: Database,
    id: SmallId,  # noqa: A002
    limit: Limit = 100,
    after: After = 0,
) -> RuleVersionList:
    """The versions of a rule, from the first on."""
    with transaction(database) as connection:
        found = rules.list_versions(connection, id, after=min(after, LARGEST_SMALL_ID), limit=limit)
    return RuleVersionList(
        versions=[RuleVersionDocument.model_validate(each) for each in found],
        next=next_after([each.version for each in found], limit),
    )


@router.delete("/rules/{id}", operation_id="delete_rule", status_code=204, responses=edits(404, 409))
def delete_rule(edit: Edit, id: SmallId) -> None:  # noqa: A002
    """Delete a rule; the events that it made stay. One whose events other rules read is refused."""
    with edit.begin(lambda connection: _read(connection, id)) as connection:
        rule_editing.delete_rule(connection, id)


def _stamp(backfill: datetime | Literal["all"] | None) -> datetime | None:
    return rules.SINCE_EVER if backfill == ALL else backfill


def _read(connection: Connection, rule_id: int) -> RuleDocument:
    return RuleDocument.model_validate(rules.get_rule(connection, rule_id))
