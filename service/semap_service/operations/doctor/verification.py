"""`semap doctor --verify`: what must hold of relations, computed anew and compared with what is stored.

One snapshot of the database is looked at, so that writers go on meanwhile and what is half done is not seen.
With `repair`, what differs is made anew in one transaction for each map, which keeps writers out meanwhile.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

import psycopg
from psycopg import IsolationLevel, errors, sql

from semap.errors import Conflict, NotFound
from semap.store.database.connection import connect, translated
from semap.store.motion.correction import correct_some
from semap_service.operations.doctor.stateful_check import Progress, check_stateful

EXAMPLES = 5
STATEFUL = "stateful relations"
DIFFERENCES = sql.SQL("select count(*) over (), thing, stored, wanted from {}(%s) limit %s")


@dataclass(frozen=True)
class Comparison:
    """Something that is stored, and the function that says where it differs (sql/500, 505, 507).

    rows  the statement that counts it
    """

    name: str
    what: str
    rows: str
    function: str


COUNT = "select count(*) from semap.{} where map_id = %s"
GRID = (
    "select (select count(*) from semap.region_cell c where c.map_id = m.map_id)"
    " + (select count(*) from semap.region_edge e where e.map_id = m.map_id)"
    " from semap.map m where m.map_id = %s"
)
PAIR_CHANGES = (
    "select count(*) from semap.relation_change c join semap.continuous_query q using (query_id)"
    " where c.map_id = %s and q.in_pairs and c.kind {}"
)
COMPARISONS = tuple(
    Comparison(*each)
    for each in (
        ("regions", "regions against the queries and the map", COUNT.format("region"), "region_differences"),
        ("grid", "cells and edges against their regions", GRID, "grid_differences"),
        ("subjects", "chosen tracks against the conditions of queries", COUNT.format("query_track"),
         "choice_differences"),
        ("presents", "presents of tracks against their newest states", COUNT.format("track"),
         "present_differences"),
        ("plain relations", "relations against footprints and heights", COUNT.format("relation"),
         "plain_differences"),
        ("held", "present states and debounce states against relations", COUNT.format("track_now"),
         "held_differences"),
        ("pair members", "sides of pairs against the queries, the map and presents",
         COUNT.format("pair_instance"), "pair_member_differences"),
        ("pairs", "pairs against where their two sides are", COUNT.format("pair"), "pair_differences"),
        ("pair history", "the log of two tracks against where both were", PAIR_CHANGES.format("<> 'crossed'"),
         "pair_history_differences"),
        ("crossings", "lines that were crossed against the ways of tracks",
         PAIR_CHANGES.format("= 'crossed'"), "crossing_differences"),
        ("log", "relations against the folded log of changes", COUNT.format("relation_change"),
         "log_differences"),
        ("past", "stays that are over against the log", COUNT.format("relation_past"), "past_differences"),
    )
)  # fmt: skip


@dataclass(frozen=True)
class Verified:
    """What one comparison found on one map.

    rows      that were looked at
    differ    of things that are not as they should be
    examples  of these the first few: what, as it is stored, as it should be
    note      what was not looked at
    """

    map_name: str
    name: str
    what: str
    rows: int
    differ: int
    examples: list[tuple[str, str, str]] = field(default_factory=list)
    note: str = ""


@dataclass(frozen=True)
class Repaired:
    """How many relations began or ended when a map was made right."""

    map_name: str
    crossings: int


@dataclass
class Verification:
    """Mutable: what was found so far, for the repair.

    wrong  by map: tracks and stateful regions whose relation cannot be right
    """

    connection: psycopg.Connection
    progress: Progress
    differing: set[str] = field(default_factory=set)
    wrong: dict[str, list[tuple[int, int]]] = field(default_factory=dict)

    def look(self, map_name: str | None) -> Iterator[Verified]:
        """Every comparison on one map, or on all of them.

        raises NotFound where there is no such map, Conflict where a query was removed meanwhile
        """
        self.differing, self.wrong = set(), {}
        with translated(), _snapshot(self.connection):
            for map_id, name in _maps(self.connection, map_name):
                for comparison in COMPARISONS:
                    self.progress(f"{name}: {comparison.what}")
                    yield self._noted(_compare(self.connection, map_id, name, comparison))
                self.progress(f"{name}: relations with stateful regions against the paths of tracks")
                yield self._noted(self._stateful(map_id, name))

    def repair(self) -> Iterator[Repaired]:
        """Make every map right on which something differed."""
        self.connection.isolation_level = IsolationLevel.READ_COMMITTED
        for name in sorted(self.differing):
            wrong = self.wrong.get(name, [])
            with translated(), self.connection.transaction():
                row = self.connection.execute(
                    "select semap.repair_relations(map_id, %s::bigint[], %s::integer[])"
                    " from semap.map where name = %s",
                    [[track for track, _ in wrong], [region for _, region in wrong], name],
                ).fetchone()
            yield Repaired(name, row[0] if row else 0)

    def _noted(self, verified: Verified) -> Verified:
        if verified.differ:
            self.differing.add(verified.map_name)
        return verified

    def _stateful(self, map_id: int, name: str) -> Verified:
        found = check_stateful(
            self.connection, map_id, lambda said: self.progress(f"{name}: {said}"), EXAMPLES
        )
        self.wrong[name] = found.wrong
        note = f"{found.partly} followed only in part" if found.partly else ""
        return Verified(
            name, STATEFUL, "relations with stateful regions against the paths of tracks",
            found.pairs, len(found.wrong), found.examples, note,
        )  # fmt: skip


def verify(dsn: str, progress: Progress) -> Verification:
    """A connection of its own, which the caller closes (`Verification.connection`)."""
    return Verification(connect(dsn, application="semap doctor", autocommit=True), progress)


@contextmanager
def _snapshot(connection: psycopg.Connection) -> Iterator[None]:
    """One snapshot, in which nothing that came late waits to be corrected; writers wait until it is taken."""
    connection.isolation_level = IsolationLevel.READ_COMMITTED
    while correct_some(connection):
        pass
    connection.execute("select pg_advisory_lock(7363, 0)")  # as an edit of the map does (sql/020)
    try:
        connection.execute("select semap.correct_all()")
        connection.isolation_level = IsolationLevel.REPEATABLE_READ
        with connection.transaction():
            connection.execute("select pg_advisory_unlock(7363, 0)")
            yield
    except errors.UndefinedFunction as error:  # which a snapshot does not keep
        raise Conflict("A query was removed while its relations were verified.", "Verify again.") from error
    finally:
        with suppress(psycopg.Error):
            connection.execute("select pg_advisory_unlock_all()")


def _maps(connection: psycopg.Connection, map_name: str | None) -> list[tuple[int, str]]:
    rows = connection.execute(
        "select map_id, name from semap.map where %(name)s::text is null or name = %(name)s order by name",
        {"name": map_name},
    ).fetchall()
    if map_name is not None and not rows:
        raise NotFound("map", map_name, "List them: semap map list")
    return rows


def _compare(connection: psycopg.Connection, map_id: int, name: str, comparison: Comparison) -> Verified:
    found = connection.execute(
        DIFFERENCES.format(sql.Identifier("semap", comparison.function)), [map_id, EXAMPLES]
    ).fetchall()
    row = connection.execute(comparison.rows, [map_id]).fetchone()
    return Verified(
        name, comparison.name, comparison.what, row[0] if row else 0, found[0][0] if found else 0,
        [(thing, stored, wanted) for _, thing, stored, wanted in found],
    )  # fmt: skip
