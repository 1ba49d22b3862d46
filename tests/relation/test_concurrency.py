"""Two writers and an editor of the map at once: nobody misses what another committed."""

from __future__ import annotations

import random
import time
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor

import psycopg
import pytest
import shapely
from patience import moment
from world import SECOND_US, World

from semap.store.database.connection import connect

PATIENCE_S = 20.0
IN_ROOM, OUTSIDE = (2.0, 2.0), (20.0, 20.0)


def await_lock(observer: psycopg.Connection) -> None:
    """Until some session of this database waits for a lock."""
    deadline_s = time.monotonic() + PATIENCE_S
    while (
        observer.execute(
            "select from pg_stat_activity where datname = current_database() and wait_event_type = 'Lock'"
        ).fetchone()
        is None
    ):
        assert time.monotonic() < deadline_s
        moment()


def copy_state(dsn: str, track_id: int, stamp_us: int, place: tuple[float, float]) -> None:
    with connect(dsn) as connection:
        connection.execute(
            "insert into semap.track_state (track_id, stamp, x_m, y_m)"
            " values (%s, to_timestamp(%s / 1e6), %s, %s)", [track_id, stamp_us, *place],
        )  # fmt: skip


def test_a_state_that_waited_for_an_edit_sees_the_edited_room(world: World) -> None:
    world.add_room("room", shapely.box(0, 0, 4, 4))
    track = world.add_track("t")
    world.add_states([(track, SECOND_US, *IN_ROOM, None)])
    with connect(world.dsn, autocommit=False) as editor, ThreadPoolExecutor() as pool:
        editor.execute(
            "update semap.abstraction set geometry = st_makeenvelope(10, 10, 14, 14) where type = 'Footprint'"
        )
        writing = pool.submit(copy_state, world.dsn, track, 2 * SECOND_US, (12.0, 12.0))
        await_lock(world.connection)
        editor.commit()
        writing.result(PATIENCE_S)
    assert world.changes() == [
        ("t", "room", "began", "appeared", SECOND_US),
        ("t", "room", "ended", "map", SECOND_US),
        ("t", "room", "began", "moved", 2 * SECOND_US),
    ]


def test_an_edit_that_waited_for_a_state_sees_where_the_track_is(world: World) -> None:
    world.add_room("room", shapely.box(0, 0, 4, 4))
    track = world.add_track("t")
    world.add_states([(track, SECOND_US, *OUTSIDE, None)])
    with connect(world.dsn, autocommit=False) as writer, ThreadPoolExecutor() as pool:
        writer.execute("insert into semap.track_state (track_id, stamp, x_m, y_m)"
                       " values (%s, to_timestamp(2), 2, 2)", [track])  # fmt: skip
        editing = pool.submit(world.edit_room, "room", shapely.box(0, 0, 1, 1))
        with connect(world.dsn) as observer:
            await_lock(observer)
        writer.commit()
        editing.result(PATIENCE_S)
    assert world.changes() == [
        ("t", "room", "began", "moved", 2 * SECOND_US),
        ("t", "room", "ended", "map", 2 * SECOND_US),
    ]
    assert world.relations() == set()


def test_two_writers_of_one_source_take_turns(world: World) -> None:
    world.add_room("room", shapely.box(0, 0, 4, 4))
    track = world.add_track("t")
    with connect(world.dsn, autocommit=False) as first, ThreadPoolExecutor() as pool:
        first.execute("insert into semap.track_state (track_id, stamp, x_m, y_m)"
                      " values (%s, to_timestamp(1), 2, 2)", [track])  # fmt: skip
        second = pool.submit(copy_state, world.dsn, track, 2 * SECOND_US, OUTSIDE)
        await_lock(world.connection)
        first.commit()
        second.result(PATIENCE_S)
    assert [change[2:] for change in world.changes()] == [
        ("began", "appeared", SECOND_US),
        ("ended", "moved", 2 * SECOND_US),
    ]


def test_another_isolation_level_is_refused(world: World) -> None:
    track = world.add_track("t")
    with connect(world.dsn, autocommit=False) as writer:
        writer.isolation_level = psycopg.IsolationLevel.REPEATABLE_READ
        with pytest.raises(psycopg.Error, match="READ COMMITTED"):
            writer.execute("insert into semap.track_state values (%s, now(), 0, 0)", [track])


def test_a_query_added_while_a_room_is_being_added_sees_it(world: World) -> None:
    track = world.add_track("t")
    world.add_states([(track, SECOND_US, *IN_ROOM, None)])
    with connect(world.dsn, autocommit=False) as editor, ThreadPoolExecutor() as pool:
        mine = World.__new__(World)
        mine.__dict__.update(world.__dict__, connection=editor)
        mine.add_room("room", shapely.box(0, 0, 4, 4))
        adding = pool.submit(
            world.run,
            "insert into semap.continuous_query (map_id, name, object_concept_id)"
            " select %s, 'second', concept_id from semap.concept where name = 'Space'", world.map_id,
        )  # fmt: skip
        with connect(world.dsn) as observer:
            await_lock(observer)
        editor.commit()
        adding.result(PATIENCE_S)
    assert world.one("select count(*) from semap.region") == 2
    assert world.one("select count(*) from semap.relation") == 2


