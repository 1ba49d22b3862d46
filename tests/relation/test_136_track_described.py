"""What a track is said to be changes which queries are about it, and so its relations, at once."""

from __future__ import annotations

import json

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from world import SECOND_US, World

from semap.store.database.connection import connect

ROOM = shapely.box(0, 0, 4, 4)
FORKLIFT = {"op": "=", "args": [{"property": "attributes.kind"}, "forklift"]}
NAMED = {"op": "like", "args": [{"property": "name"}, "x%"]}


def concept(world: World, name: str, parent: str = "Thing") -> int:
    made = world.one("insert into semap.concept (name) values (%s) returning concept_id", name)
    world.run(
        "insert into semap.concept_parent select %s, concept_id from semap.concept where name = %s",
        made,
        parent,
    )
    return made


def ask(world: World, **columns: object) -> None:
    """Let the only query be about these tracks."""
    for name, value in columns.items():
        world.run(
            f"update semap.continuous_query set {name} = %s where query_id = %s",
            world.keep_where(value) if isinstance(value, dict) else value, world.query_id,
        )  # fmt: skip


def describe(world: World, track: int, **columns: object) -> None:
    for name, value in columns.items():
        world.run(
            f"update semap.track set {name} = %s where track_id = %s",
            json.dumps(value) if isinstance(value, dict) else value, track,
        )  # fmt: skip


