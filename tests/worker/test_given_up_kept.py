"""What a live rule gives up is kept with the progress: the same through crashes as in one run over all of it."""

from __future__ import annotations

from contextlib import closing

import pytest
import shapely
from rule_work import await_progress, running_worker
from test_exactly_once import cut
from world import SECOND_US, World

from semap.model.given_up import GivenUp
from semap.rules.language.reading import parse_declaration
from semap.rules.matching import pattern_program
from semap.store.database.connection import connect, one_transaction
from semap.store.event.rules import add_rule, declare_rule, find_rule
from semap.timeline.stamp import to_datetime
from semap.worker.past import dry_run

EACH = {
    "input": "track_in_room", "partition_by": "track", "pattern": "A followed by B", "after_match": "skip to next row",
    "define": {"A": "type = 'began'", "B": "type = 'ended' and room = 'nowhere'"}, "emit": "found",
}  # fmt: skip


@pytest.fixture
def visited(world: World, monkeypatch: pytest.MonkeyPatch) -> World:
    monkeypatch.setattr(pattern_program, "RUNS_AT_MOST", 3)
    world.add_room("kitchen", shapely.box(0, 0, 4, 4))
    return world


def visit(world: World, track_id: int, at_s: int) -> None:
    world.copy_states(
        [(track_id, at_s * SECOND_US, 1, 1, None), (track_id, (at_s + 1) * SECOND_US, 9, 1, None)]
    )
    world.run(
        "update semap.source set watermark = to_timestamp(%s) where source_id = %s", at_s, world.source_id
    )


def noted(world: World) -> GivenUp | None:
    with one_transaction(world.dsn, "semap_read") as connection:
        return find_rule(connection, "each", world.name).given_up


def test_it_is_the_same_through_crashes_and_starts(visited: World) -> None:
    declared = parse_declaration(EACH, "each")
    with one_transaction(visited.dsn, "semap_api") as connection:
        add_rule(connection, "world", declared)
    ann, bob = visited.add_track("ann"), visited.add_track("bob")
    assert noted(visited) is None
    for start in (10, 50):
        with running_worker(visited.dsn):
            for number in range(6):
                if number % 3 == 0:
                    visit(visited, bob, start + 2 * number)
                    cut(visited)
                visit(visited, ann, start + 2 * number + 1)
                cut(visited)
            visited.run(
                "update semap.source set watermark = to_timestamp(%s) where source_id = %s",
                start + 20, visited.source_id,
            )  # fmt: skip
            await_progress(visited.dsn)
    told: list[GivenUp] = []
    with connect(visited.dsn, "semap_read") as connection:
        dry_run(connection, "world", declared, tell=lambda _, what: told.append(what))
    assert noted(visited) == GivenUp(9 + 1, to_datetime(10 * SECOND_US), {"track": "bob"})
    assert told == [noted(visited)]
    with one_transaction(visited.dsn, "semap_api") as connection:
        rule_id = find_rule(connection, "each", "world").rule_id
        declare_rule(connection, rule_id, parse_declaration({**EACH, "within": "5 s"}, "each"))
    assert noted(visited) is None


def test_it_is_told_of_ones_own_maps_alone(visited: World) -> None:
    with closing(World(visited.dsn, "other")) as other:
        for world in (visited, other):
            world.run(
                "update semap.progress set watermarks = jsonb_set(jsonb_set(watermarks, '{given_up}',"
                " coalesce(watermarks -> 'given_up', '{}')), array['given_up', %s], '{\"version\": 1, \"attempts\": 1,"
                " \"first\": \"2026-01-31T12:00:00+00:00\", \"key\": {}}')", str(world.rule_id),
            )  # fmt: skip
        shown = "select rule_id from semap.rule_given_up order by 1"
        assert visited.rows(shown) == [(visited.rule_id,), (other.rule_id,)]
        with connect(visited.dsn, "semap_read_map") as reader:
            assert reader.execute(shown).fetchall() == []
            reader.execute("select set_config('semap.maps', %s, false)", [f"{{{other.map_id}}}"])
            assert reader.execute(shown).fetchall() == [(other.rule_id,)]
