"""The room that a track takes, and what its tracker had mistaken."""

from __future__ import annotations

import math

import psycopg
import pytest
import shapely
from world import SECOND_US, World

from semap.store.database.connection import connect
from semap.timeline.stamp import to_datetime


def footprint(world: World, *values: float | None) -> shapely.Geometry | None:
    found = world.one("select st_asbinary(semap.track_footprint(%s, %s, %s, %s, %s))", *values)
    return None if found is None else shapely.from_wkb(found)


def test_a_footprint_is_an_ellipse_along_the_heading(world: World) -> None:
    ellipse = footprint(world, 3.0, 2.0, math.radians(30), 0.6, 0.4)
    expected = shapely.affinity.translate(
        shapely.affinity.rotate(
            shapely.affinity.scale(shapely.Point(0, 0).buffer(1, 64), 0.3, 0.2), 30, (0, 0)
        ),
        3,
        2,
    )
    assert expected.buffer(1e-6).contains(ellipse)
    assert ellipse.area == pytest.approx(expected.area, rel=0.03)
    circle = footprint(world, 0.0, 0.0, None, 0.6, 0.4)
    assert shapely.hausdorff_distance(circle, shapely.Point(0, 0).buffer(0.3)) < 0.01
    assert footprint(world, 0.0, 0.0, 1.0, None, None) is None
    assert footprint(world, 0.0, 0.0, 1.0, 0.5, None).area == pytest.approx(math.pi / 4 * 0.25, rel=0.03)


def test_extents_reach_the_present_of_a_track(world: World) -> None:
    world.add_room("room", shapely.box(0, 0, 4, 4))
    track = world.add_track("t")
    add = (
        "insert into semap.track_state (track_id, stamp, x_m, y_m, heading_rad, speed_mps, length_m, width_m)"
        " values (%s, %s, %s, 2, %s, 1.25, 0.5, %s)"
    )
    present = "select x_m, heading_rad, speed_mps, length_m, width_m, round(st_area(footprint)::numeric, 2) from semap.track_present"
    # into the room, on within it (in its calm), and out
    for number, (x, heading) in enumerate([(1.0, 0.5), (1.1, -0.5), (1.2, None), (9.0, 3.0)]):
        world.run(add, track, to_datetime((number + 1) * SECOND_US), x, heading, 0.25)
        ((*found, area),) = world.rows(present)
        assert found == [x, heading, 1.25, 0.5, 0.25]
        assert float(area) == pytest.approx(math.pi / 4 * 0.5 * (0.5 if heading is None else 0.25), abs=0.01)
    for heading, width in ((math.nan, 0.2), (math.inf, 0.2), (0.0, 0.0), (0.0, -1.0), (0.0, math.nan)):
        with pytest.raises(psycopg.errors.CheckViolation):
            world.run(add, track, to_datetime(10 * SECOND_US), 1.0, heading, width)


def test_amendments_are_of_two_tracks_of_one_source_and_come_once(world: World) -> None:
    a, b = world.add_track("a"), world.add_track("b")
    foreign = world.add_track("c", world.add_source("other"))
    add = (
        "insert into semap.track_amendment (source_id, track_id, other_track_id, kind, since, found)"
        " values (%s, %s, %s, %s, to_timestamp(1), to_timestamp(2)) on conflict do nothing"
    )
    with connect(world.dsn, "semap_ingest") as connection:
        for _ in range(2):
            connection.execute(add, [world.source_id, a, b, "merged"])
        connection.execute(add, [world.source_id, a, b, "switched"])
        for track, other, source_id in (
            (a, foreign, world.source_id),
            (a, b, 999),
            (999, b, world.source_id),
        ):
            with pytest.raises(psycopg.errors.ForeignKeyViolation, match="not of one source"):
                connection.execute(add, [source_id, track, other, "merged"])
        with pytest.raises(psycopg.errors.CheckViolation):
            connection.execute(add, [world.source_id, a, a, "merged"])
    rows = "select map_id, source_id, track_id, other_track_id, kind from semap.track_amendment order by kind"
    assert world.rows(rows) == [
        (world.map_id, world.source_id, a, b, kind) for kind in ("merged", "switched")
    ]
    world.run("delete from semap.track where track_id = %s", b)
    assert world.rows(rows) == []