@pytest.mark.parametrize(
    "other",
    ["delete from semap.map", "delete from semap.source", "update semap.track set ended_at = '2026-02-01Z'"],
)
def test_a_writer_and_who_deletes_or_ends_its_tracks_do_not_block_each_other(
    world: World, other: str
) -> None:
    world.add_room("room", shapely.box(0, 0, 4, 4))
    first, second = world.add_track("a"), world.add_track("b")
    insert = "insert into semap.track_state (track_id, stamp, x_m, y_m, is_last) values (%s, %s, 2, 2, true)"
    with connect(world.dsn, autocommit=False) as writer, ThreadPoolExecutor() as pool:
        writer.execute(insert, [first, "2026-01-01Z"])
        changing = pool.submit(world.run, other)
        with connect(world.dsn) as observer:
            await_lock(observer)
        writer.execute(insert, [second, "2026-01-01Z"])
        writer.commit()
        changing.result(PATIENCE_S)
    assert world.one("select count(*) from semap.relation") == 0
    if other.startswith("delete"):
        assert world.one("select count(*) from semap.stored_state") == 0
        assert world.one("select count(*) from semap.relation_change") == 0


def test_who_registers_a_source_and_who_deletes_its_map_do_not_block_each_other(world: World) -> None:
    """The key of a new source holds its map's row; the regions, which its tracks need next, are held before that."""
    with connect(world.dsn, autocommit=False) as writer, ThreadPoolExecutor() as pool:
        (source_id,) = writer.execute(
            "insert into semap.source (map_id, name) values (%s, 'new') returning source_id", [world.map_id]
        ).fetchone()
        deleting = pool.submit(world.run, "delete from semap.map")
        with connect(world.dsn) as observer:
            await_lock(observer)
        writer.execute(
            "insert into semap.track (uid, source_id, map_id, name) values (gen_random_uuid(), %s, %s, 't')",
            [source_id, world.map_id],
        )
        writer.commit()
        deleting.result(PATIENCE_S)
    assert world.one("select count(*) from semap.track") == 0


@pytest.mark.parametrize("seed", range(2))
def test_writers_and_an_editor_at_once_leave_the_truth(world: World, seed: int) -> None:
    rooms = {f"room {i}": shapely.box(i * 4, 0, i * 4 + 4, 4) for i in range(3)}
    for name, footprint in rooms.items():
        world.add_room(name, footprint)
    sources = [world.add_source(f"source {i}") for i in range(3)]
    tracks = [[world.add_track(f"{s} {t}", source) for t in range(4)] for s, source in enumerate(sources)]

    def write(number: int) -> None:
        dice = random.Random(seed * 10 + number)
        with connect(world.dsn) as connection, connection.cursor() as cursor:
            for batch in range(60):
                with cursor.copy("copy semap.track_state (track_id, stamp, x_m, y_m) from stdin") as copy:
                    for step in range(3):
                        for track in tracks[number]:
                            stamp = f"2026-01-01 00:{batch:02d}:{step:02d}+00"
                            copy.write_row((track, stamp, dice.uniform(-1, 13), dice.uniform(-1, 5)))

    def edit() -> None:
        dice = random.Random(seed)
        with connect(world.dsn) as connection:
            for _ in range(40):
                x_m, name = dice.uniform(0, 8), dice.choice(list(rooms))
                connection.execute(
                    "update semap.abstraction a set geometry = st_makeenvelope(%s, 0, %s, 4)"
                    " from semap.instance i where i.name = %s and a.description_id = i.absolute_description_id",
                    [x_m, x_m + 4, name],
                )

    with ThreadPoolExecutor() as pool:
        for job in [*(pool.submit(write, number) for number in range(3)), pool.submit(edit)]:
            job.result(PATIENCE_S * 3)
    truth = world.rows(
        "select t.name, i.name from semap.track_now n join semap.track t using (track_id) join semap.instance i"
        " on i.map_id = n.map_id join semap.abstraction a on a.description_id = i.absolute_description_id"
        " where st_contains(a.geometry, st_point(n.x_m, n.y_m)) order by 1, 2"
    )
    assert world.rows("select track, instance from semap.relation_now order by 1, 2") == truth
    held = defaultdict(int)
    for track, room, kind, _, _ in world.changes():
        held[track, room] += 1 if kind == "began" else -1
        assert held[track, room] in (0, 1)
    assert sorted(pair for pair, count in held.items() if count) == truth
