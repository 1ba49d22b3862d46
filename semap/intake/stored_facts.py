"""The facts of the map as of a moment, out of its history.

Edits of the map are one at a time and alone, so that stamps of change sets tell what was committed by then.
"""

from __future__ import annotations

import json
from datetime import datetime

import psycopg

from semap.intake.map_facts import OF_HISTORY, MapFacts
from semap.replication.pgoutput import Change
from semap.store.database.connection import translated

LOAD = """
    select v.content from (
      select distinct on (v.row_key) v.content
      from semap.row_version v join semap.change_set c using (change_set_id)
      where v.table_name = %s and c.made_at <= coalesce(%s, 'infinity'::timestamptz)
      order by v.row_key, v.version_id desc) v
    where v.content is not null
"""


def load_map_facts(connection: psycopg.Connection, at: datetime | None = None) -> MapFacts:
    """The facts as of a moment by the server's clock; None is now."""
    facts = MapFacts()
    with translated():
        for map_id, uid in connection.execute("select map_id::text, uid::text from semap.map"):
            facts.apply(Change("map", "insert", {"map_id": map_id, "uid": uid}))
        for table in OF_HISTORY:
            for (content,) in connection.execute(LOAD, [table, at]):
                facts.apply(Change(table, "insert", {name: _text(value) for name, value in content.items()}))
    return facts


def _text(value: object) -> str | None:
    """A value as the log carries it."""
    if value is None or isinstance(value, str):
        return value
    return json.dumps(value)
