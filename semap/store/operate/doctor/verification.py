"""`semap doctor --verify`: what must hold of relations, computed anew and compared with what is stored.

Of each map one snapshot is looked at, so that writers go on meanwhile and what is half done is not seen.
With `repair`, what differs is made anew in one transaction for each map, which keeps writers out meanwhile.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial

from sqlalchemy import Connection, TextClause, text
from sqlalchemy.exc import DBAPIError

from semap.errors import Conflict, NotFound, SemapError, ServerUnavailable
from semap.store.database.connection import own_session, translated
from semap.store.motion.correction import correct_some
from semap.store.operate.doctor.stateful_check import Progress, check_stateful

EXAMPLES = 5
UNDEFINED_FUNCTION = "42883"
STATEFUL = "stateful relations"
STATEFUL_WHAT = "relations with stateful regions against the paths of tracks"
LATE = "late states"
ATTEMPTS = 5
"""So often a map is looked at anew, each time because a query was removed meanwhile."""
DIFFERENCES = "select count(*) over (), thing, stored, wanted from semap.{}(:map_id) limit :most"
REPAIR = text("""
    select semap.repair_relations(map_id, cast(:tracks as bigint[]), cast(:regions as integer[]))
    from semap.map where name = :name
""")
WAITING = text("""
    select count(*)
    from (select source_id from semap.late_state union all select source_id from semap.reading_due) w
    join semap.source using (source_id) where map_id = :map_id
