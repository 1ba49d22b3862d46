"""/rules"""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Response
from pydantic import Field
from sqlalchemy import Connection

from semap.rules.declaration import parse_declaration
from semap.store import rules
from semap.store.maps import get_map
from semap_service.document import (
    After,
    Document,
    Limit,
    MapFilter,
    Name,
    Next,
    Request,
    SmallId,
    next_after,
)
from semap_service.etag import TaggedRoute, edits, reads
from semap_service.problem import problems
from semap_service.transaction import Database, Edit, Write, transaction

router = APIRouter(tags=["rules"], route_class=TaggedRoute)

EXAMPLE = {"input": "track_in_room", "emit": {"began": "entered", "ended": "left"}}
Declaration = Annotated[
    dict[str, Any],
    Field(description="What it reads, and the events that it makes of it.", examples=[EXAMPLE]),
]


class RuleDocument(Document):
    """A rule: which events are made of which relations."""

    id: int
    map: str = Field(examples=["office"])
    name: str = Field(examples=["room_visits"])
    version: int = Field(description="Rises with each change of the declaration.")
    query: str = Field(examples=["track_in_room"])
    declaration: Declaration
    enabled: bool


class RuleList(Document):
    rules: list[RuleDocument] = Field(description="In the order of their ids.")
    next: Next


class NewRule(Request):
    """A rule for what happens from now on."""

    map: Name = Field(examples=["office"])
    name: Name = Field(examples=["room_visits"])
    declaration: Declaration


class RuleChanges(Request):
    """What to change; what is left out stays as it is."""

    enabled: bool | None = None
    declaration: Declaration | None = None


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
        rules=[_document(each) for each in found], next=next_after([each.rule_id for each in found], limit)
    )


@router.post("/rules", operation_id="add_rule", status_code=201, responses=problems(404, 409))
def add_rule(write: Write, new: NewRule, response: Response) -> RuleDocument:
    """Make events of relations that begin or end from now on."""
    declared = parse_declaration({"name": new.name, **new.declaration})
    with write.begin() as connection:
        made = rules.add_rule(connection, new.map, declared)
    response.headers["Location"] = f"/rules/{made.rule_id}"
    return _document(made)


@router.get("/rules/{id}", operation_id="get_rule", responses=reads(404))
def get_rule(database: Database, id: SmallId) -> RuleDocument:  # noqa: A002
    """A rule."""
    with transaction(database) as connection:
        return _read(connection, id)


@router.patch("/rules/{id}", operation_id="change_rule", responses=edits(404, 409))
def change_rule(edit: Edit, id: SmallId, changes: RuleChanges) -> RuleDocument:  # noqa: A002
    """Let a rule rest or work, or declare something else; that holds for what happens from now on."""
    with edit.begin(lambda connection: _read(connection, id)) as connection:
        rule = rules.get_rule(connection, id)
        if changes.declaration is not None:
            rule = rules.declare_rule(connection, id, parse_declaration(changes.declaration, rule.name))
        if changes.enabled is not None:
            rule = rules.enable_rule(connection, id, changes.enabled)
    return _document(rule)


@router.delete("/rules/{id}", operation_id="delete_rule", status_code=204, responses=edits(404))
def delete_rule(edit: Edit, id: SmallId) -> None:  # noqa: A002
    """Delete a rule; the events that it made stay."""
    with edit.begin(lambda connection: _read(connection, id)) as connection:
        rules.delete_rule(connection, id)


def _read(connection: Connection, rule_id: int) -> RuleDocument:
    return _document(rules.get_rule(connection, rule_id))


def _document(rule: rules.Rule) -> RuleDocument:
    return RuleDocument(
        id=rule.rule_id,
        map=rule.map,
        name=rule.name,
        version=rule.version,
        query=rule.query,
        declaration=dict(rule.declaration),
        enabled=rule.enabled,
    )
