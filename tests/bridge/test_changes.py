"""Changes of relations go out once each and in their order, whoever commits first."""

from __future__ import annotations

import json
from pathlib import Path

import shapely
from bridging import entry, running
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from patience import until
from world import SECOND_US, World

from semap.store.database.connection import connect, one_session
from semap.store.relation.changes import ChangeReader, newest_change

CHANGE = (
    "insert into semap.relation_change (uid, map_id, query_id, query_name, track_id, track_name, instance_id,"
    " instance_name, kind, cause, stamp, transition_at, since)"
    " values (gen_random_uuid(), %s, 1, 'q', 1, 't', 1, 'room', 'began', 'moved', now(), now(), now())"
    " returning change_id"
)
STEPS = st.lists(st.tuples(st.sampled_from(["write", "commit", "read"]), st.integers(0, 2)), max_size=25)


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(steps=STEPS)
def test_whoever_commits_first_none_is_passed_over(world: World, steps: list[tuple[str, int]]) -> None:
    """Three writers whose transactions overlap in any way, and a reader between them."""
    writers = [connect(world.dsn, autocommit=False) for _ in range(3)]
    written: list[int] = []
    told: list[int] = []
    with one_session(world.dsn) as engine:
        reader = ChangeReader("world")
        with engine.connect() as connection:
            cursor = newest_change(connection)

        def read() -> None:
            nonlocal cursor
            with engine.begin() as connection:
                changes, cursor, _ = reader.read(connection, cursor, 100)
            told.extend(each.seq for each in changes)

        for what, who in steps:
            if what == "write":
                written += writers[who].execute(CHANGE, [world.map_id]).fetchone()
            elif what == "commit":
                writers[who].commit()
            else:
                read()
        for each in writers:
            each.commit()
            each.close()
        for _ in range(2):
            read()
    assert told == sorted(written)


def test_changes_are_written_to_a_file_once(world: World, tmp_path: Path) -> None:
    world.add_room("kitchen", shapely.box(0, 0, 4, 4))
    track_id = world.add_track("cat")
    out = tmp_path / "changes.ndjson"
    one = entry(tmp_path, write_changes="changes.ndjson", from_start=True)
    for number, x_m in enumerate((1.0, 9.0, 1.0, 9.0)):
        with running(world, one):
            world.add_states([(track_id, number * SECOND_US, x_m, 1.0, 1.0)])
            until(lambda number=number: out.exists() and out.read_bytes().count(b"\n") == number + 1)
    said = [json.loads(each) for each in out.read_bytes().splitlines()]
    assert [each["type"] for each in said] == ["semap.relation.began", "semap.relation.ended"] * 2
    assert [each["id"] for each in said] == [
        str(uid) for (uid,) in world.rows("select uid from semap.relation_change order by change_id")
    ]
    assert {each["data"]["object"] for each in said} == {"kitchen"}


def test_a_filter_takes_changes_of_one_kind(world: World, tmp_path: Path) -> None:
    world.add_room("kitchen", shapely.box(0, 0, 4, 4))
    world.add_room("hall", shapely.box(4, 0, 20, 4))
    track_id = world.add_track("cat")
    out = tmp_path / "changes.ndjson"
    wanted = "object = 'kitchen' AND kind = 'ended' AND stamp > TIMESTAMP('1970-01-01T00:00:01Z')"
    one = entry(tmp_path, write_changes="changes.ndjson", from_start=True, changes_filter=wanted)
    for number, x_m in enumerate((1.0, 6.0, 1.0, 9.0, 1.0, 10.0)):
        world.add_states([(track_id, number * SECOND_US, x_m, 1.0, 1.0)])
    with running(world, one):
        until(lambda: out.exists() and out.read_bytes().count(b"\n") == 2)
    said = [json.loads(each)["data"] for each in out.read_bytes().splitlines()]
    assert [(each["kind"], each["object"], each["stamp"]) for each in said] == [
        ("ended", "kitchen", "1970-01-01T00:00:03.000000Z"),
        ("ended", "kitchen", "1970-01-01T00:00:05.000000Z"),
    ]
