"""A correction of late pairs, or of tracks that were mistaken, is done over if it is killed between its plan and its write,
or within its write."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass

import psycopg
import pytest
import shapely
from patience import until
from world import SECOND_US, World

from semap.store.database.connection import connect
from semap.worker.correcting import correcting

NEAR = """
    insert into semap.continuous_query (map_id, name, predicate, subject_kind, object_kind, distance_m, enter_confirm)
    values (%s, %s, 'within_distance', 'track', 'track', 1, make_interval(secs => %s))
"""
LATE = "insert into semap.track_state (track_id, stamp, x_m, y_m) values (%s, to_timestamp(%s), %s, 0)"
AMEND = (
    "insert into semap.track_amendment (track_id, other_track_id, kind, since, found)"
    " values (%s, %s, %s, to_timestamp(%s), to_timestamp(%s))"
)
COUNT_AMENDED = "select count(*) from semap.relation_change where amendment is not null"
WHO_WAITS = (
    "select pid from pg_stat_activity where %s = any (pg_blocking_pids(pid)) and datname = current_database()"
)
HAS_WRITTEN = (
    "select exists (select from pg_locks where pid = %s and relation = 'semap.relation_change'::regclass"
    " and mode = 'RowExclusiveLock' and granted)"
)
KNOWN = (
    "select query_name, track_name, coalesce(instance_name, object_track_name), kind::text, cause::text, stamp, transition_at, since, x_m, y_m,"
    " amendment, (select array[o.query_name, o.track_name, o.kind::text, o.transition_at::text]"
    " from semap.relation_change o where o.uid = c.retracts)"
    " from semap.relation_change c where map_id = %s order by change_id",
    "select query_name, track_name, coalesce(instance_name, object_track_name), since, until"
    " from semap.relation_past where map_id = %s"
    " order by 1, 2, 3, 4, 5",
    "select q.name, s.name, coalesce(i.name, o.name), p.confirmed, p.since, p.pending, p.pending_at, p.distance_m, p.distance_at"
    " from semap.relation p join semap.continuous_query q using (query_id)"
    " join semap.track s on s.track_id = p.track_id left join semap.track o on o.track_id = p.object_track_id"
    " left join semap.instance i on i.instance_id = p.instance_id"
    " where p.map_id = %s order by 1, 2, 3",
)


def met(world: World) -> None:
    """Three, who met and stay with one another, as was known; what came late says when they did otherwise."""
    for name, confirm_s in (("near", 0), ("near for 2 s", 2)):
        world.run(NEAR, world.map_id, name, confirm_s)
    tracks = {name: world.add_track(name) for name in ("ann", "bob", "cy")}
    for second in range(40):
        places = {"ann": 0.0, "bob": 0.5 if second >= 20 else 5.0, "cy": 0.3 if 5 <= second < 12 else 9.0}
        world.add_states([(tracks[name], second * SECOND_US, x_m, 0, None) for name, x_m in places.items()])
    for name, at_s, x_m in (("bob", 19.5, 0.4), ("cy", 8.5, 9.0), ("cy", 14.5, 0.3), ("ann", 30.5, 5.0)):
        world.run(LATE, tracks[name], at_s, x_m)


def mistaken(world: World) -> None:
    """Two who changed rooms and were switched, and one who was lost in a room and found again as another."""
    world.run("update semap.continuous_query set follows_amendments = true")
    world.run("update semap.source set jump_m = null")
    world.add_room("west", shapely.box(-1, -1, 3, 3))
    world.add_room("east", shapely.box(4, -1, 9, 3))
    tracks = {name: world.add_track(name) for name in ("ann", "bob", "cy", "dan")}
    for second in range(20):
        places = {"ann": 1.0 if second < 8 else 6.0, "bob": 6.0 if second < 8 else 1.0}
        places |= {"cy": 2.0} if second < 10 else {"dan": 2.0 if second < 15 else 7.0}
        world.add_states([(tracks[name], second * SECOND_US, x_m, 0, None) for name, x_m in places.items()])
        if second == 9:
            world.end_track(tracks["cy"], 9 * SECOND_US)
    world.run(AMEND, tracks["ann"], tracks["bob"], "switched", 8, 19)
    world.run(AMEND, tracks["dan"], tracks["cy"], "merged", 10, 19)


@dataclass(frozen=True)
class Corrected:
    """What is to be corrected, how many wait for it, and what holds the correction up before it writes, or as it does."""

    happened: Callable[[World], None]
    count_due: str
    planned: str
    half_written: str


CORRECTED = {
    "late pairs": Corrected(
        met, "select count(*) from semap.late_state", "select semap.lock_pairs(%s)",
        "select from semap.relation where map_id = %s and in_pairs for update",
    ),
    "mistaken tracks": Corrected(
        mistaken, "select count(*) from semap.reading_due",
        "lock table semap.relation_change in share mode",
        "select from semap.relation where map_id = %s for update",
    ),
}  # fmt: skip


def known(world: World) -> list[list[tuple]]:
    return [world.rows(each, world.map_id) for each in KNOWN]


def wait_for_the_one_that(waits_for: psycopg.Connection, watch: psycopg.Connection) -> int:
    """The process of the server that waits for a lock of this connection."""
    until(lambda: watch.execute(WHO_WAITS, [waits_for.info.backend_pid]).fetchone() is not None)
    (pid,) = watch.execute(WHO_WAITS, [waits_for.info.backend_pid]).fetchone() or (0,)
    return pid


@pytest.mark.parametrize("point", ["planned", "half_written"])
@pytest.mark.parametrize("what", CORRECTED)
def test_a_correction_that_is_killed_is_done_over(world: World, what: str, point: str) -> None:
    corrected = CORRECTED[what]
    hold = getattr(corrected, point)
    with closing(World(world.dsn, "uncut")) as uncut, connect(world.dsn) as holder:
        corrected.happened(uncut)
        uncut.correct()
        before = uncut.one(COUNT_AMENDED)
        corrected.happened(world)
        found = known(world)
        assert world.one(corrected.count_due) > 0
        assert before > 0
        with ExitStack() as work:
            with holder.transaction():
                holder.execute(hold, [world.map_id] if "%s" in hold else None)
                work.enter_context(correcting(world.dsn))
                killed = wait_for_the_one_that(holder, world.connection)
                assert world.one(HAS_WRITTEN, killed) == (point == "half_written")
                world.one("select pg_terminate_backend(%s)", killed)
                until(lambda: wait_for_the_one_that(holder, world.connection) != killed)
                assert world.one(COUNT_AMENDED) == before
                assert world.one(corrected.count_due) > 0
                assert known(world) == found
            until(lambda: world.one(corrected.count_due) == 0)
        assert known(world) == known(uncut)
        assert known(world) != found
        for differences in ("pair_differences", "log_differences"):
            assert world.rows(f"select * from semap.{differences}(%s)", world.map_id) == []
