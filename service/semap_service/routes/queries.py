"""/queries"""

from __future__ import annotations

import re
from dataclasses import fields, replace
from math import pi
from typing import TYPE_CHECKING, Annotated, Any, Literal
from uuid import UUID

from fastapi import APIRouter, Query, Response
from pydantic import ConfigDict, Field
from sqlalchemy import Connection

from semap.errors import InvalidInput
from semap.model.continuous_query import (
    SIDES,
    BetweenSamples,
    Certainty,
    Debounce,
    Declaration,
    Direction,
    Side,
)
from semap.model.predicate import Kind, needed_for, predicates
from semap.store.map.maps import get_map
from semap.store.relation import queries
from semap.store.relation.query_check import PARAMETERS, Flat
from semap_service.database.transaction import Database, Edit, Write, transaction
from semap_service.documents.document import (
    LARGEST_ID,
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
from semap_service.http.etag import TaggedRoute, edits, reads
from semap_service.http.problem import problems

router = APIRouter(tags=["queries"], route_class=TaggedRoute)


if TYPE_CHECKING:
    Predicate = str
else:
    Predicate = Literal[tuple(predicates())]
Metres = Annotated[float, Field(gt=0, le=1e4)]
Margin = Annotated[float, Field(ge=0, le=100)]
Wait = Annotated[float, Field(ge=0, le=86_400)]


class SideDocument(Request):
    """Tracks or instances that satisfy all of these conditions. Without conditions: any."""

    model_config = ConfigDict(from_attributes=True)

    kind: Kind | None = Field(
        default=None, description="[default: the subjects are tracks, the objects instances]"
    )
    concept: Name | None = Field(default=None, examples=["Room"], description="This concept or one below it.")
    uids: Annotated[list[UUID], Field(min_length=1, max_length=10_000)] | None = None
    where: Annotated[str, Field(max_length=8000)] | dict[str, Any] | None = Field(
        default=None,
        examples=["name LIKE 'Room%' AND attributes.floor = 2"],
        description="A condition in CQL2, text or JSON: on name, alias and attributes; of tracks on name,"
        " source and attributes.",
    )


class DebounceDocument(Request):
    """How far beside the boundary a track has to come, and how long to stay, before it counts."""

    model_config = ConfigDict(from_attributes=True)

    enter_margin_m: Margin = 0.0
    leave_margin_m: Margin = 0.0
    enter_confirm_s: Wait = 0.0
    leave_confirm_s: Wait = 0.0


class CertaintyDocument(Request):
    """How probable it must be that a track is inside to begin, and how improbable to end."""

    model_config = ConfigDict(from_attributes=True)

    enter: Annotated[float, Field(ge=0.5, lt=1)] = 0.9
    leave: Annotated[float, Field(gt=0, le=0.5)] = 0.1
    widest_std_m: Annotated[float, Field(gt=0, le=100)] = Field(
        1.0, description="A position less exact than this is evidence of neither."
    )


class BetweenSamplesDocument(Request):
    """The way between two samples is a straight line, unless it is too long or too fast to be one."""

    model_config = ConfigDict(from_attributes=True)

    longest_gap_s: Annotated[float, Field(gt=0, le=86_400)] = 30.0
    fastest_mps: Annotated[float, Field(gt=0, le=1e4)] = 30.0


IN_SQL = {"predicate", "concept", "subject", "object", *PARAMETERS, "abstraction", "dimensions"}


class Asked(Request):
    """A continuous query."""

    name: Name = Field(examples=["track_at_door"])
    predicate: Predicate = Field("contains", description="The relation between subject and object.")
    concept: Name | None = Field(
        None, examples=["Door"], description="Short for `object.concept`: this concept and those below it."
    )
    subject: SideDocument = Field(SideDocument(), description="Which tracks, or instances.")
    object: SideDocument = Field(SideDocument(), description="Which instances, or tracks.")
    distance_m: Metres | None = Field(
        None,
        description=f"How far it reaches. {needed_for('distance_m')}.",
    )
    count: Annotated[int, Field(ge=1, le=100)] | None = Field(
        None, description=f"How many. {needed_for('count')}."
    )
    angle_rad: Annotated[float, Field(gt=0, le=pi)] | None = Field(
        None, description=f"How far the heading may be off. {needed_for('angle_rad')}."
    )
    speed_mps: Annotated[float, Field(gt=0, le=1e4)] | None = Field(
        None, description=f"How fast the distance falls, at least. {needed_for('speed_mps')}."
    )
    direction: Direction | None = Field(
        None,
        description="Seen along the line in the order of its vertices; null: both."
        f" {needed_for('direction')}.",
    )
    abstraction: Flat = "Footprint"
    dimensions: Literal[2, 3] = Field(3, description="3: heights count, too.")
    debounce: DebounceDocument = DebounceDocument()
    certainty: CertaintyDocument | None = Field(None, description="null: positions are taken as exact.")
    between_samples: BetweenSamplesDocument | None = Field(
        None, description="null: relations follow the samples alone."
    )
    follows_amendments: bool = Field(
        False,
        description="Where a tracker finds that it had mistaken tracks, relations are corrected. Only for"
        " tracks in, on or near instances; it stays true.",
    )

    sql: Annotated[str, Field(max_length=100_000)] | None = Field(
        None,
        examples=["select r.name, t.name from track t, room r where st_contains(r.footprint, t.position)"],
        description="Instead of predicate, sides, distance, abstraction and dimensions: a SELECT over the"
        " views of semap_query. Its columns are the payload of each relation.",
    )

    def declaration(self, connection: Connection) -> Declaration:
        """raises InvalidInput"""
        if self.sql is not None:
            return self._declaration_in_sql(connection, self.sql)
        if self.concept is not None and self.object.concept not in (None, self.concept):
            raise InvalidInput("concept and object.concept differ", "Say one of them.")
        return Declaration(
            name=self.name,
            predicate=self.predicate,
            subject=_side("subject", self.subject),
            object=replace(_side("object", self.object), concept=self.object.concept or self.concept),
            **{name: getattr(self, name) for name in PARAMETERS},
            abstraction=self.abstraction,
            dimensions=self.dimensions,
            **self._edges(),
        )

    def _declaration_in_sql(self, connection: Connection, sql: str) -> Declaration:
        said = self.model_fields_set & IN_SQL
        if said:
            raise InvalidInput(f"sql says what {', '.join(sorted(said))} would say", "Say one of them.")
        return replace(queries.declaration_from_sql(connection, self.name, sql), **self._edges())

    def _edges(self) -> dict[str, Any]:
        """What makes edges honest: none of it can be said in SQL."""
        sure, between = self.certainty, self.between_samples
        return {
            "debounce": Debounce(**self.debounce.model_dump()),
            "certainty": None if sure is None else Certainty(**sure.model_dump()),
            "between_samples": None if between is None else BetweenSamples(**between.model_dump()),
            "follows_amendments": self.follows_amendments,
        }


class NewQuery(Asked):
    """A continuous query to be kept from now on."""

    map: Name = Field(examples=["office"])


class QueryChanges(Request):
    enabled: bool = Field(description="false ends all its relations; true keeps them again.")


class QueryDocument(Document):
    """A continuous query: while it is enabled, this relation of its subjects to its objects is kept true."""

    id: int
    map: str = Field(examples=["office"])
    name: str = Field(examples=["track_in_room"])
    predicate: str = Field(examples=["contains"])
    concept: str | None = Field(examples=["Room"], description="`object.concept`.")
    subject: SideDocument
    object: SideDocument
    distance_m: float | None
    count: int | None
    angle_rad: float | None
    speed_mps: float | None
    direction: Direction | None
    abstraction: str = Field(examples=["Footprint"])
    dimensions: int
    debounce: DebounceDocument
    certainty: CertaintyDocument | None
    between_samples: BetweenSamplesDocument | None
    follows_amendments: bool
    payload: dict[str, str] = Field(
        description="The payload of each relation, by the names of columns.",
        examples=[{"room_name": "object.name", "track_name": "subject.name"}],
    )
    sql: str | None = Field(description="As it was declared; null where it was not in SQL.")
    enabled: bool


class QueryList(Document):
    queries: list[QueryDocument] = Field(description="In the order of their ids.")
    next: Next


@router.get("/queries", operation_id="list_queries", responses=reads(404))
def list_queries(
    database: Database, map_name: MapFilter = None, limit: Limit = 100, after: After = 0
) -> QueryList:
    """Continuous queries: which relations are kept."""
    with transaction(database) as connection:
        if map_name is not None:
            get_map(connection, map_name)
        found = queries.list_queries(connection, map_name=map_name, after=after, limit=limit)
    return QueryList(
        queries=[_document(each) for each in found], next=next_after([each.query_id for each in found], limit)
    )


@router.post("/queries", operation_id="add_query", status_code=201, responses=problems(404, 409))
def add_query(write: Write, new: NewQuery, response: Response) -> QueryDocument:
    """Maintain a relation. The present relations hold when the response is sent."""
    with write.to(new.map).begin() as connection:
        made = queries.add_query(connection, new.map, new.declaration(connection), sql=new.sql)
    response.headers["Location"] = f"/queries/{made.query_id}"
    return _document(made)


@router.get("/queries/{id}", operation_id="get_query", responses=reads(404))
def get_query(database: Database, id: SmallId) -> QueryDocument:  # noqa: A002
    """A continuous query."""
    with transaction(database) as connection:
        return _read(connection, id)


@router.patch("/queries/{id}", operation_id="change_query", responses=edits(404))
def change_query(edit: Edit, id: SmallId, changes: QueryChanges) -> QueryDocument:  # noqa: A002
    """Let a query rest, or work again."""
    with edit.begin(lambda connection: _read(connection, id)) as connection:
        return _document(queries.enable_query(connection, id, changes.enabled))


@router.put("/queries/{id}", operation_id="replace_query", responses=edits(404, 409))
def replace_query(edit: Edit, id: SmallId, asked: Asked) -> QueryDocument:  # noqa: A002
    """Let a query ask something else from now on. What that changes begins or ends now: cause `map`."""
    with edit.begin(lambda connection: _read(connection, id)) as connection:
        return _document(queries.change_query(connection, id, asked.declaration(connection), sql=asked.sql))


@router.delete("/queries/{id}", operation_id="delete_query", status_code=204, responses=edits(404, 409))
def delete_query(edit: Edit, id: SmallId) -> None:  # noqa: A002
    """Delete a query; its relations end. One that a rule reads is refused."""
    with edit.begin(lambda connection: _read(connection, id)) as connection:
        queries.delete_query(connection, id)


class QueryResult(Document):
    """What holds by a query now."""

    rows: list[dict[str, Any]] = Field(
        description="The columns that the query selects (where it selects none, names and ids of both sides)"
        " and `since`; shapes are GeoJSON in metres of the map.",
        examples=[[{"room_name": "Room07", "track_name": "person 3", "since": "2026-01-31T12:00:00+00:00"}]],
    )
    next: str | None = Field(description="`after` of the next page; null where this is the last one.")


PLACE = re.compile(r"(-?\d{1,19})-(-?\d{1,19})")


@router.get("/queries/{id}/result", operation_id="get_query_result", responses=problems(404))
def get_query_result(
    database: Database,
    id: SmallId,  # noqa: A002
    limit: Limit = 100,
    after: Annotated[
        str | None,
        Query(pattern=rf"^{PLACE.pattern}$", description="Go on after this place: `next` of a page."),
    ] = None,
) -> QueryResult:
    """What holds by a query now: the rows of its live table."""
    place = None
    if after is not None and (match := PLACE.fullmatch(after)) is not None:
        first, second = (max(min(int(part), LARGEST_ID), -LARGEST_ID) for part in match.groups())
        place = (first, second)
    with transaction(database) as connection:
        found = queries.query_result(connection, id, after=place, limit=limit)
    return QueryResult(
        rows=[dict(each.columns) for each in found],
        next="-".join(map(str, found[-1].place)) if len(found) == limit else None,
    )


def _read(connection: Connection, query_id: int) -> QueryDocument:
    return _document(queries.get_query(connection, query_id))


def _side(name: str, said: SideDocument) -> Side:
    return Side(
        said.kind or SIDES[name],
        said.concept,
        None if said.uids is None else tuple(said.uids),
        None if said.where is None else queries.read_condition(said.where),
    )


def _document(query: queries.Query) -> QueryDocument:
    asked = query.declaration
    names = QueryDocument.model_fields.keys() & {each.name for each in fields(asked)}
    return QueryDocument(
        id=query.query_id,
        map=query.map,
        concept=asked.object.concept,
        enabled=query.enabled,
        sql=query.sql,
        **{name: getattr(asked, name) for name in names},
    )
