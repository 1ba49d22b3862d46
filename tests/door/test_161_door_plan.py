"""The plan of what runs for every line: by the index of the ranges of motion, whatever the size of the map."""

from __future__ import annotations

import json
from typing import Any

from door_plan import SCAN_US, Door, DoorPlan
from world import World


def nodes(plan: dict[str, Any]) -> list[dict[str, Any]]:
    return [plan, *(node for child in plan.get("Plans", []) for node in nodes(child))]


def test_a_line_is_looked_up_by_the_ranges_of_motion(world: World) -> None:
    """Among 1,000 doors, with those of nine other maps at the same places, and what a batch of 300 lines finds there."""
    world.run(
        "with f as (insert into semap.frame (map_id, name, parent_id) select %s, 'door ' || n, %s"
        " from generate_series(0, 999) n returning frame_id, name), p as (insert into semap.frame_pose (frame_id, x_m, y_m)"
        " select frame_id, 3 * (substr(name, 6)::int %% 40), 3 * (substr(name, 6)::int / 40) from f)"
        " insert into semap.instance (map_id, name, concept_id, frame_id, attributes)"
        " select %s, f.name, concept_id, frame_id, '{\"leaf\": \"left\", \"width_m\": 0.9}'"
        " from f, semap.concept c where c.name = 'Door'", world.map_id, world.frame_id, world.map_id,
    )  # fmt: skip
    assert world.one("select count(*) from semap.door_leaf") == 1000
    for number in range(9):
        twin = World(world.dsn, f"twin {number}")
        twin.run(
            "with f as (insert into semap.frame (map_id, name, parent_id) select %s, 'door ' || n, %s"
            " from generate_series(0, 99) n returning frame_id, name), p as (insert into semap.frame_pose (frame_id, x_m)"
            " select frame_id, 3 * substr(name, 6)::int from f) insert into semap.instance"
            " (map_id, name, concept_id, frame_id, attributes) select %s, f.name, concept_id, frame_id,"
            " '{\"leaf\": \"left\", \"width_m\": 0.9}' from f, semap.concept c where c.name = 'Door'",
            twin.map_id, twin.frame_id, twin.map_id,
        )  # fmt: skip
        twin.close()
    (plan,) = world.one(
        "explain (format json) select s.* from generate_series(1, 20) n,"
        f" lateral semap.leaves_seen({world.map_id}, 3 * n, 0, 3 * n + 0.8, 0.1, 0.25, 0.01, 0.01) s"
    )
    root = plan["Plan"] if isinstance(plan, dict) else json.loads(plan)["Plan"]
    scans = [node for node in nodes(root) if node.get("Relation Name") == "door_leaf"]
    indexes = [node for node in nodes(root) if node.get("Index Name") == "door_leaf_range_of_motion"]
    assert scans, plan
    assert indexes, scans
    assert "Seq Scan" not in {node["Node Type"] for node in scans}
    doors = [Door(f"door {n}", 3.0 * (n % 40), 3.0 * (n // 40)) for n in range(0, 900, 3)]
    plan_of_doors = DoorPlan(world)
    plan_of_doors.observe(door.seen(SCAN_US, 0.0) for door in doors)
    assert sorted(plan_of_doors.states()) == sorted((door.name, "closed", SCAN_US) for door in doors)
