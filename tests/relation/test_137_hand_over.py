"""A track that goes on at another source, or is described anew: its relations hold, and queries about it follow."""

from __future__ import annotations

import random
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import psycopg
import pytest
import shapely
from semap_ingest.replay import Plan, replay
from semap_ingest.track_file import Tracks
from test_concurrency import PATIENCE_S, await_lock
from world import SECOND_US, World

from semap.errors import Conflict
from semap.store.database.connection import connect

IN_ROOM, OUTSIDE = (2.0, 2.0), (20.0, 20.0)
HAND_OVER = "select semap.hand_over_tracks(%s, %s)"


def ask_about(world: World, name: str, said: str, value: str) -> None:
    condition = {"op": "=", "args": [{"property": said}, value]}
    world.run(
        "insert into semap.continuous_query (map_id, name, object_concept_id, subject_where)"
        " select %s, %s, concept_id, %s from semap.concept where name = 'Room'",
        world.map_id, name, world.keep_where(condition),
    )  # fmt: skip


def told(world: World, query: str) -> list[tuple]:
    return world.rows(
        "select track_name, kind::text, cause::text, (extract(epoch from stamp) * 1000000)::bigint"
        " from semap.relation_change where query_name = %s order by change_id", query,
    )  # fmt: skip


def test_a_track_goes_on_at_another_source(world: World) -> None:
    world.add_room("room", shapely.box(0, 0, 4, 4))
    other = world.add_source("other")
    ask_about(world, "seen by the other", "source", "other")
    track = world.add_track("t")
    world.add_states([(track, SECOND_US, *IN_ROOM, None)])
    world.run(HAND_OVER, [track], other)
    world.add_states([(track, 2 * SECOND_US, 2.5, 2.0, None)])
    world.add_states([(track, 3 * SECOND_US, *OUTSIDE, None)])
    assert told(world, "track_in_room") == [
        ("t", "began", "appeared", SECOND_US),
        ("t", "ended", "moved", 3 * SECOND_US),
    ]
    assert told(world, "seen by the other") == [
        ("t", "began", "map", SECOND_US),
        ("t", "ended", "moved", 3 * SECOND_US),
    ]
    world.add_states([(track, 4 * SECOND_US, *IN_ROOM, None)])
    world.run(HAND_OVER, [track], world.source_id)
    assert told(world, "seen by the other")[2:] == [
        ("t", "began", "moved", 4 * SECOND_US),
        ("t", "ended", "map", 4 * SECOND_US),
    ]
    assert world.one("select track_states from semap.source_count where source_id = %s", other) == 3


