"""Rules and states that come late: in any order within the lateness nothing differs; what is taken back later is kept."""

from __future__ import annotations

import random

import pytest
from door_scene import DoorScene
from rule_work import await_progress, running_worker
from test_backfill import RULES, made_by, should_be
from world import World

from semap.worker.late_replay import Replay, replay_late

TAKEN_BACK = """
    select l.input, l.stamp from semap.late_row l
    join semap.relation_change c on c.uid::text = l.uid and c.amendment = 'retracted'
"""
VERDICTS = (
    "select e.type, a.verdict from semap.event e join semap.event_amendment a using (event_id) order by 1"
)


@pytest.mark.parametrize("seed", range(2))
def test_states_in_any_order_within_the_lateness_give_the_same_events(world: World, seed: int) -> None:
    """Each state is a statement of its own, up to 2 s behind those of later stamps."""
    scene, dice = DoorScene(world), random.Random(seed)
    world.run("delete from semap.rule")
    world.run("update semap.source set lateness = '2 s', jump_m = null")
    world.run("update semap.source set ended = true where source_id = %s", scene.door_source_id)
    scene.add_rule("stayed", RULES["stayed"])
    way = [(100 + i / 2, dice.uniform(2.5, 5.5), 2.0) for i in range(40)]
    scene.walk("ann", [(99, 1.0, 2.0)])
    with running_worker(world.dsn):
        newest_s = 99.0
        for state in sorted(way, key=lambda state: state[0] + dice.uniform(0, 1.9)):
            newest_s = max(newest_s, state[0])
            with world.connection.transaction():
                scene.walk("ann", [state])
                scene.watermark(newest_s, world.source_id)
        scene.watermark(200, world.source_id)
        await_progress(world.dsn)
    assert world.one("select late_states from semap.source where source_id = %s", world.source_id) > 5
    assert world.one("select count(*) from semap.relation_change where amendment = 'retracted'") > 0
    assert world.rows("select from semap.late_row") == []
    made = made_by(world, "stayed")
    assert made == should_be(world, "stayed", RULES["stayed"], None)
    assert len(made) > 0


def test_what_is_taken_back_too_late_is_kept_and_retracts_events(world: World) -> None:
    """She was told to be in the west at 100 s and to have come east at 110 s; late it shows that she was east at 105 s."""
    scene = DoorScene(world)
    world.run("update semap.source set ended = true where source_id = %s", scene.door_source_id)
    scene.add_rule("stayed", RULES["stayed"])
    with running_worker(world.dsn):
        scene.walk("ann", [(100, 1, 2), (110, 6, 2), (111, 6, 2)])
        scene.watermark(200, world.source_id)
        await_progress(world.dsn)
        before = made_by(world, "stayed")
        scene.walk("ann", [(105, 6, 2)])
        await_progress(world.dsn)
        assert made_by(world, "stayed") == before
        assert {name for name, _ in world.rows(TAKEN_BACK)} == {"track_in_room"}
        assert replay_late(world.dsn).rows > 0
        assert replay_late(world.dsn) == Replay(0, 0)
    assert ("stayed", "retracted") in world.rows(VERDICTS)
    kept = world.rows(
        "select e.event_id::text, e.type from semap.event e left join semap.event_amendment a using (event_id)"
        " where e.rule_name = 'stayed' and a.verdict is null order by 1"
    )
    assert kept == should_be(world, "stayed", RULES["stayed"], None)
