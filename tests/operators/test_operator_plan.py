"""The plans of the operators on 20,000 things: each is served by an index of semap.abstraction, whatever is asked."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import psycopg
import pytest
from server import fresh_database

from semap.cluster import Cluster
from semap.store.database.connection import connect

THINGS = 20_000

# rows as the triggers would write them, without what else the triggers do
MADE = f"""
    set session_replication_role = replica;
    insert into semap.map (name) values ('town');
    insert into semap.frame (map_id, name) select map_id, 'map' from semap.map;
    insert into semap.frame_pose (frame_id) select frame_id from semap.frame;
    insert into semap.description (map_id, is_absolute) select map_id, true from semap.map, generate_series(1, {THINGS});
    insert into semap.instance (map_id, name, concept_id, frame_id, absolute_description_id)
    select d.map_id, 'thing ' || d.description_id, c.concept_id, f.frame_id, d.description_id
    from semap.description d, semap.concept c, semap.frame f where c.name = 'Furniture';
    insert into semap.abstraction (description_id, instance_id, type, geometry, z_min_m, z_max_m)
    select i.absolute_description_id, i.instance_id, v.type, v.shape, 0, 1
    from (select instance_id, absolute_description_id, 3.0 * (instance_id % 200) as x, 3.0 * (instance_id / 200) as y
          from semap.instance) i,
         lateral (values
           ('Footprint', st_makeenvelope(x, y, x + 2, y + 2)), ('FootprintHull', st_makeenvelope(x, y, x + 2, y + 2)),
           ('AxisAligned2D', st_makeenvelope(x, y, x + 2, y + 2)), ('Position2D', st_makepoint(x + 1, y + 1)),
           ('Position3D', st_makepoint(x + 1, y + 1, 0.5)), ('AxisAligned3D', semap.box_3d(x, y, 0, x + 2, y + 2, 1)),
           ('BoundingHull', semap.box_3d(x, y, 0, x + 2, y + 2, 1))) v (type, shape);
    analyze
