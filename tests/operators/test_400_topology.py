"""Footprints compared in SQL, held against shapely, for every choice of references and targets."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
import shapely
from furnishing import House, room
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapely import MultiPolygon, Polygon
from shapely.affinity import translate
from sqlalchemy.exc import DBAPIError

from semap.store.database.connection import one_transaction

Area = Polygon | MultiPolygon
Pair = tuple[str, str]
Band = tuple[float, float]

PREDICATES: dict[str, Callable[[Area, Area], bool]] = {
    "equals": shapely.equals,
    "disjoint": shapely.disjoint,
    "touches": shapely.touches,
    "contains": shapely.contains,
    "covers": shapely.covers,
    "covered_by": shapely.covered_by,
    "within": shapely.within,
    "intersects": shapely.intersects,
    "overlaps": shapely.overlaps,
    "crosses": shapely.crosses,
}


@st.composite
def areas(draw: st.DrawFn) -> Area:
    """Unions of cells of a small grid: they touch, hold and equal one another often, and are concave."""
    cells = draw(st.sets(st.tuples(st.integers(0, 3), st.integers(0, 3)), min_size=1, max_size=9))
    return shapely.union_all([shapely.box(x, y, x + 1, y + 1) for x, y in sorted(cells)]).simplify(0)


BANDS = st.sampled_from([None, (0.0, 2.0), (0.0, 3.0), (2.0, 3.0), (1.0, 4.0)])
SCENES = st.lists(st.tuples(areas(), st.integers(0, 3), BANDS), min_size=2, max_size=6)


@pytest.fixture
def house(database: str) -> Iterator[House]:
    with one_transaction(database, "semap_api") as connection:
        other = House(connection, "next door")
        other.put(room("everything", shapely.box(-99, -99, 99, 99), None))
        yield House(connection)


def furnish(house: House, scene: list[tuple[Area, int, Band | None]]) -> dict[str, tuple[Area, Band]]:
    """Put areas on the map; gives them with their heights by name."""
    things = {f"room {n}": (translate(area, shift, 0), band) for n, (area, shift, band) in enumerate(scene)}
    house.put(*(room(name, area, band) for name, (area, band) in things.items()))
    inf = float("inf")
    return {name: (area, band or (-inf, inf)) for name, (area, band) in things.items()}


def asked(house: House, call: str, **values: object) -> set[tuple[str, ...]]:
    names = {id_: name for name, id_ in house.ids.items()}
    return {
        (names[reference], names[target], *more)
        for reference, target, *more in house.rows(f"select * from {call}", **values)
    }


def chosen(data: st.DataObject, house: House, names: list[str]) -> tuple[dict[str, object], list[Pair]]:
    """Parameters :references and :targets, and the pairs that they make."""
    sides = [data.draw(st.none() | st.sets(st.sampled_from(names), min_size=1)) for _ in range(2)]
    references, targets = (names if side is None else sorted(side) for side in sides)
    parameters = {
        key: None if side is None else house.of(*side)
        for key, side in zip(("references", "targets"), sides, strict=True)
    }
    if parameters == {"references": None, "targets": None}:
        parameters["references"] = house.of(*names)
    return parameters, [(a, b) for a in references for b in targets if a != b]


IDS = "cast(:references as bigint[]), cast(:targets as bigint[])"


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(scene=SCENES, data=st.data())
def test_footprints_are_related_as_shapely_says(house: House, scene: list, data: st.DataObject) -> None:
    with house.undone():
        things = furnish(house, scene)
        ids, pairs = chosen(data, house, sorted(things))
        shapes = {name: area for name, (area, _) in things.items()}
        matrices = {(a, b, shapely.relate(shapes[a], shapes[b])) for a, b in pairs}
        assert asked(house, f"semap.relate({IDS})", **ids) == matrices
        for pattern in ("T*F**F***", "FF*FF****", "F***T****"):
            assert asked(house, f"semap.relate({IDS}, :pattern)", pattern=pattern, **ids) == {
                (a, b, m) for a, b, m in matrices if shapely.relate_pattern(shapes[a], shapes[b], pattern)
            }
        for name, holds in PREDICATES.items():
            expected = {(a, b) for a, b in pairs if holds(shapes[a], shapes[b])}
            assert asked(house, f"semap.topology(:name, {IDS})", name=name, **ids) == expected
        regions = {(a, b, region(shapes[a], shapes[b])) for a, b in pairs}
        assert asked(house, f"semap.rcc8_relations({IDS})", **ids) == regions
        some = ["EC", "TPP", "NTPPI"]
        assert asked(house, f"semap.rcc8_relations({IDS}, :some)", some=some, **ids) == {
            each for each in regions if each[2] in some
        }


def region(a: Area, b: Area) -> str:
    """RCC-8 by its definition: connected, part of, and connected to what is around it."""
    inside_a, inside_b = shapely.difference(a, b).is_empty, shapely.difference(b, a).is_empty
    edges_meet = a.boundary.intersects(b.boundary)
    if not a.intersects(b):
        return "DC"
    if a.intersection(b).area == 0:
        return "EC"
    if inside_a and inside_b:
        return "EQ"
    if inside_a:
        return "TPP" if edges_meet else "NTPP"
    if inside_b:
        return "TPPI" if edges_meet else "NTPPI"
    return "PO"


def test_each_relation_of_rcc8(house: House) -> None:
    a = shapely.box(0, 0, 4, 4)
    others = {
        "DC": shapely.box(5, 0, 6, 1),
        "EC": shapely.box(4, 4, 6, 6),
        "PO": shapely.box(3, 3, 6, 6),
        "TPP": shapely.box(-1, 0, 4, 4),
        "NTPP": shapely.box(-1, -1, 5, 5),
        "TPPI": shapely.box(0, 1, 2, 2),
        "NTPPI": shapely.box(1, 1, 2, 2),
        "EQ": Polygon([(0, 0), (2, 0), (4, 0), (4, 4), (0, 4)]),
    }
    for name, b in others.items():
        assert house.one("select semap.rcc8(:a, :b)", a=a.wkt, b=b.wkt) == name
    assert house.one("select semap.rcc8('point(0 0)', 'polygon((0 0, 1 0, 1 1, 0 0))')") is None


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(scene=SCENES, data=st.data())
def test_prisms_are_in_and_meet_one_another(house: House, scene: list, data: st.DataObject) -> None:
    with house.undone():
        things = furnish(house, scene)
        ids, pairs = chosen(data, house, sorted(things))

        def within(a: str, b: str) -> bool:
            (area, (low, high)), (other, (other_low, other_high)) = things[a], things[b]
            return area.contains(other) and low <= other_low and other_high <= high

        def partly(a: str, b: str) -> bool:
            (area, (low, high)), (other, (other_low, other_high)) = things[a], things[b]
            return area.intersection(other).area > 0 and max(low, other_low) < min(high, other_high)

        def meets(a: str, b: str) -> bool:
            (area, (low, high)), (other, (other_low, other_high)) = things[a], things[b]
            return area.intersects(other) and max(low, other_low) <= min(high, other_high)

        for mode in ("2d", "3d"):
            calls = {
                f"semap.in_objects({IDS}, '{mode}', true)": within,
                f"semap.in_objects({IDS}, '{mode}')": partly,
                f"semap.intersecting_objects({IDS}, '{mode}')": meets,
            }
            for call, holds in calls.items():
                assert asked(house, call, **ids) == {(a, b) for a, b in pairs if holds(a, b)}


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(scene=SCENES, area=areas(), band=BANDS)
def test_what_lies_in_an_area_and_in_a_volume(
    house: House, scene: list, area: Area, band: Band | None
) -> None:
    with house.undone():
        things = furnish(house, scene)
        low, high = band or (-float("inf"), float("inf"))

        def found(call: str, **values: object) -> set[str]:
            return house.named(
                id_
                for (id_,) in house.rows(
                    f"select * from {call}", area=area.wkt, map_id=house.map_id, **values
                )
            )

        for strict in (False, True):
            assert found("semap.in_area(:area, :map_id, p_strict => :strict)", strict=strict) == {
                name
                for name, (other, _) in things.items()
                if (area.covers if strict else area.intersects)(other)
            }
            volume = (
                "semap.in_volume(:area, :map_id, p_strict => :strict, p_z_min_m => :low, p_z_max_m => :high)"
            )
            assert found(volume, strict=strict, low=low, high=high) == {
                name
                for name, (other, (other_low, other_high)) in things.items()
                if (
                    area.covers(other) and low <= other_low and other_high <= high
                    if strict
                    else area.intersects(other) and max(low, other_low) <= min(high, other_high)
                )
            }
        assert found("semap.in_area(:area, :map_id, p_abstraction => 'Position2D')") == {
            name for name, (other, _) in things.items() if area.intersects(other.convex_hull.centroid)
        }
        some = house.of("room 0")
        assert found("semap.in_area(:area, :map_id, :some)", some=some) <= {"room 0"}


@pytest.mark.parametrize(
    ("call", "hint"),
    [
        ("semap.topology('beside', array[1])", "Use equals, disjoint"),
        ("semap.in_objects(array[1], p_mode => '4d')", "Use 2d"),
        ("semap.in_area('point(0 0)', 1, p_abstraction => 'Body')", "Use Footprint"),
        ("semap.in_area('point(0 0)', 1, p_abstraction => 'BoundingHull')", "Use in_volume"),
    ],
)
def test_what_is_unknown_is_refused_with_its_remedy(house: House, call: str, hint: str) -> None:
    with pytest.raises(DBAPIError, match=hint), house.connection.begin_nested():
        house.rows(f"select * from {call}")