""")
MAPS = text(
    "select map_id, name from semap.map where cast(:name as text) is null or name = :name order by name"
)


@dataclass(frozen=True)
class Comparison:
    """Something that is stored, and the function that says where it differs (sql/500, 505, 507).

    rows  the statement that counts it
    """

    name: str
    what: str
    rows: str
    function: str

    @property
    def differences(self) -> TextClause:
        return text(DIFFERENCES.format(self.function))


COUNT = "select count(*) from semap.{} where map_id = :map_id"
GRID = (
    "select (select count(*) from semap.region_cell c where c.map_id = m.map_id)"
    " + (select count(*) from semap.region_edge e where e.map_id = m.map_id)"
    " from semap.map m where m.map_id = :map_id"
)
PAIR_CHANGES = (
    "select count(*) from semap.relation_change c join semap.continuous_query q using (query_id)"
    " where c.map_id = :map_id and q.in_pairs and c.kind {}"
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
        ("plain relations", "relations against footprints and heights",
         COUNT.format("relation") + " and not in_pairs", "plain_differences"),
        ("held", "regions of present states against relations", COUNT.format("track_now"),
         "held_differences"),
        ("pair members", "sides of pairs against the queries, the map and presents",
         COUNT.format("pair_instance"), "pair_member_differences"),
        ("pairs", "pairs against where their two sides are", COUNT.format("relation") + " and in_pairs",
         "pair_differences"),
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


class NotCorrected(Exception):
    """What came late on a map cannot be corrected, so that its relations cannot be compared; says why."""


@dataclass
class Verification:
    """Mutable: what was found so far, for the repair.

    differing  maps that a repair makes right
    wrong      by map: tracks and stateful regions whose relation cannot be right
    """

    connection: Connection
    progress: Progress
    differing: set[str] = field(default_factory=set)
    wrong: dict[str, list[tuple[int, int]]] = field(default_factory=dict)

    def look(self, map_name: str | None) -> Iterator[Verified]:
        """Every comparison on one map, or on all of them.

        raises NotFound where there is no such map, Conflict where queries are removed again and again
        """
        self.differing, self.wrong = set(), {}
        with translated():
            for map_id, name in _maps(self.connection, map_name):
                try:
                    yield from self._look_at(map_id, name)
                except NotCorrected as error:
                    yield _uncorrected(self.connection, map_id, name, str(error))

    def _look_at(self, map_id: int, name: str) -> Iterator[Verified]:
        """In another snapshot once that before knew a query that is gone: none keeps its functions."""
        left = [partial(_compare, self.connection, map_id, name, each, self.progress) for each in COMPARISONS]
        left.append(partial(self._stateful, map_id, name))
        for attempt in range(1, ATTEMPTS + 1):
            try:
                with _snapshot(self.connection, map_id):
                    while left:
                        verified = left[0]()
                        if verified.differ:
                            self.differing.add(name)
                        yield verified
                        del left[0]
                return
            except DBAPIError as error:
                if getattr(error.orig, "sqlstate", None) != UNDEFINED_FUNCTION:
                    raise
                if attempt == ATTEMPTS:
                    raise Conflict(
                        f"Queries of {name} were removed each of {ATTEMPTS} times that it was verified.",
                        "Verify again when its queries stay as they are.",
                    ) from error

    def repair(self) -> Iterator[Repaired]:
        """Make every map right on which something differed."""
        for name in sorted(self.differing):
            wrong = self.wrong.get(name, [])
            asked = {
                "name": name,
                "tracks": [track for track, _ in wrong],
                "regions": [region for _, region in wrong],
            }
            with translated():
                crossings = self.connection.scalar(REPAIR, asked)
            yield Repaired(name, crossings or 0)

    def _stateful(self, map_id: int, name: str) -> Verified:
        self.progress(f"{name}: {STATEFUL_WHAT}")
        found = check_stateful(
            self.connection, map_id, lambda said: self.progress(f"{name}: {said}"), EXAMPLES
        )
        self.wrong[name] = found.wrong
        note = f"{found.partly} followed only in part" if found.partly else ""
        return Verified(
            name, STATEFUL, STATEFUL_WHAT, found.pairs, len(found.wrong), found.examples, note,
        )  # fmt: skip


def verify(dsn: str, progress: Progress) -> Verification:
    """A connection of its own, which the caller closes (`Verification.connection`)."""
    return Verification(own_session(dsn, application="semap doctor"), progress)


@contextmanager
def _snapshot(connection: Connection, map_id: int) -> Iterator[None]:
    """One snapshot, in which nothing that came late on a map waits to be corrected; writers wait for it.

    raises NotCorrected
    """
    _correct(connection, map_id)
    connection.execute(text("select pg_advisory_lock(7363, 0)"))  # as an edit of the map does (sql/020)
    try:
        _correct(connection, map_id)
        connection.commit()
        with connection.execution_options(isolation_level="REPEATABLE READ").begin():
            connection.execute(text("select pg_advisory_unlock(7363, 0)"))
            yield
    finally:
        if not (connection.closed or connection.invalidated):
            connection.rollback()
            connection.execution_options(isolation_level="AUTOCOMMIT")
            connection.execute(text("select pg_advisory_unlock_all()"))


def _correct(connection: Connection, map_id: int) -> None:
    try:
        while correct_some(connection, map_id):
            pass
    except ServerUnavailable:
        raise
    except SemapError as error:
        raise NotCorrected(str(error)) from error


def _uncorrected(connection: Connection, map_id: int, name: str, why: str) -> Verified:
    count = connection.scalar(WAITING, {"map_id": map_id}) or 0
    return Verified(
        name, LATE, "late states that are not corrected", count, max(count, 1),
        [("what came late", f"waiting, since its correction fails: {why}", "corrected")],
        "nothing else of this map is compared until it is",
    )  # fmt: skip


def _maps(connection: Connection, map_name: str | None) -> list[tuple[int, str]]:
    found = [(map_id, name) for map_id, name in connection.execute(MAPS, {"name": map_name})]
    if map_name is not None and not found:
        raise NotFound("map", map_name, "List them: semap map list")
    return found


def _compare(
    connection: Connection, map_id: int, name: str, comparison: Comparison, progress: Progress
) -> Verified:
    progress(f"{name}: {comparison.what}")
    asked = {"map_id": map_id, "most": EXAMPLES}
    found = connection.execute(comparison.differences, asked).all()
    rows = connection.scalar(text(comparison.rows), asked)
    return Verified(
        name, comparison.name, comparison.what, rows or 0, found[0][0] if found else 0,
        [(thing, stored, wanted) for _, thing, stored, wanted in found],
    )  # fmt: skip