"""


@pytest.fixture(scope="module")
def town(cluster: Cluster, template: str) -> Iterator[psycopg.Connection]:
    with fresh_database(cluster, template) as dsn, connect(dsn) as connection:
        for statement in MADE.split(";"):
            connection.execute(statement)
        connection.execute("load 'auto_explain'")
        connection.execute("set auto_explain.log_min_duration = 0")
        connection.execute("set auto_explain.log_nested_statements = on")
        connection.execute("set auto_explain.log_format = 'json'")
        yield connection


def nodes(plan: dict[str, Any]) -> list[dict[str, Any]]:
    return [plan, *(node for child in plan.get("Plans", []) for node in nodes(child))]


def scans(town: psycopg.Connection, call: str) -> list[dict[str, Any]]:
    """What ran to answer a call, in functions too: each scan of a table or an index, as it was planned."""
    said: list[str] = []

    def note(notice: psycopg.errors.Diagnostic) -> None:
        said.append(notice.message_primary or "")

    town.add_notice_handler(note)
    try:
        town.execute("set client_min_messages = log")
        town.execute(f"select count(*) from {call}")
    finally:
        town.execute("set client_min_messages = notice")
        town.remove_notice_handler(note)
    plans = [json.loads(text[text.index("{") :]) for text in said if "plan:" in text]
    return [node for plan in plans for node in nodes(plan["Plan"]) if "Scan" in node["Node Type"]]


ONE, SOME = "array[5050::bigint]", "array(select 5000 + n::bigint from generate_series(1, 9) n)"
CALLS = {
    "in_objects({})": "abstraction_footprint",
    "in_objects(null, {})": "abstraction_footprint",
    "in_objects({}, null, '3d', true)": "abstraction_footprint",
    "on_objects({})": "abstraction_footprint",
    "intersecting_objects({}, null, '3d')": "abstraction_footprint",
    "in_area(st_makeenvelope(10, 10, 20, 20), 1)": "abstraction_footprint",
    "in_area(st_makeenvelope(10, 10, 20, 20), 1, p_abstraction => 'Position2D')": "abstraction_position2d",
    "in_volume(semap.box_3d(10, 10, 0, 20, 20, 2), 1)": "abstraction_footprint",
    "topology('touches', {})": "abstraction_footprint",
    "relate({}, null, 'T********')": "abstraction_footprint",
    "rcc8_relations({}, null, array['EC', 'PO'])": "abstraction_footprint",
    "distances({}, {})": "abstraction_instance",
    "distances({}, {}, 'BoundingHull')": "abstraction_instance",
    "within_range({}, p_max_m => 4)": "abstraction_footprint",
    "within_range(null, {}, p_max_m => 4)": "abstraction_footprint",
    "within_range({}, p_max_m => 4, p_abstraction => 'BoundingHull')": "abstraction_boundinghull",
    "nearest({}, p_count => 10)": "abstraction_footprint",
    "nearest({}, p_count => 10, p_abstraction => 'Position3D')": "abstraction_position3d",
    "nearest({}, {}, 3)": "abstraction_instance",
    "nearest_to('point(30 30)', 1, 10)": "abstraction_footprint",
    "nearest_to('point z (30 30 1)', 1, 10, null, 'BoundingHull')": "abstraction_boundinghull",
    "above({}, p_reach_m => 2)": "abstraction_boundinghull",
    "left_of({}, p_frame => 'map', p_kind => 'halfspace', p_reach_m => 4)": "abstraction_boundinghull",
}


@pytest.mark.parametrize("ids", [ONE, SOME], ids=["one", "some"])
@pytest.mark.parametrize("call", CALLS)
def test_an_index_serves_the_operator(town: psycopg.Connection, call: str, ids: str) -> None:
    found = scans(town, "semap." + call.replace("{}", ids))
    assert CALLS[call] in {node.get("Index Name") for node in found}
    whole = [
        node
        for node in found
        if node["Node Type"] == "Seq Scan" and node.get("Relation Name") == "abstraction"
    ]
    assert whole == []


def test_a_kept_plan_uses_the_index_too(town: psycopg.Connection) -> None:
    town.execute("set plan_cache_mode = force_generic_plan")
    try:
        for call in ("in_objects({})", "topology('touches', {})", "relate({}, null, 'T********')"):
            found = scans(town, "semap." + call.format(ONE))
            assert "Seq Scan" not in {
                n["Node Type"] for n in found if n.get("Relation Name") == "abstraction"
            }
            assert "abstraction_footprint" in {node.get("Index Name") for node in found}
    finally:
        town.execute("reset plan_cache_mode")


MANY = "array(select 5000 + n::bigint from generate_series(1, 30) n)"
BOX = "semap.box_3d({0}, {0}, {0}, {0} + 2, {0} + 2, {0} + 1)"
ONCE = {
    "semap.rcc8(st_makeenvelope(0, 0, 2, 2), st_makeenvelope(1, 1, 3, 3))": "st_relate",
    f"semap.volume_3d({BOX.format(0)})": "st_xmin",
    f"semap.distances({MANY}, {MANY})": "st_shortestline",
    f"semap.within_range({MANY}, {MANY}, p_max_m => 1000, p_abstraction => 'BoundingHull')": "gap_3d",
    f"semap.relate({MANY}, {MANY}, 'T********')": "st_relate",
    f"semap.rcc8_relations({MANY}, {MANY}, array['PO'])": "rcc8",
}
"""By call: a function that is asked once for each of its rows."""


@pytest.mark.parametrize("call", ONCE)
def test_what_several_terms_ask_for_is_computed_once(town: psycopg.Connection, call: str) -> None:
    """`offset 0` keeps what is in a subquery from being computed wherever it is asked for."""
    town.execute("set track_functions = 'all'")
    with town.transaction(force_rollback=True):
        town.execute(
            "update semap.abstraction set geometry = st_expand(geometry, 1)"
            " where type = 'Footprint' and instance_id between 5001 and 5030"
        )
        rows = len(town.execute(f"select * from {call}").fetchall())
        found = town.execute(
            "select calls from pg_stat_xact_user_functions where funcname = %s", [ONCE[call]]
        ).fetchone()
    assert found is not None
    assert rows <= found[0] <= 1.1 * rows + 1
