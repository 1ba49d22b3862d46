"""States of objects: once each, with what was before them, and cut exactly by a backfill's seam."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from datetime import timedelta
from itertools import count, pairwise
from uuid import UUID

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from world import SECOND_US, World

from semap.errors import InvalidInput, NotFound
from semap.model.object_state import NewObjectState
from semap.store.database.connection import connect, one_transaction
from semap.store.motion.object_states import add_object_states, list_object_states
from semap.timeline.stamp import to_datetime

VALUES = ("open", "closed", "ajar")


def state(second: int, value: str, instance: str = "door", name: str = "door") -> NewObjectState:
    return NewObjectState(instance, name, value, to_datetime(second * SECOND_US))


def write(world: World, states: list[NewObjectState], source: str = "contacts", **options: object) -> int:
    with one_transaction(world.dsn, "semap_ingest") as connection:
        return len(add_object_states(connection, world.name, source, states, **options))


def stored(world: World) -> list[tuple]:
    return world.rows(
        "select extract(epoch from stamp)::int, value, previous, extract(epoch from since)::int"
        " from semap.object_state where map_id = %s order by stamp, value",
        world.map_id,
    )


def test_a_state_knows_what_was_before_it(world: World) -> None:
    world.add_room("door", shapely.box(0, 0, 1, 1))
    world.add_room("other", shapely.box(1, 0, 2, 1))
    states = [state(1, "open"), state(3, "open"), state(4, "closed"), state(9, "open")]
    assert write(world, [*states, state(2, "closed", "other"), state(2, "low", name="battery")]) == 6
    with one_transaction(world.dsn, "semap_read") as connection:
        found = list_object_states(connection, map_name="world", instance="door", property_name="door")
        assert list_object_states(connection, after=found[-1].id) == ()
        assert list_object_states(connection, map_name="nowhere") == ()
    assert [(s.value, s.previous, s.stamp, s.since) for s in found] == [
        ("open", None, states[0].stamp, None),
        ("open", "open", states[1].stamp, states[0].stamp),
        ("closed", "open", states[2].stamp, states[0].stamp),
        ("open", "closed", states[3].stamp, states[2].stamp),
    ]
    assert {(s.map, s.source, s.instance) for s in found} == {("world", "contacts", "door")}


def changes(seen: list[tuple[int, str]]) -> list[tuple]:
    """Second, value, value before and when that began, by a walk over the states of one property."""
    rows: list[tuple] = []
    for second, value in seen:
        before = rows[-1] if rows else (None, None, None, None)
        began = before[3] if before[1] == before[2] else before[0]
        rows.append((second, value, before[1], began))
    return rows


def test_whatever_the_batches_the_rows_are_the_same(database: str) -> None:
    names = count()

    @settings(max_examples=20, deadline=None)
    @given(
        st.lists(
            st.tuples(st.integers(0, 20), st.sampled_from(VALUES)), unique_by=lambda s: s[0], min_size=1
        ).map(sorted),
        st.data(),
    )
    def play(seen: list[tuple[int, str]], data: st.DataObject) -> None:
        cuts = sorted(data.draw(st.sets(st.integers(0, len(seen)))) | {0, len(seen)})
        again = data.draw(st.permutations(seen))
        with closing(World(database, name=f"map {next(names)}")) as world:
            world.add_room("door", shapely.box(0, 0, 1, 1))
            for begin, end in pairwise(cuts):
                assert write(world, [state(*each) for each in seen[begin:end]]) == end - begin
            assert write(world, [state(*each) for each in again]) == 0
            assert stored(world) == changes(seen)

    play()


def test_a_state_has_one_identity_wherever_it_is_played(world: World, database: str) -> None:
    world.add_room("door", shapely.box(0, 0, 1, 1))
    write(world, [state(1, "open")])
    write(world, [state(1, "open")], "others")
    first, second = (
        UUID(str(row[0])) for row in world.rows("select uid from semap.object_state order by source_id")
    )
    assert first != second
    world.run("delete from semap.source where name in ('contacts', 'others')")
    assert stored(world) == []
    assert write(world, [state(1, "open")]) == 1
    assert world.one("select uid from semap.object_state") == first


def test_a_watermark_goes_forward_only_and_with_its_states(world: World) -> None:
    world.add_room("door", shapely.box(0, 0, 1, 1))

    def watermark() -> object:
        return world.one("select watermark from semap.source where name = 'contacts'")

    noon = to_datetime(0)
    write(world, [], watermark=noon)
    assert watermark() == noon
    write(world, [], watermark=noon - timedelta(seconds=1))
    assert watermark() == noon
    with pytest.raises(NotFound, match="no instance gate"):
        write(world, [state(1, "open"), state(2, "open", "gate")], watermark=noon + timedelta(seconds=2))
    assert (watermark(), stored(world)) == (noon, [])


def test_what_cannot_be_is_refused(world: World) -> None:
    door = world.add_room("door", shapely.box(0, 0, 1, 1))
    other = World(world.dsn, name="elsewhere")
    foreign = other.add_room("far", shapely.box(0, 0, 1, 1))
    for wrong in (state(1, "open", "far"), state(1, "open", "nothing")):
        with pytest.raises(NotFound, match="There is no instance"):
            write(world, [wrong])
    with pytest.raises(InvalidInput, match="without a name"):
        write(world, [state(1, "open", name="")])
    insert = "insert into semap.object_state (source_id, instance_id, property, value, stamp) values "
    for values, words in (
        ((world.source_id, foreign), "There is no instance"),
        ((0, door), "There is no source 0"),
    ):
        with pytest.raises(Exception, match=words):
            world.run(f"{insert} (%s, %s, 'door', 'open', now())", *values)
    with pytest.raises(Exception, match="more than one source"):
        world.run(
            f"{insert} (%s, %s, 'door', 'open', now()), (%s, %s, 'door', 'open', now())",
            world.source_id, door, other.source_id, foreign,
        )  # fmt: skip
    world.run("begin isolation level repeatable read")
    with pytest.raises(Exception, match="READ COMMITTED"):
        world.run(f"{insert} (%s, %s, 'door', 'open', now())", world.source_id, door)
    world.run("rollback")
    assert stored(world) == []
    other.close()


def test_lateness_is_said_in_one_form(world: World) -> None:
    for given_, said in (("2 days", "48:00:00"), ("1500 ms", "00:00:01.5"), ("0", "00:00:00")):
        world.run("update semap.source set lateness = %s where source_id = %s", given_, world.source_id)
        assert world.one("select lateness::text from semap.source") == said
    with pytest.raises(Exception, match="lateness"):
        world.run("update semap.source set lateness = '-1 s'")


def test_the_seam_of_a_backfill_cuts_exactly(world: World) -> None:
    """Rows up to the seam are committed before the rule is, and rows beyond it begin after: by commit order."""
    world.add_room("door", shapely.box(0, 0, 1, 1))

    def many(writer: int) -> None:
        for second in range(30):
            write(world, [state(second, f"{writer}")], f"source {writer}")

    def rules() -> None:
        with connect(world.dsn, "semap_api") as connection:
            for number in range(10):
                connection.execute(
                    "insert into semap.rule (map_id, name, declaration, backfill_from)"
                    " values (%s, %s, '{}', '1800-01-01Z')",
                    [world.map_id, f"rule {number}"],
                )

    with ThreadPoolExecutor() as pool:
        writing = [pool.submit(many, writer) for writer in range(3)]
        rules()
        for each in writing:
            each.result()
    written = world.rows("select object_state_id, xmin::text::bigint from semap.object_state")
    seams = world.rows(
        "select (seam ->> 'object_state_id')::bigint, xmin::text::bigint from semap.rule where seam is not null"
    )
    assert len(seams) == 10
    for seam, rule_xid in seams:
        assert all((number <= seam) == (xid < rule_xid) for number, xid in written)
