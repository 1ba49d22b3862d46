"""Benchmarks run at their smallest, and what they measure is of the right thing."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import shapely

from bench import __main__ as bench
from bench import edits, growth, imports, latency, shapes, throughput
from bench.bridges import foxglove
from bench.copies import copied
from bench.crowd import Floor, build_map
from bench.figure import Figure, Rows, as_json, figure, joined, once, percentiles
from semap.store.database.connection import connect

FLOOR = Floor(4, 3)


def _figures(rows: Rows, title: str) -> list[Figure]:
    return [each for row in rows if isinstance(each := row[title], Figure)]


def test_the_rounds_of_a_figure_are_told_by_their_median_the_least_and_the_most() -> None:
    measured = figure([3.0, 1.04, 2.0, 9.0, 2.46], 1)
    assert measured.as_json() == {"median": 2.5, "min": 1.0, "max": 9.0, "rounds": 5}
    assert str(measured) == "2.5 [1.0 9.0]"
    assert once(1234.4).as_json() == {"median": 1234, "min": 1234, "max": 1234, "rounds": 1}
    assert str(once(1234.4)) == "1234"


def test_runs_of_a_benchmark_are_joined_row_by_row() -> None:
    runs: list[Rows] = [
        [{"shape": "ball", "s": once(n, 1)}, {"shape": "box", "s": once(2 * n, 1)}] for n in (3, 1, 2)
    ]
    assert as_json(joined(runs)) == [
        {"shape": "ball", "s": {"median": 2, "min": 1, "max": 3, "rounds": 3}},
        {"shape": "box", "s": {"median": 4, "min": 2, "max": 6, "rounds": 3}},
    ]
    with pytest.raises(ValueError, match="different rows"):
        joined([runs[0], runs[0][:1]])


def test_percentiles_are_of_each_round_by_itself() -> None:
    told = percentiles([list(range(101)), [7.0] * 5])
    assert {title: each.rounds for title, each in told.items()} == {
        "p50_ms": (50, 7), "p99_ms": (99, 7), "max_ms": (100, 7)
    }  # fmt: skip


def test_a_copy_has_what_the_database_has_and_is_gone_at_the_end(database: str) -> None:
    with connect(database) as connection:
        build_map(connection, "floor", Floor(2, 1).rooms(), 3, per_source=2)
    with copied(database, "twin") as twin, connect(twin) as connection:
        sources = connection.execute(
            "select s.name, count(*) from semap.source s join semap.track using (source_id) group by 1 order by 1"
        ).fetchall()
        assert sources == [("crowd", 2), ("crowd 2", 1)]
        name = connection.info.dbname
    with connect(database) as connection:
        assert connection.execute("select from pg_database where datname = %s", [name]).fetchone() is None


def test_regions_that_are_put_past_the_triggers_are_those_of_an_import(database: str) -> None:
    rooms = Floor(3, 2).rooms()
    with connect(database) as connection:
        imported, _ = build_map(connection, "imported", rooms, 1)
        put, _ = build_map(connection, "put", [], 1)
        growth.put_regions(connection, put, [room.wkb_hex for room in rooms])
        for table in ("region_cell", "region_edge"):
            columns = (
                "cell_x, cell_y, whole, stateful, z_min_m, z_max_m" if table == "region_cell"
                else "cell_x, cell_y, stds, x_min_m, x_max_m, y_min_m, y_max_m"
            )  # fmt: skip
            found = [
                connection.execute(
                    f"select {columns} from semap.{table} where map_id = %s order by {columns}", [each]
                )
                for each in (imported, put)
            ]
            first, second = (each.fetchall() for each in found)
            assert first == second
            assert len(first) >= 6


def test_growth_measures_every_size_and_draws_it(
    database: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(growth, "ROOMS", FLOOR)
    extent = growth.Extent((2, 6), (10, 1_000), (0, 12_000), rounds=2, batches=2)
    rows = growth.measure(database, extent, tmp_path / "growth.png")
    assert [(row["grows"], row["size"]) for row in rows] == [
        ("regions", 2), ("regions", 6), ("tracks", 10), ("tracks", 1_000),
        ("tracks of one source", 1_000), ("tracks in a frame", 1_000), ("stored", 0), ("stored", 12_000),
    ]  # fmt: skip
    for each in _figures(rows, "us_per_state"):
        assert len(each.rounds) == 2
        assert 0 < min(each.rounds) <= max(each.rounds) < 10_000
    assert (tmp_path / "growth.png").read_bytes().startswith(b"\x89PNG")
    json.dumps(as_json(rows))


def test_stored_states_lie_in_past_days_and_today(database: str) -> None:
    with connect(database) as connection:
        growth.of_stored(connection, 20_000, growth.SMALLEST)
        days = connection.execute(
            "select stamp::date::text, count(*) from semap.stored_state group by 1 order by 1"
        ).fetchall()
    assert days == [*((f"2026-01-{day:02}", 2_000) for day in range(5, 10)), ("2026-01-10", 10_000)]


@pytest.mark.parametrize("title", shapes.SHAPES)
def test_the_shapes_are_areas_of_so_many_corners(title: str) -> None:
    plain = shapely.union_all(shapes.plain(100))
    areas = shapes.SHAPES[title](100)
    assert len(areas) == 100
    assert all(area.is_valid for area in areas)
    assert all(shapely.buffer(plain, 8, join_style="mitre").covers(area) for area in areas)
    corners = {len(area.exterior.coords) - 1 for area in areas}
    assert corners == ({shapes.CORNERS} if "corners" in title else {6})
    if "over" in title:
        assert shapely.intersection_all(areas).area > 0.3 * areas[0].area


def test_shapes_are_imported_edited_and_measured(database: str) -> None:
    rows = shapes.measure(database, regions=2, rounds=2, batches=2)
    assert [row["regions"] for row in rows] == [f"2 {title}" for title in shapes.SHAPES]
    for title in ("us_per_state", "edit_ms"):
        assert all(min(each.rounds) > 0 for each in _figures(rows, title))


def test_edits_under_load_lose_nothing(database: str) -> None:
    rows = edits.measure(database, Floor(4, 3), tracks=40, rounds=1, stretch_s=3)
    assert [(row["edits_per_s"], row["batches"], row["lost"]) for row in rows] == [(0, 45, 0), (1.0, 45, 0)]
    assert rows[0]["edits"] == 0
    assert int(str(rows[1]["edits"])) >= 1


def test_what_is_lost_would_be_found(database: str) -> None:
    edits.measure(database, Floor(2, 2), tracks=20, rounds=1, stretch_s=1)
    with connect(database) as connection:
        assert edits.differences(connection) == 0
        connection.execute("delete from semap.relation where ctid = (select min(ctid) from semap.relation)")
        assert edits.differences(connection) == 2


def test_latency_is_measured_at_each_rate(database: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(latency, "FLOOR", FLOOR)
    rows = latency.measure(database, rates=(6_000,), round_s=1.5, rounds=2)
    assert [(row["states_per_s"], row["sources"], row["batch"]) for row in rows] == [(6_000, 2, 200)]
    for row in rows:
        assert row["events"] == row["events_in_the_log"]
    assert all(len(each.rounds) == 2 and min(each.rounds) > 0 for each in _figures(rows, "p50_ms"))


def test_throughput_has_the_form_of_all(database: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(throughput, "FLOOR", FLOOR)
    monkeypatch.setattr(throughput, "FRAMES", 4)
    monkeypatch.setattr(throughput, "TRACKS", 20)
    monkeypatch.setattr(throughput, "ROUNDS", 3)
    rows = throughput.measure(database)
    for title in ("bare_copy_per_s", "batches_per_s", "ratio"):
        assert [len(each.rounds) for each in _figures(rows, title)] == [3, 3]


def test_results_are_written_in_one_form(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    runs = iter([5.0, 3.0])
    benchmark = bench.Benchmark(
        "a run", "none", lambda _: [{"case": "x", "s": once(next(runs))}], repeated=True
    )
    monkeypatch.setattr(bench, "benchmarks", lambda *_: {"mine": benchmark})
    monkeypatch.setattr(bench, "RESULTS", tmp_path / "results.json")
    bench.main(["mine", "--rounds", "2"])
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["mine"] == [{"case": "x", "s": {"median": 4, "min": 3, "max": 5, "rounds": 2}}]
    assert set(results["machine"]) == {"processor", "cores", "load_1_min", "python"}


def test_the_building_of_the_import_is_brought_in_with_its_doors(database: str) -> None:
    rows = imports.measure(database, (3, 2), 4)
    wrong = [f"10 MB, {each}" for each in imports.wrong_files()]
    assert [row["what"] for row in rows] == ["6 rooms, 4 doors", *wrong]
    with connect(database) as connection:
        joined_rooms = connection.execute(
            "select d.name, array_agg(r.name order by r.name) from semap.door_room"
            " join semap.instance d on d.instance_id = door_id join semap.instance r on r.instance_id = room_id"
            " group by d.name order by d.name"
        ).fetchall()
    assert joined_rooms == [
        (f"door {x}-{y}", [f"room {x}-{y}", f"room {x + 1}-{y}"]) for x in range(2) for y in range(2)
    ]


def test_people_that_walk_are_shown_and_the_bridge_is_watched(database: str) -> None:
    (row,) = foxglove.measure(database, round_s=1.0, rounds=1)
    (shown,) = _figures([row], "scenes_per_s")
    assert shown.median > 0
    (percent,) = _figures([row], "percent_of_a_core")
    assert percent.rounds[0] >= 0
