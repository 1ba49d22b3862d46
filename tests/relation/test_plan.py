"""The plans of what runs for every state: by key, whatever the size of the map."""

from __future__ import annotations

import json
from typing import Any

import pytest
import shapely
from sqlalchemy.dialects import postgresql
from world import SECOND_US, World

from semap.store.database.connection import connect
from semap.store.event.events import EVENTS
from semap.timeline.stamp import to_datetime


def nodes(plan: dict[str, Any]) -> list[dict[str, Any]]:
    return [plan, *(node for child in plan.get("Plans", []) for node in nodes(child))]


def explain(world: World, statement: str) -> list[dict[str, Any]]:
    (plan,) = world.one(f"explain (format json) {statement}")
    return nodes(plan["Plan"] if isinstance(plan, dict) else json.loads(plan)["Plan"])


@pytest.fixture
def large(world: World) -> World:
    """1,000 rooms and 1,000 tracks."""
    world.run("insert into semap.description (map_id) select %s from generate_series(1, 1000)", world.map_id)
    world.run(
        "insert into semap.instance (map_id, name, concept_id, frame_id, absolute_description_id)"
        " select %s, 'room ' || d.description_id, c.concept_id, %s, d.description_id"
        " from semap.description d, semap.concept c where c.name = 'Room'", world.map_id, world.frame_id,
    )  # fmt: skip
    room = shapely.Polygon([(0, 0), (5, 0), (5, 3), (4, 3), (4, 4), (0, 4)])
    world.run(
        "insert into semap.abstraction (description_id, type, geometry)"
        " select description_id, 'Footprint', st_translate(%s::public.geometry, 5 * (n %% 40), 4 * (n / 40))"
        " from (select description_id, row_number() over () as n from semap.description) d",
        shapely.to_wkb(room, hex=True),
    )
    world.run(
        "insert into semap.track (uid, source_id, map_id, name)"
        " select gen_random_uuid(), %s, %s, n from generate_series(1, 1000) n", world.source_id, world.map_id,
    )  # fmt: skip
    return world


def test_a_point_is_looked_up_by_its_cell(large: World) -> None:
    for statement in (
        f"select * from semap.regions_at({large.map_id}, 4, 12.5, 7.5, 1)",
        f"select * from semap.safe_rectangle({large.map_id}, 4, 12.5, 7.5, null)",
    ):
        scans = [
            node
            for node in explain(large, statement)
            if "Scan" in node["Node Type"] and "Relation Name" in node
        ]
        assert {node["Node Type"] for node in scans} <= {"Index Scan", "Bitmap Heap Scan"}
        assert scans[0].get("Index Name", "region_edge_cell") in ("region_cell_pkey", "region_edge_cell")


def test_a_window_of_time_and_events_after_a_cursor_use_their_keys(large: World) -> None:
    large.run("set enable_seqscan = off")
    window = explain(
        large,
        "select * from semap.state_chunk where track_id = any ('{5,6}') and from_stamp >= '2026-01-01'"
        " and from_stamp <= '2026-01-02' and to_stamp >= '2026-01-01'",
    )
    (scan,) = [node for node in window if "Index Cond" in node]
    assert scan["Index Name"].startswith("state_chunk_default_track_id")
    assert "track_id = ANY" in scan["Index Cond"]
    assert "from_stamp >=" in scan["Index Cond"]
    events = explain(large, "select * from semap.event where seq > 5 order by seq limit 10")
    assert any(node.get("Index Name") == "event_pkey" for node in events)


def test_a_region_of_too_many_cells_is_refused_with_its_remedy(large: World) -> None:
    with pytest.raises(Exception, match="million cells") as refused:
        large.add_room("county", shapely.box(0, 0, 1e5, 1e5))
    assert "--cell" in str(refused.value.diag.message_hint)


def test_events_are_read_without_a_plan_for_each_day(large: World) -> None:
    """Where their tracks were is asked of a function that keeps its plan, whatever days there are."""
    statement = str(EVENTS.compile(dialect=postgresql.dialect(), compile_kwargs={"literal_binds": True}))
    relations = {node["Relation Name"] for node in explain(large, statement) if "Relation Name" in node}
    assert "event" in relations
    assert not {name for name in relations if name.startswith("state_chunk")}


def test_tracks_in_pairs_are_found_by_key_though_the_table_was_empty_when_it_was_analyzed(
    world: World,
) -> None:
    """What was known of the table is of the time before a query was added, or its tracks came."""
    tracks = 300
    world.run(
        "insert into semap.track (uid, source_id, map_id, name)"
        " select gen_random_uuid(), %s, %s, n from generate_series(1, %s) n", world.source_id, world.map_id, tracks,
    )  # fmt: skip
    world.run(
        "insert into semap.continuous_query (map_id, name, predicate, subject_kind, object_kind, distance_m)"
        " values (%s, 'near', 'within_distance', 'track', 'track', 1)", world.map_id,
    )  # fmt: skip

    def move(at_s: int) -> None:
        world.run(
            "insert into semap.track_state (track_id, stamp, x_m, y_m)"
            " select track_id, to_timestamp(%s), track_id %% 20 * 5, track_id / 20 * 5 from semap.track", at_s,
        )  # fmt: skip

    move(1)
    world.run("update semap.track set ended_at = to_timestamp(2)")
    world.run("vacuum (analyze, truncate off) semap.followed_state")
    with connect(world.dsn) as fresh:
        world.connection.close()
        world.connection = fresh
        with fresh.transaction():
            move(3)
            (read,) = world.rows(
                "select seq_tup_read + idx_tup_fetch from pg_stat_xact_user_tables where relname = 'followed_state'"
            )
        assert tracks <= read[0] <= 20 * tracks


def test_all_batches_that_are_not_flushed_are_looked_through_once(world: World) -> None:
    tracks = [world.add_track(f"t{number}") for number in range(20)]
    for number in range(40):
        world.run(
            "select semap.add_states(%s, %s, %s, x_m => %s::float8[], y_m => %s::float8[])",
            world.source_id, to_datetime(SECOND_US + number * 100_000), tracks, [1.0] * 20, [1.0] * 20,
        )  # fmt: skip
    (plan,) = world.one("explain (analyze, format json) select * from semap.unflushed_state")
    looked = [each["Actual Loops"] for each in nodes(plan["Plan"]) if each["Node Type"] == "WindowAgg"]
    assert looked == [1]
    assert world.one("select count(*) from semap.unflushed_state") == len(tracks)