def test_positions_of_both_sources_are_flushed(world: World) -> None:
    """Positions that were not flushed are, and no state of a track is late since others came later."""
    world.add_room("room", shapely.box(0, 0, 4, 4))
    sources = [world.source_id, world.add_source("other")]
    tracks = [[world.add_track(f"{s} {n}", source) for n in range(210)] for s, source in enumerate(sources)]
    dice = random.Random(2)
    places = {track: [dice.uniform(0, 8), dice.uniform(0, 4)] for own in tracks for track in own}
    for frame in range(1, 8):
        for own, ahead_us in zip(tracks, (0, 5 * SECOND_US), strict=True):
            for track in own:
                places[track][0] += dice.gauss(0, 0.05)
            world.add_states(
                [(track, frame * SECOND_US // 10 + ahead_us, *places[track], None) for track in own]
            )
    assert world.one("select count(*) from semap.source_count where unflushed > 0") == 2
    given = tracks[0].pop()
    world.run(HAND_OVER, [given], sources[1])
    assert (
        world.one("select extract(epoch from stamp)::float8 from semap.track_now where track_id = %s", given)
        == 0.7
    )
    world.add_states([(given, SECOND_US, 3.0, 3.0, None)])
    assert world.one("select sum(late_states) from semap.source") == 0
    truth = world.rows("select p.track_id from semap.present_places(%s) p where st_contains('polygon((0 0,4 0,4 4,0 4,0 0))',"
                       " st_point(p.x_m, p.y_m)) order by 1", world.map_id)  # fmt: skip
    assert world.rows("select track_id from semap.relation order by 1") == truth


def test_two_sources_that_hand_tracks_to_each_other_take_turns(world: World) -> None:
    other = world.add_source("other")
    mine, theirs = world.add_track("mine"), world.add_track("theirs", other)
    with connect(world.dsn, autocommit=False) as first, ThreadPoolExecutor() as pool:
        first.execute(HAND_OVER, [[mine], other])
        second = pool.submit(world.run, HAND_OVER, [theirs], world.source_id)
        with connect(world.dsn) as observer:
            await_lock(observer)
        first.commit()
        second.result(PATIENCE_S)
    assert dict(world.rows("select name, source_id from semap.track")) == {
        "mine": other,
        "theirs": world.source_id,
    }


def test_who_has_written_states_hands_over_later(world: World) -> None:
    other, track = world.add_source("other"), world.add_track("t")
    with connect(world.dsn, autocommit=False) as writer:
        writer.execute(
            "insert into semap.track_state (track_id, stamp, x_m, y_m) values (%s, now(), 0, 0)", [track]
        )
        with pytest.raises(psycopg.Error, match="transaction of its own"):
            writer.execute(HAND_OVER, [[track], other])


@pytest.mark.parametrize("column", ["source_id", "map_id", "uid", "name", "concept_id", "attributes"])
def test_who_describes_a_track_holds_regions_before_its_row(world: World, column: str) -> None:
    world.add_track("t")
    with connect(world.dsn, autocommit=False) as writer:
        writer.execute(f"update semap.track set {column} = {column} where false")
        held = "select mode from pg_locks where pid = pg_backend_pid() and locktype = 'advisory' and classid = 7363"
        assert writer.execute(held).fetchall() == [("ExclusiveLock",)]


def test_a_track_stays_on_its_map(world: World) -> None:
    elsewhere = World(world.dsn, "elsewhere")
    track = world.add_track("t")
    with pytest.raises(psycopg.Error, match="stays on its map"):
        world.run(HAND_OVER, [track], elsewhere.source_id)
    elsewhere.close()


def test_a_track_that_is_described_anew(world: World) -> None:
    world.add_room("room", shapely.box(0, 0, 4, 4))
    ask_about(world, "of robots", "name", "robot")
    track = world.add_track("t")
    world.add_states([(track, SECOND_US, *IN_ROOM, None)])
    world.run("update semap.track set name = 'robot' where track_id = %s", track)
    world.run('update semap.track set attributes = \'{"kind": "cart"}\' where track_id = %s', track)
    world.run("update semap.track set name = 'other' where track_id = %s", track)
    assert told(world, "of robots") == [
        ("robot", "began", "map", SECOND_US),
        ("other", "ended", "map", SECOND_US),
    ]
    assert world.one("select stateful_ids = '{}' from semap.track_now")


def test_a_track_that_comes_while_a_query_is_added_is_chosen(world: World) -> None:
    world.add_room("room", shapely.box(0, 0, 4, 4))
    condition = world.keep_where({"op": "=", "args": [{"property": "name"}, "t"]})
    with connect(world.dsn, autocommit=False) as editor, ThreadPoolExecutor() as pool:
        editor.execute(
            "insert into semap.continuous_query (map_id, name, object_concept_id, subject_where)"
            " select %s, 'all', concept_id, %s from semap.concept where name = 'Room'", [world.map_id, condition],
        )  # fmt: skip
        coming = pool.submit(world.add_track, "t")
        with connect(world.dsn) as observer:
            await_lock(observer)
        editor.commit()
        coming.result(PATIENCE_S)
    assert world.one("select count(*) from semap.query_track") == 1


def recording(names: list[str], first_us: int) -> Tracks:
    count = 3 * len(names)
    number = np.tile(np.arange(len(names)), 3)
    stamps_us = first_us + np.repeat(np.arange(3), len(names)) * SECOND_US
    nothing = np.full(count, np.nan)
    place = np.full(count, 2.0)
    return Tracks(tuple(names), number, stamps_us, place, place, *[nothing] * 4)


def test_a_recording_goes_on_with_a_track_from_elsewhere(world: World) -> None:
    world.add_room("room", shapely.box(0, 0, 4, 4))
    replay(world.dsn, Plan("world", "a", "", "1", keep_open=True), recording(["t", "u"], 10 * SECOND_US))
    other = world.add_source("b")
    world.run("select semap.hand_over_tracks(array[track_id], %s) from semap.track where name = 't'", other)
    replay(world.dsn, Plan("world", "b", "", "2", keep_open=True), recording(["t"], 20 * SECOND_US))
    assert world.one("select count(*) from semap.track") == 2
    assert [change[:4] for change in world.changes()] == [
        ("t", "room", "began", "appeared"),
        ("u", "room", "began", "appeared"),
    ]
    with pytest.raises(Conflict, match="t of the source a was handed over to b"):
        replay(world.dsn, Plan("world", "a", "", "3"), recording(["t"], 30 * SECOND_US))
    replay(world.dsn, Plan("world", "a", "", "4", keep_open=True), recording(["u"], 30 * SECOND_US))
