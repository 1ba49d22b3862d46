"""Size and shape, held against shapely and trimesh."""

from collections.abc import Iterator
from functools import reduce
from uuid import uuid4

import numpy as np
import pytest
import shapely
import trimesh
from furnishing import House, box, room, thing
from geometry.polygons import cell_polygons, star_polygons
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapely import Polygon
from shapely.affinity import rotate, translate
from sqlalchemy import text

from semap.errors import InvalidInput
from semap.geometry.pose import pose_from_yaw
from semap.geometry.prism import extrude
from semap.model.building import Item, Mesh
from semap.store.database.connection import one_transaction, translated

ELL = Polygon([(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (0, 3)])
SIZES = "select {} from semap.sizes(:ids) order by instance_id"


@pytest.fixture
def house(database: str) -> Iterator[House]:
    with one_transaction(database, "semap_api") as connection:
        yield House(connection)


def shape_of(wkb: object) -> shapely.Geometry | None:
    return None if wkb is None else shapely.from_wkb(bytes(wkb))


def same(a: shapely.Geometry, b: shapely.Geometry) -> bool:
    return a.symmetric_difference(b).area < 1e-9


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(area=st.one_of(star_polygons(), cell_polygons()), low_m=st.integers(-3, 3), height_m=st.integers(1, 5))
def test_an_extruded_area_is_a_closed_prism_of_its_volume(
    house: House, area: shapely.Geometry, low_m: int, height_m: int
) -> None:
    ((closed, volume_m3, surface_m2, extent),) = house.rows(
        "select semap.is_closed_3d(p), semap.volume_3d(p), semap.area_3d(p),"
        " array[public.st_zmin(p), public.st_zmax(p), public.st_xmin(p), public.st_ymax(p)]"
        " from semap.extruded(public.st_geomfromwkb(:area), :low, :high) p",
        area=area.wkb,
        low=low_m,
        high=low_m + height_m,
    )
    assert closed
    assert volume_m3 == pytest.approx(area.area * height_m, rel=1e-12)
    assert surface_m2 == pytest.approx(2 * area.area + area.length * height_m, rel=1e-12)
    assert extent == [low_m, low_m + height_m, area.bounds[0], area.bounds[3]]


def test_corners_on_a_straight_edge_stay_in_the_prism(house: House) -> None:
    area = Polygon([(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 2), (0, 2), (0, 1)])
    statement = "select semap.is_closed_3d(semap.extruded(public.st_geomfromwkb(:area), 0, 1))"
    assert house.one(statement, area=area.wkb) is True


def test_heights_that_do_not_rise_are_refused(house: House) -> None:
    with pytest.raises(InvalidInput, match="do not rise"), translated(), house.undone():
        house.one("select semap.extruded(public.st_geomfromwkb(:area), 1, 1)", area=ELL.wkb)


def test_sizes_are_those_of_the_shapes(house: House) -> None:
    pose = pose_from_yaw(5, -2, 1, 0.7)
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.5)
    house.put(
        thing("ell", extrude(ELL, 0, 2.5), pose),
        thing("open", Mesh(np.asarray(ball.vertices), np.asarray(ball.faces)[1:]), pose),
        thing("ball", Mesh(np.asarray(ball.vertices), np.asarray(ball.faces)), pose),
        room("flat", ELL, (1, 3)),
        room("endless", ELL, None),
        Item(uuid4(), "nothing", "Thing"),
    )
    turned = translate(rotate(ELL, 0.7, origin=(0, 0), use_radians=True), 5, -2)
    names = ("ell", "open", "ball", "flat", "endless", "nothing")
    found = {
        name: row
        for name in names
        for row in house.rows(
            SIZES.format(
                "area_m2, perimeter_m, length_m, width_m, extent_x_m, extent_y_m, height_m, volume_m3, volume_of"
            ),
            ids=house.of(name),
        )
    }
    x_min, y_min, x_max, y_max = turned.bounds
    assert found["ell"][:8] == pytest.approx(
        (ELL.area, ELL.length, 4, 3, x_max - x_min, y_max - y_min, 2.5, ELL.area * 2.5)
    )
    assert found["ell"][8] == "body"
    assert found["ball"][7:] == (pytest.approx(ball.volume), "body")
    assert found["open"][7:] == (pytest.approx(ball.volume, rel=0.02), "hull")
    assert found["flat"][6:] == (2, pytest.approx(ELL.area * 2), "prism")
    assert found["endless"][6:] == (None, None, None)
    assert found["nothing"] == (None,) * 9


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.lists(st.tuples(cell_polygons(), st.integers(-3, 3), st.integers(-3, 3)), min_size=3, max_size=4))
def test_areas_combine_as_in_shapely(house: House, drawn: list) -> None:
    areas = {f"r{n}": translate(area, x, y) for n, (area, x, y) in enumerate(drawn)}
    with house.undone():
        house.put(*(room(name, area) for name, area in areas.items()))
        every = house.of(*areas)
        united = shape_of(house.one("select public.st_asbinary(semap.united(:ids))", ids=every))
        assert same(united, shapely.union_all(list(areas.values())))
        common = shape_of(house.one("select public.st_asbinary(semap.intersected(:ids))", ids=every))
        expected = reduce(shapely.intersection, areas.values())
        assert (common is None) == (expected.area < 1e-9)
        assert common is None or same(common, expected)
        rest = dict(
            house.rows(
                "select reference_id, public.st_asbinary(footprint) from semap.subtracted(:refs, :targets)",
                refs=every[:2],
                targets=every[1:],
            )
        )
        taken = shapely.union_all(list(areas.values())[1:])
        left = areas["r0"].difference(taken)
        assert (every[0] in rest) == (left.area > 1e-9)
        assert left.area < 1e-9 or same(shape_of(rest[every[0]]), left)
        other = areas["r1"].difference(shapely.union_all(list(areas.values())[2:]))
        assert other.area < 1e-9 or same(shape_of(rest[every[1]]), other)


