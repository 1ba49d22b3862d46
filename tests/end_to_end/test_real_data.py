"""Real buildings and real movement through the whole way, against answers made with shapely alone."""

from __future__ import annotations

import csv
import json
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
import shapely
from data_sets import data_set
from play import bring_in, changes, events, play
from rule_work import await_events, running_worker
from semap_ingest.track_file import Layout, read_tracks
from semap_service.demo.scenes import scenes
from shapely.geometry import shape

from semap.formats import read_building
from semap.store.database.connection import connect


def flat_oracle() -> list[tuple[str, float]]:
    """Room and stamp [s] of every change of room: first pose inside, by shapely over the plain file."""
    folder = data_set("flat")
    features = json.loads((folder / "rooms.geojson").read_text())["features"]
    rooms = {
        f["properties"]["name"]: shape(f["geometry"])
        for f in features
        if f["properties"]["concept"] == "Room"
    }
    with (folder / "test_robot_df.csv").open() as file:
        poses = [
            (round(float(row["ts"]) / 1e3) / 1e6, float(row["x"]), float(row["y"]))
            for row in csv.DictReader(file)
        ]
    visits: list[tuple[str, float]] = []
    for stamp_s, x_m, y_m in sorted(poses):
        for name, footprint in rooms.items():
            if shapely.contains_xy(footprint, x_m, y_m) and (not visits or visits[-1][0] != name):
                visits.append((name, stamp_s))
    return visits


@pytest.mark.parametrize("batch_size", [1, 7, 10_000])
def test_the_robot_changes_room_ten_times(database: str, batch_size: int) -> None:
    folder = data_set("flat")
    oracle = flat_oracle()
    assert "".join(name[-1] for name, _ in oracle) == "fabcbdedbaf"
    bring_in(database, "flat", read_building(folder / "rooms.geojson"))
    play(database, "flat", read_tracks(folder / "test_robot_df.csv", Layout(track="robot", stamp_unit="ns")),
         batch_size=batch_size)  # fmt: skip
    with running_worker(database):
        await_events(database, 2 * len(oracle))
    log = events(database, "flat")
    entered = [(room, stamp_s) for kind, _, _, room, stamp_s in log if kind == "entered"]
    left = [(room, stamp_s) for kind, _, _, room, stamp_s in log if kind == "left"]
    assert entered == oracle
    assert entered[0] == ("room_f", pytest.approx(1628008099.976, abs=1e-6))
    assert entered[1] == ("room_a", pytest.approx(1628008259.643, abs=1e-3))
    assert left[:-1] == [(name, stamp) for (name, _), (_, stamp) in pairwise(oracle)]


def test_all_75_cross_once(database: str) -> None:
    scene = next(scene for scene in scenes(data_set("bottleneck").parent) if scene.name == "bottleneck")
    bring_in(database, "bottleneck", scene.building)
    tracks = read_tracks(scene.tracks, scene.layout)
    assert len(tracks) == 63_110
    play(database, "bottleneck", tracks, batch_size=1000)
    assert changes(database, "bottleneck") == 75 * 4
    with running_worker(database):
        await_events(database, 75 * 4)
    kinds = Counter((kind, cause, room) for kind, cause, _, room, _ in events(database, "bottleneck"))
    assert kinds == {
        ("entered", "appeared", "waiting_area"): 75,
        ("left", "moved", "waiting_area"): 75,
        ("entered", "moved", "beyond"): 75,
        ("left", "disappeared", "beyond"): 75,
    }
    crossed = [(track, stamp_s) for kind, cause, track, room, stamp_s in events(database, "bottleneck")
               if (kind, cause, room) == ("entered", "moved", "beyond")]  # fmt: skip
    assert len({track for track, _ in crossed}) == 75
    assert dict(crossed) == bottleneck_oracle(scene.tracks, scene.layout.epoch_us / 1e6)


def bottleneck_oracle(path, epoch_s: float) -> dict[str, float]:
    """The stamp [s] at which each person is first strictly beyond y = -0.6, from the bare numbers."""
    rows = np.loadtxt(path)
    first = {}
    for person in np.unique(rows[:, 0]):
        own = rows[rows[:, 0] == person]
        frame = own[own[:, 3] < -0.6][:, 1].min()
        first[str(int(person))] = pytest.approx(epoch_s + frame / 25, abs=1e-5)
    return first


@pytest.mark.parametrize(
    ("file", "rooms", "doors", "joining_two"),
    [("duplex/Ifc2x3_Duplex_Architecture.ifc", 21, 14, 9), ("open_smart_home/04_Flat.ifc", 9, 7, None)],
)
def test_ifc_buildings(database: str, file: str, rooms: int, doors: int, joining_two: int | None) -> None:
    folder, name = file.split("/")
    report = bring_in(database, folder, read_building(data_set(folder) / name))
    assert (report.concepts["Room"], report.concepts["Door"]) == (rooms, doors)
    with connect(database) as connection:
        complete = connection.execute(
            "select count(*) from semap.instance i join semap.concept c using (concept_id)"
            " join semap.geometry g on g.description_id = i.relative_description_id and g.name = 'Body'"
            " join semap.abstraction f on f.description_id = i.absolute_description_id and f.type = 'Footprint'"
            " join semap.abstraction h on h.description_id = i.absolute_description_id and h.type = 'FootprintHull'"
            " where c.name = 'Room' and f.z_min_m < f.z_max_m and st_area(f.geometry) > 0.1"
            " and st_covers(st_buffer(h.geometry, 1e-6), f.geometry)"
        ).fetchone()
        joins = Counter(
            count for (count,) in connection.execute(
                "select count(r.room_id) from semap.instance i join semap.concept c using (concept_id)"
                " left join semap.door_room r on r.door_id = i.instance_id where c.name = 'Door'"
                " group by i.instance_id"
            )
        )  # fmt: skip
        regions = connection.execute("select count(*) from semap.region").fetchone()
    assert complete == (rooms,)
    assert regions == (rooms,)
    assert sum(joins.values()) == doors
    if joining_two is not None:
        assert joins[2] == joining_two


def test_a_person_in_the_duplex_is_in_a_room_of_the_own_storey(database: str) -> None:
    """Stacked rooms cover each other on the plan; the height band tells them apart."""
    bring_in(database, "duplex", read_building(data_set("duplex") / "Ifc2x3_Duplex_Architecture.ifc"))
    with connect(database) as connection:
        rows = connection.execute(
            "select i.name, a.z_min_m, a.z_max_m, st_x(p.point), st_y(p.point)"
            " from semap.instance i join semap.concept c using (concept_id)"
            " join semap.abstraction a on a.description_id = i.absolute_description_id and a.type = 'Footprint'"
            " cross join lateral (select st_pointonsurface(a.geometry) as point) p where c.name = 'Room'"
        ).fetchall()
        for name, low_m, high_m, x_m, y_m in rows:
            found = connection.execute(
                "select array_agg(r.instance_name) from semap.map m,"
                " lateral semap.regions_at(m.map_id, m.cell_m, %s, %s, %s) at"
                " join semap.region r on r.region_id = any (at.region_ids)",
                [x_m, y_m, low_m],
            ).fetchone()
            expected = {other for other, z0, z1, _, _ in rows if z0 <= low_m < z1} & set(found[0])
            assert name in found[0]
            assert set(found[0]) == expected
            assert high_m > low_m