def told(world: World) -> list[tuple[str, str, str, int]]:
    return [(track, kind, cause, us // SECOND_US) for track, _, kind, cause, us in world.changes()]


def held(world: World) -> set[int]:
    return {track for (track,) in world.rows("select track_id from semap.relation")}


@pytest.fixture
def room(world: World) -> World:
    world.add_room("room", ROOM)
    return world


@pytest.mark.parametrize("column", ["attributes", "name", "concept_id"])
def test_who_becomes_what_a_query_asks_for_enters_and_who_is_it_no_more_leaves(
    room: World, column: str
) -> None:
    forklift = concept(room, "Forklift")
    asked = {"attributes": {"subject_where": FORKLIFT}, "name": {"subject_where": NAMED},
             "concept_id": {"subject_concept_id": forklift}}[column]  # fmt: skip
    yes, no = {
        "attributes": ({"kind": "forklift"}, {"kind": "person"}), "name": ("xenia", "ben"), "concept_id": (forklift, None)
    }[column]  # fmt: skip
    ask(room, **asked)
    track = room.add_track("ben")
    room.add_states([(track, SECOND_US, 1.0, 1.0, None), (track, 3 * SECOND_US, 2.0, 2.0, None)])
    assert held(room) == set()
    describe(room, track, **{column: yes})
    assert held(room) == {track}
    describe(room, track, **{column: yes})  # says nothing new
    room.add_states([(track, 4 * SECOND_US, 2.5, 2.0, None)])
    describe(room, track, **{column: no})
    assert held(room) == set()
    room.add_states([(track, 5 * SECOND_US, 1.5, 2.0, None)])
    assert [each[1:] for each in told(room)] == [("began", "map", 3), ("ended", "map", 4)]
    describe(room, track, **{column: yes})
    room.add_states([(track, 6 * SECOND_US, 5.0, 2.0, None)])
    assert [each[1:] for each in told(room)][2:] == [("began", "map", 5), ("ended", "moved", 6)]


def test_a_track_that_several_queries_come_to_ask_for_is_in_each_region_once(room: World) -> None:
    """Of a query with a memory its present says in which regions it is."""
    ask(room, enter_confirm="1 s")
    for name in ("forklifts", "more forklifts"):
        room.run(
            "insert into semap.continuous_query (map_id, name, object_concept_id, subject_where)"
            " select map_id, %s, object_concept_id, %s from semap.continuous_query where query_id = %s",
            name, room.keep_where(FORKLIFT), room.query_id,
        )  # fmt: skip
    lifter = room.add_track("lifter")
    room.add_states([(lifter, at_s * SECOND_US, 2.0, 2.0, None) for at_s in (1, 5)])
    describe(room, lifter, attributes={"kind": "forklift"})
    ((ids,),) = room.rows("select stateful_ids from semap.track_now")
    assert len(ids) == len(set(ids)) == 3
    assert room.rows("select * from semap.held_differences(%s)", room.map_id) == []


def test_only_who_is_there_enters(room: World) -> None:
    ask(room, subject_where=FORKLIFT)
    outside, unseen, ended = (room.add_track(name) for name in ("outside", "unseen", "ended"))
    room.add_states([(outside, SECOND_US, 6.0, 1.0, None)])
    room.add_states([(ended, SECOND_US, 1.0, 1.0, None, True)])
    for track in (outside, unseen, ended):
        describe(room, track, attributes={"kind": "forklift"})
    assert told(room) == []
    room.add_states([(unseen, 2 * SECOND_US, 1.0, 1.0, None)])
    room.add_states([(outside, 2 * SECOND_US, 1.0, 1.0, None)])
    assert told(room) == [("unseen", "began", "appeared", 2), ("outside", "began", "moved", 2)]


def test_a_track_that_a_query_stays_about_keeps_what_waits_to_be_confirmed(room: World) -> None:
    ask(room, subject_where=FORKLIFT, enter_confirm="2 s")
    track = room.add_track("a")
    describe(room, track, attributes={"kind": "forklift"})
    room.add_states([(track, SECOND_US, 6.0, 1.0, None)])
    room.add_states([(track, 2 * SECOND_US, 2.0, 1.0, None)])
    describe(room, track, attributes={"kind": "forklift", "colour": "red"})
    room.add_states([(track, 4 * SECOND_US, 2.0, 1.5, None)])
    assert told(room) == [("a", "began", "moved", 4)]
    assert room.changes()[0][-1] == 4 * SECOND_US


def test_a_source_that_gets_another_name_takes_its_tracks_with_it(room: World) -> None:
    ask(room, subject_where={"op": "=", "args": [{"property": "source"}, "laser"]})
    room.add_states([(room.add_track("Ann"), SECOND_US, 1, 1, None)])
    assert told(room) == []
    room.run("update semap.source set name = 'laser'")
    room.run("update semap.source set name = 'laser', late_states = 1")
    room.run("update semap.source set name = 'camera'")
    assert told(room) == [("Ann", "began", "map", 1), ("Ann", "ended", "map", 1)]
    assert held(room) == set()


def test_a_concept_that_moves_takes_its_tracks_with_it(room: World) -> None:
    vehicle = concept(room, "Vehicle")
    forklift = concept(room, "Forklift")
    ask(room, subject_concept_id=vehicle)
    track = room.add_track("a")
    describe(room, track, concept_id=forklift)
    room.add_states([(track, SECOND_US, 1.0, 1.0, None)])
    assert held(room) == set()
    room.run("insert into semap.concept_parent values (%s, %s)", forklift, vehicle)
    assert held(room) == {track}
    room.run("delete from semap.concept_parent where concept_id = %s and parent_id = %s", forklift, vehicle)
    assert told(room) == [("a", "began", "map", 1), ("a", "ended", "map", 1)]


def test_many_tracks_whose_places_are_written_late_are_where_they_are(room: World) -> None:
    """While large frames follow one another, `track_now` is behind (sql/135)."""
    ask(room, subject_where=FORKLIFT)
    tracks = [room.add_track(f"t{n}") for n in range(250)]
    for second in range(3):
        room.add_states(
            [(track, SECOND_US + second * SECOND_US // 10, 0.5 + second, 0.5, None) for track in tracks]
        )
    describe(room, tracks[7], attributes={"kind": "forklift"})
    assert held(room) == {tracks[7]}
    assert room.one("select x_m from semap.track_now where track_id = %s", tracks[7]) == 2.5


@pytest.mark.parametrize("role", ["semap_api", "semap_admin", "semap_ingest"])
def test_who_brings_tracks_in_or_edits_may_describe_them(room: World, role: str) -> None:
    ask(room, subject_where=FORKLIFT)
    track = room.add_track("a")
    room.add_states([(track, SECOND_US, 1.0, 1.0, None)])
    with connect(room.dsn, role) as connection:
        connection.execute("""update semap.track set attributes = '{"kind": "forklift"}'""")
    assert held(room) == {track}


STEPS = st.lists(
    st.tuples(
        st.integers(0, 2),
        st.one_of(
            st.sampled_from([{}, {"kind": "forklift"}, {"kind": "person"}]),
            st.sampled_from([-1.0, 0.5, 2.0, 3.5, 4.5, 9.0]),
        ),
    ),
    max_size=25,
)


def test_relations_are_always_those_of_whom_the_query_is_about(room: World) -> None:
    ask(room, subject_where=FORKLIFT)
    tracks: list[int] = []

    @settings(max_examples=25)
    @given(STEPS)
    def same(steps: list[tuple[int, dict | float]]) -> None:
        for track in tracks:
            room.run("delete from semap.track where track_id = %s", track)
        tracks[:] = [room.add_track(name) for name in "abc"]
        kinds: dict[int, object] = {}
        places: dict[int, float] = {}
        log: list[tuple[int, str, str]] = []
        before: set[int] = set()
        for second, (which, step) in enumerate(steps, 1):
            track = tracks[which]
            appears = False
            if isinstance(step, dict):
                describe(room, track, attributes=step)
                kinds[track] = step.get("kind")
            else:
                appears = track not in places
                room.add_states([(track, second * SECOND_US, step, 1.0, None)])
                places[track] = step
            now = {each for each in places if 0 < places[each] < 4 and kinds.get(each) == "forklift"}
            cause = "map" if isinstance(step, dict) else "appeared" if appears else "moved"
            log += [(each, "began" if each in now else "ended", cause) for each in now ^ before]
            before = now
            assert held(room) == now
        rows = room.rows(
            "select track_id, kind::text, cause::text from semap.relation_change order by change_id"
        )
        assert rows == log

    same()
