"""Tracks that are in pairs go on at another source, or are described in another way; concepts move."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest
from pair_oracle import Question, Thing
from pair_town import Town
from test_concurrency import PATIENCE_S, await_lock
from world import SECOND_US, World

from semap.store.database.connection import connect
from semap.store.operate.doctor.verification import verify

NEAR = Question("within_distance", distance_m=2.0)


@pytest.fixture
def town(database: str) -> Iterator[Town]:
    """Two tracks of two sources, a metre apart since the second one came."""
    made = Town(database, NEAR, "world")
    for source, name in enumerate("ab"):
        made.track(name, source)
    move(made, "a", 1, 0.0)
    move(made, "b", 2, 1.0)
    yield made
    made.close()


def move(town: Town, name: str, second: int, x_m: float) -> None:
    town.see((Thing(name, town.uid(name), True, stamp_us=second * SECOND_US, x_m=x_m), False))
    town.settle()


def hand_over(town: Town, name: str, source: int) -> None:
    town.world.run("select semap.hand_over_tracks(%s, %s)", [town.tracks[name]], town.sources[source])


def told(world: World) -> list[tuple[str, str, str, str, int]]:
    return world.rows(
        "select track_name, object_track_name, kind::text, cause::text, extract(epoch from stamp)::integer"
        " from semap.relation_change order by change_id"
    )


def is_right(town: Town) -> bool:
    verification = verify(town.world.dsn, lambda said: None)
    with verification.connection:
        return not any(each.differ for each in verification.look(None))


def test_pairs_hold_while_a_track_goes_on_at_another_source(town: Town) -> None:
    hand_over(town, "b", 0)
    town.check()
    assert len(told(town.world)) == 2
    assert is_right(town)
    move(town, "b", 3, 1.5)
    hand_over(town, "a", 1)
    move(town, "a", 4, 9.0)
    move(town, "b", 5, 9.0)
    town.check()
    assert [each[2:] for each in told(town.world)] == [
        ("began", "appeared", 2), ("began", "appeared", 2), ("ended", "moved", 4), ("ended", "moved", 4),
        ("began", "moved", 5), ("began", "moved", 5)]  # fmt: skip
    assert is_right(town)


def test_a_query_about_a_source_follows_who_goes_there(town: Town) -> None:
    condition = {"op": "=", "args": [{"property": "source"}, "other"]}
    town.world.run(
        "update semap.continuous_query set object_where = %s where in_pairs", town.world.keep_where(condition)
    )
    before = len(told(town.world))
    hand_over(town, "a", 1)
    hand_over(town, "b", 0)
    hand_over(town, "b", 1)
    assert told(town.world)[before:] == [
        ("b", "a", "began", "map", 2), ("a", "b", "ended", "map", 2), ("a", "b", "began", "map", 2)]  # fmt: skip
    assert is_right(town)
    move(town, "b", 3, 5.0)
    assert told(town.world)[before + 3 :] == [
        ("a", "b", "ended", "moved", 3),
        ("b", "a", "ended", "moved", 3),
    ]
    assert is_right(town)


def test_a_track_of_another_name_keeps_its_pairs_and_is_told_of_by_it(town: Town) -> None:
    town.world.run("update semap.track set name = 'ann' where name = 'a'")
    assert len(told(town.world)) == 2
    assert is_right(town)
    move(town, "b", 3, 5.0)
    assert told(town.world)[2:] == [("ann", "b", "ended", "moved", 3), ("b", "ann", "ended", "moved", 3)]


def test_who_is_nearest_of_two_is_said_by_the_identity_that_they_have_now(database: str) -> None:
    town = Town(database, Question("nearest", count=1), "world")
    for name, x in (("a", 0.0), ("b", 1.0), ("c", -1.0)):
        town.track(name)
        move(town, name, 1, x)
    nearest = (
        "select o.name from semap.relation p join semap.track s using (track_id)"
        " join semap.track o on o.track_id = object_track_id where confirmed and s.name = 'a'"
    )
    for last, first in (("b", "c"), ("c", "b"), ("b", "c")):
        for name, digit in ((last, "f"), (first, "0")):
            uid = f"{digit * 8}-{digit * 4}-4{digit * 3}-8{digit * 3}-{digit * 12}"
            town.world.run("update semap.track set uid = %s where name = %s", uid, name)
        assert town.world.rows(nearest) == [(first,)]
        assert is_right(town)
        town.world.run("update semap.track set uid = gen_random_uuid()")
    town.close()


@pytest.mark.parametrize("side", ["subject", "object"])
def test_a_concept_that_moves_takes_the_pairs_of_its_tracks_with_it(town: Town, side: str) -> None:
    world = town.world
    vehicle, forklift = (
        world.one("insert into semap.concept (name) values (%s) returning concept_id", name)
        for name in ("Vehicle", "Forklift")
    )
    world.run("update semap.track set concept_id = %s where name = 'a'", forklift)
    world.run(f"update semap.continuous_query set {side}_concept_id = %s where in_pairs", vehicle)
    before = len(told(world))
    assert world.one("select count(*) from semap.relation") == 0
    pair = ("a", "b") if side == "subject" else ("b", "a")
    for came, went in ((2, 3), (4, 5)):
        world.run("insert into semap.concept_parent values (%s, %s)", forklift, vehicle)
        assert told(world)[before:] == [(*pair, "began", "map", came)]
        assert is_right(town)
        move(town, "b", went, 1.25)
        world.run("delete from semap.concept_parent where concept_id = %s", forklift)
        assert told(world)[before + 1 :] == [(*pair, "ended", "map", went)]
        assert is_right(town)
        move(town, "a", went + 1, 0.0)
        before += 2


@pytest.mark.parametrize("column", ["source_id", "uid", "name", "map_id"])
def test_who_describes_a_track_by_hand_waits_for_writers_before_any_row(town: Town, column: str) -> None:
    """Whoever held its row and waited for regions then would stop an edit that holds regions and wants the row."""
    with connect(town.world.dsn, autocommit=False) as writer, ThreadPoolExecutor() as pool:
        writer.execute("select semap.lock_regions_shared()")
        waiting = pool.submit(town.world.run, f"update semap.track set {column} = {column}")
        with connect(town.world.dsn) as observer:
            await_lock(observer)
            assert len(observer.execute("select from semap.track for update nowait").fetchall()) == 2
        writer.commit()
        waiting.result(PATIENCE_S)
