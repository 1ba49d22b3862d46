"""The design that is usual for geofences on PostGIS (row_trigger.sql): a trigger for each row.

Each position looks up its fences by ST_Contains through the index, compares them with those of its track's
current row, writes that row, and makes an event with a NOTIFY of each fence that was entered or left.

It is tuned as far as the design goes. The index is SP-GiST, made after the fences are in: with that the
lookup takes a quarter of what it takes with a GiST index that grew with the table. The statements of the
function have generic plans after the first rows; forcing them, a BEFORE trigger, or one statement instead of
two changed nothing that could be measured. The server and its settings are semap's own.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psycopg
from semap_ingest.state_copy import COLUMNS

from bench.crowd import Crowd
from bench.peers import Fed, Named, ordered
from semap.store.database.connection import connect

COPY = f"copy row_trigger.track_position ({', '.join(COLUMNS)}) from stdin (format binary)"
INDEX = "create index fence_area on row_trigger.fence using spgist (area)"


@contextmanager
def begin(dsn: str, crowd: Crowd, frames: int) -> Iterator[RowTrigger]:
    with connect(dsn) as connection:
        connection.execute(Path(__file__).with_suffix(".sql").read_text())
        try:
            with connection.cursor() as cursor, cursor.copy("copy row_trigger.fence from stdin") as copy:
                for number, room in enumerate(crowd.rooms):
                    copy.write_row((number, room.wkb_hex))
            connection.execute(INDEX)
            connection.execute("vacuum analyze row_trigger.fence")
            yield RowTrigger(connection, crowd, frames)
        finally:
            connection.execute("drop schema row_trigger cascade")


class RowTrigger:
    named = Named("row trigger on PostGIS")

    def __init__(self, connection: psycopg.Connection, crowd: Crowd, frames: int) -> None:
        self._connection = connection
        self._crowd = crowd
        self._last_event = 0
        self.begun = self.feed(0, frames).changes
        connection.execute("vacuum analyze row_trigger.track_current")

    def feed(self, first: int, count: int) -> Fed:
        batches = self._crowd.batches[first : first + count]
        started_s = time.perf_counter()
        with self._connection.cursor() as cursor:
            for batch in batches:
                with cursor.copy(COPY) as copy:
                    copy.write(batch)
        seconds = time.perf_counter() - started_s
        rows = self._connection.execute(
            "select event_id, track_id, fence_id, (kind = 'enter')::int,"
            " (extract(epoch from stamp) * 1e6)::bigint from row_trigger.fence_event where event_id > %s",
            [self._last_event],
        ).fetchall()
        self._last_event = max((row[0] for row in rows), default=self._last_event)
        return Fed(seconds, ordered([row[1:] for row in rows]))
