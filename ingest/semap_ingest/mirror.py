"""The ingest worker's copy of the map: instances and their absolute footprints, kept by the log.

It starts from a snapshot taken at the very place of the log where its stream begins, so that no
change falls between the two. The slot is temporary: a mirror that is gone keeps no log back, and a
new one starts from a new snapshot.
"""

from __future__ import annotations

import logging
from contextlib import closing
from dataclasses import dataclass, field
from threading import Event as Signal
from threading import Lock, Thread

import numpy as np
import psycopg
import shapely
from numpy.typing import NDArray

from semap.errors import DatabaseError
from semap.replication.pgoutput import Change, Row
from semap.replication.snapshot import begin_at_snapshot
from semap.replication.stream import ReplicationStream, start
from semap.store.database.backoff import Patience
from semap.store.database.connection import connect, translated

log = logging.getLogger(__name__)

PUBLICATIONS = ("semap_map",)
KEYS = {
    "map": ("map_id",),
    "concept": ("concept_id",),
    "concept_parent": ("concept_id", "parent_id"),
    "instance": ("instance_id",),
    "abstraction": ("abstraction_id",),
}
LOOK_S = 0.2


@dataclass
class MapMirror:
    """The mirrored tables, row by row as text, as they come through the log."""

    tables: dict[str, dict[str, Row]] = field(default_factory=lambda: {table: {} for table in KEYS})

    def apply(self, change: Change) -> None:
        """Take one change; a value that the log leaves out because it is unchanged stays."""
        if change.table not in KEYS:
            return
        rows = self.tables[change.table]
        if change.operation == "truncate":
            rows.clear()
            return
        if change.table == "abstraction" and change.row.get("type") not in (None, "Footprint"):
            return
        key = "/".join(str(change.row[column]) for column in KEYS[change.table])
        if change.operation == "delete":
            rows.pop(key, None)
        else:
            rows[key] = {**rows.get(key, {}), **change.row}

    def footprints(self, map_name: str, concept: str) -> dict[str, shapely.Geometry]:
        """Absolute footprints [m, map frame] of a map's instances of a concept or one below, by name."""
        map_id = next((key for key, row in self.tables["map"].items() if row["name"] == map_name), None)
        concepts = self._concepts_below(concept)
        by_description = {
            row["description_id"]: row["geometry"]
            for row in self.tables["abstraction"].values()
            if row["type"] == "Footprint"
        }
        return {
            str(row["name"]): shapely.from_wkb(by_description[row["absolute_description_id"]])
            for row in self.tables["instance"].values()
            if row["map_id"] == map_id
            and row["concept_id"] in concepts
            and row["absolute_description_id"] in by_description
        }

    def _concepts_below(self, concept: str) -> set[str]:
        below = {key for key, row in self.tables["concept"].items() if row["name"] == concept}
        while True:
            rows = self.tables["concept_parent"].values()
            more = below | {str(row["concept_id"]) for row in rows if row["parent_id"] in below}
            if more == below:
                return below
            below = more


def count_inside(
    footprints: dict[str, shapely.Geometry], x_m: NDArray[np.float64], y_m: NDArray[np.float64]
) -> int:
    """How many of the points, two arrays (n,), lie in at least one footprint."""
    tree = shapely.STRtree(list(footprints.values()))
    points, _ = tree.query(shapely.points(x_m, y_m), predicate="within")
    return len(np.unique(points))


class Follower:
    """Keeps a mirror in a thread of its own; after a lost connection it starts anew."""

    def __init__(self, dsn: str) -> None:
        self._dsn = dsn
        self._stop = Signal()
        self._ready = Signal()
        self._applying = Lock()
        self._thread = Thread(target=self._run, name="mirror", daemon=True)
        self.mirror = MapMirror()

    def __enter__(self) -> Follower:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def wait_ready(self, timeout_s: float) -> bool:
        """Wait until the first snapshot is there; false if it was not in time."""
        return self._ready.wait(timeout_s)

    def footprints(self, map_name: str, concept: str) -> dict[str, shapely.Geometry]:
        """As `MapMirror.footprints`, after a whole transaction and not within one."""
        with self._applying:
            return self.mirror.footprints(map_name, concept)

    def _run(self) -> None:
        patience = Patience(log, "the mirror of the map waits")
        while not self._stop.is_set():
            try:
                mirror, stream = open_mirror(self._dsn)
                patience.restored()
                self.mirror = mirror
                self._ready.set()
                with closing(stream):
                    self._follow(stream)
            except DatabaseError as error:
                patience.wait(error, self._stop)

    def _follow(self, stream: ReplicationStream) -> None:
        while not self._stop.is_set():
            for transaction in stream.receive(LOOK_S):
                with self._applying:
                    for change in transaction.changes:
                        self.mirror.apply(change)
                stream.acknowledge(transaction.end_lsn)


def open_mirror(dsn: str) -> tuple[MapMirror, ReplicationStream]:
    """A mirror of the present map, and the stream of everything after it."""
    beginning = begin_at_snapshot(dsn, "mirror")
    mirror = MapMirror()
    try:
        with (
            connect(dsn, "semap_ingest", application="semap mirror", autocommit=False) as connection,
            translated(),
        ):
            connection.isolation_level = psycopg.IsolationLevel.REPEATABLE_READ
            connection.execute(psycopg.sql.SQL("set transaction snapshot {}").format(beginning.snapshot))
            for table in KEYS:
                _load(connection, mirror, table)
        return mirror, start(beginning.connection, beginning.slot, PUBLICATIONS, beginning.lsn)
    except BaseException:
        beginning.connection.finish()
        raise


def _load(connection: psycopg.Connection, mirror: MapMirror, table: str) -> None:
    """Read a table as text, the form in which the log carries it."""
    columns = [
        name
        for (name,) in connection.execute(
            "select attname from pg_attribute"
            " where attrelid = %s::regclass and attnum > 0 and not attisdropped",
            [f"semap.{table}"],
        )
    ]
    selected = psycopg.sql.SQL(", ").join(
        psycopg.sql.SQL("{}::text").format(psycopg.sql.Identifier(c)) for c in columns
    )
    statement = psycopg.sql.SQL("select {} from {}").format(selected, psycopg.sql.Identifier("semap", table))
    for row in connection.execute(statement):
        mirror.apply(Change(table, "insert", dict(zip(columns, row, strict=True))))