@pytest.mark.parametrize(("join", "style"), [("round", "round"), ("mitre", "mitre"), ("bevel", "bevel")])
def test_padding_is_a_buffer(house: House, join: str, style: str) -> None:
    house.put(room("ell", ELL), room("tiny", shapely.box(9, 9, 9.1, 9.1)))
    statement = "select instance_id, public.st_asbinary(footprint) from semap.padded(:ids, :distance, :join)"
    grown = dict(house.rows(statement, ids=house.of("ell", "tiny"), distance=0.3, join=join))
    assert same(shape_of(grown[house.ids["ell"]]), ELL.buffer(0.3, quad_segs=8, join_style=style))
    shrunk = dict(house.rows(statement, ids=house.of("ell", "tiny"), distance=-0.3, join=join))
    assert house.named(shrunk) == {"ell"}
    assert same(shape_of(shrunk[house.ids["ell"]]), ELL.buffer(-0.3, quad_segs=8, join_style=style))
    with pytest.raises(InvalidInput, match="no join"), translated(), house.undone():
        house.rows(statement, ids=[1], distance=1, join="sharp; drop")


@pytest.mark.parametrize(("measure", "key"), [("area", 0), ("height", 1), ("volume", 2)])
def test_larger_and_smaller_agree_with_the_numbers(house: House, measure: str, key: int) -> None:
    sides = {"a": (1, 1, 3), "b": (2, 1, 1), "c": (2, 2, 2), "d": (1, 2, 0.5)}
    house.put(*(thing(name, box(*side), pose_from_yaw(3, 1, 0, 0.4)) for name, side in sides.items()))
    other = House(house.connection, "other")
    other.put(thing("huge", box(9, 9, 9)))
    size = {name: (x * y, z, x * y * z)[key] for name, (x, y, z) in sides.items()}
    for function, holds in (("larger_than", np.greater), ("smaller_than", np.less)):
        found = house.rows(
            f"select reference_id, target_id from semap.{function}(:ids, p_measure => :measure, p_factor => 1.5)",
            ids=house.of("a", "b"),
            measure=measure,
        )
        assert set(found) == {
            (house.ids[r], house.ids[t])
            for r in "ab"
            for t in sides
            if t != r and holds(size[t], 1.5 * size[r])
        }
    with pytest.raises(InvalidInput, match="no measure"), translated(), house.undone():
        house.connection.execute(text("select * from semap.larger_than(array[1], p_measure => 'weight')"))
