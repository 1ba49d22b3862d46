"""Who was related to what, since when and how long, by name: now, at a moment, or within a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, RowMapping, text

from semap.errors import NotFound
from semap.store.database import translated

CHOSEN = """
    (cast(:map as text) is null or map = :map) and (cast(:query as text) is null or query = :query)
    and (cast(:track as text) is null or track = :track or object_track = :track)
    and (cast(:room as text) is null or instance = :room or subject_instance = :room)
"""
KNOWN = text("""
    select cast(:map as text) is null or exists (select from semap.map where name = :map),
           cast(:query as text) is null or exists (
             select from semap.continuous_query q join semap.map m using (map_id)
             where q.name = :query and (cast(:map as text) is null or m.name = :map))
""")
NOW = f"""
    select map, query, subject, object, since from semap.relation_now where {CHOSEN}
    order by map, object, subject, query
"""  # noqa: S608  (constants)
SPAN = "map, query, subject, object, since, until, cast(extract(epoch from duration) as float8) as duration_s"
AS_OF = f"""
    select {SPAN} from semap.relations_as_of(:as_of) where {CHOSEN}
    order by map, object, subject, query
"""  # noqa: S608  (constants)
BETWEEN = f"""
    select {SPAN} from semap.relation_span
    where {CHOSEN}
      and tstzrange(since, until, '[]')
          && tstzrange(cast(:start as timestamptz), cast(:end as timestamptz))
      and (cast(:start as timestamptz) is null or until is null or until > :start)
    order by since, map, object, subject, query
"""  # noqa: S608  (constants)


@dataclass(frozen=True)
class Chosen:
    """Which relations: those of which all of this is true.

    as_of       those that held then; None: not asked
    start, end  those that held at some time in between; None: without bound
    """

    map: str | None = None
    query: str | None = None
    track: str | None = None
    room: str | None = None
    as_of: datetime | None = None
    start: datetime | None = None
    end: datetime | None = None

    @property
    def is_now(self) -> bool:
        """Whether no time is asked for."""
        return self.as_of is None and self.start is None and self.end is None


def list_spans(connection: Connection, chosen: Chosen) -> Sequence[RowMapping]:
    """What was chosen; of the past also until when it held, and how long.

    raises  NotFound where nothing can hold, since there is no such map or query
    """
    statement = AS_OF if chosen.as_of is not None else NOW if chosen.is_now else BETWEEN
    values: dict[str, Any] = vars(chosen)
    with translated():
        rows = connection.execute(text(statement), values).mappings().all()
        if not rows:
            is_map, is_query = connection.execute(KNOWN, values).one()
            if not is_map:
                raise NotFound("map", chosen.map, "List the maps: semap map list")
            if not is_query:
                raise NotFound("query", chosen.query, "List the queries: semap query list")
    return rows
