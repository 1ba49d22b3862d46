"""States in any order leave the history that the same states leave in the order of their stamps."""

from __future__ import annotations

import random
from uuid import uuid4

from careful_oracle import Asked, Follower, Sample
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from test_careful_queries import asked, walk
from test_oracle import BANDS, SHAPES
from world import World

QUICK = settings(
    max_examples=6,
    phases=[Phase.generate],
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
STANDING = """
    select query_name, track_name, instance_name, kind::text, cause::text, stamp, edge_at, since, x_m, y_m
    from semap.relation_change c
    where map_id = %s and amendment is distinct from 'retracted'
      and not exists (select from semap.relation_change d where d.retracts = c.uid)
    order by query_name, track_name, instance_name, stamp, edge_at, cause = 'disappeared', kind desc
"""
PAST = """
    select query_name, track_name, instance_name, since, until from semap.relation_past where map_id = %s
    order by 1, 2, 3, 4, 5
"""
HELD = """
    select r.query_name, t.name, r.instance_name, n.since, r.region_id = any (w.region_ids || w.careful_ids)
    from semap.relation n join semap.region r using (region_id) join semap.track t using (track_id)
    join semap.track_now w using (track_id)
    where n.map_id = %s order by 1, 2, 3
"""
VERGES = """
    select r.query_name, t.name, r.instance_name, v.held, v.inside, v.side,
           case when v.inside <> v.held then v.inside_at end,
           case when v.inside <> v.held and v.side <> v.held then v.side_at end
    from semap.verge v join semap.region r using (region_id) join semap.track t using (track_id)
    where v.map_id = %s order by 1, 2, 3
"""
PRESENT = """
    select t.name, n.live, n.stamp, n.x_m, n.y_m, n.calm_until::text, cardinality(n.region_ids), cardinality(n.careful_ids)
    from semap.track_now n join semap.track t using (track_id) where n.map_id = %s order by 1
"""
NEW = """
    select change_id, uid, amendment, retracts, query_name, track_name, instance_name, kind::text, cause::text, stamp,
           edge_at, since, x_m, y_m
    from semap.relation_change where map_id = %s and change_id > %s order by change_id
"""
NAMED = """
    select count(*) from semap.relation_change c join semap.track t using (track_id) join semap.instance i using (instance_id)
    where c.map_id = %s and amendment is distinct from 'retracted'
      and not exists (select from semap.relation_change d where d.retracts = c.uid)
      and c.uid <> semap.change_uid(c.query_name, t.uid, i.uid, c.kind::text, c.cause::text, c.edge_at)
"""


class Client:
    """Somebody who follows the log: what was added stands until it is taken back.

    What was taken back and stands again between two looks was never away: what it was called meanwhile is nobody's.
    """

    def __init__(self, world: World) -> None:
        self.world, self.last, self.standing = world, 0, {}

    def read(self) -> None:
        for change_id, uid, amendment, retracts, *said in self.world.rows(NEW, self.world.map_id, self.last):
            self.last = change_id
            if amendment == "retracted":
                self.standing.pop(retracts, None)
            else:
                self.standing[uid] = said


def scene(database: str, question: Asked, rooms: list, jump_m: float | None) -> World:
    """A map with a plain and a careful query."""
    world = World(database, f"map {uuid4()}")
    world.run(
        "insert into semap.continuous_query (map_id, name, object_concept_id)"
        " select %s, 'plain', concept_id from semap.concept where name = 'Room'", world.map_id,
    )  # fmt: skip
    world.ask(question)
    for number, (shape, band) in enumerate(rooms):
        world.add_room(f"r{number}", shape, band)
    world.run("update semap.source set jump_m = %s where source_id = %s", jump_m, world.source_id)
    return world


def shuffled(dice: random.Random, seen: list[Sample]) -> list[list[Sample]]:
    """The same states in statements, in an order that is random within some reach or altogether."""
    reach = dice.choice([0, 3, 10, len(seen)])
    order = sorted(range(len(seen)), key=lambda place: place + dice.uniform(0, reach))
    parts, start = [], 0
    while start < len(seen):
        end = start + dice.choice([1, 1, 1, 2, 5, 20])
        parts.append([seen[place] for place in order[start:end]])
        start = end
    return parts


def told(world: World) -> list:
    return [world.rows(statement, world.map_id) for statement in (STANDING, PAST, HELD, VERGES, PRESENT)]


@QUICK
@given(
    question=asked,
    rooms=st.lists(st.tuples(st.sampled_from(SHAPES), st.sampled_from(BANDS)), min_size=1, max_size=3),
    jump_m=st.sampled_from([None, 1000.0]),
    seed=st.integers(0, 2**32),
)
def test_states_in_any_order_leave_the_same_history(
    database: str, question: Asked, rooms: list, jump_m: float | None, seed: int
) -> None:
    dice = random.Random(seed)
    one, other = (scene(database, question, rooms, jump_m) for _ in range(2))
    try:
        client = Client(other)
        for name in ("a", "b"):
            seen = walk(dice, 30)
            one_id, other_id = one.add_track(name), other.add_track(name)
            for sample in seen:
                one.add_samples(one_id, [sample])
            for part in shuffled(dice, seen):
                other.add_samples(other_id, part)
                client.read()
            if dice.random() < 0.3:
                end_us = seen[-1].stamp_us + dice.choice([0, 500_000])
                one.end_track(one_id, end_us)
                other.end_track(other_id, end_us)
                client.read()
            for number, (shape, band) in enumerate(rooms):
                oracle = Follower(shape, band, question)
                for sample in seen:
                    oracle.take(sample)
                found = one.rows(
                    "select kind::text, cause::text, (extract(epoch from stamp) * 1000000)::bigint"
                    " from semap.relation_change where query_id = %s and track_name = %s and instance_name = %s"
                    " order by change_id limit %s",
                    one.query_id, name, f"r{number}", len(oracle.found),
                )  # fmt: skip
                assert found == [(f.kind, f.cause, f.stamp_us) for f in oracle.found]
        for ours, theirs in zip(told(other), told(one), strict=True):
            assert ours == theirs
        assert sorted(map(repr, client.standing.values())) == sorted(repr(list(r)) for r in told(one)[0])
        assert other.one(NAMED, other.map_id) == 0
    finally:
        one.close()
        other.close()
