"""Maps and the import of buildings."""

from dataclasses import replace
from uuid import NAMESPACE_URL, UUID, uuid5

import numpy as np
import pytest
import shapely
from shapely import Polygon
from sqlalchemy import Connection, Engine, text

from semap.errors import Conflict, InvalidInput, NotFound
from semap.geometry.pose import pose_from_yaw
from semap.geometry.prism import extrude
from semap.model.building import Building, Finding, HeightBand, Item, Mesh, Storey
from semap.store.map.building import import_building
from semap.store.map.instances import get_instance, list_instances
from semap.store.map.maps import create_map, delete_map, get_map, list_maps

ELL = Polygon([(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (0, 3)])
TABLES = [
    "map",
    "frame",
    "frame_pose",
    "description",
    "geometry",
    "abstraction",
    "instance",
    "door_room",
    "continuous_query",
    "rule",
    "region",
    "region_cell",
    "region_edge",
    "relation",
]


def uid(name: str) -> UUID:
    return uuid5(NAMESPACE_URL, name)


def room(name: str, **more: object) -> Item:
    return Item(uid=uid(name), name=name, concept="Room", **more)


def office() -> Building:
    """Two rooms on the first floor, joined by a door; a shelf of an unknown concept in the yard."""
    return Building(
        storeys=(Storey(uid("first"), "first", 3.5),),
        items=(
            room(
                "ell",
                storey="first",
                pose=pose_from_yaw(10, 20, 3.5, np.pi / 2),
                body=extrude(ELL, 0, 2.5),
                attributes={"number": 7},
            ),
            room("square", storey="first", footprint=shapely.box(10, 23, 14, 27), band=HeightBand(3.5, 6)),
            Item(uid("door"), "door", "Door", storey="first", joins=("ell", "square", "cellar")),
            Item(uid("shelf"), "shelf", "Shelf", alias="books", footprint=shapely.box(0, 0, 1, 1)),
        ),
        findings=(Finding("repaired", "square", "ring closed"),),
    )


def counts(connection: Connection) -> dict[str, int]:
    return {name: connection.scalar(text(f"select count(*) from semap.{name}")) for name in TABLES}


@pytest.fixture
def connection(engine: Engine):
    with engine.begin() as connection:
        yield connection


def test_a_map_comes_with_a_frame_a_query_and_a_rule(connection: Connection) -> None:
    made = create_map(connection, "office", cell_m=2.5)
    assert (made.name, made.cell_m, made.instances, made.tracks) == ("office", 2.5, 0, 0)
    assert made == get_map(connection, "office") == list_maps(connection)[0]
    rows = connection.execute(
        text(
            "select f.name, p.x_m, p.qw, q.name, c.name, r.name, r.declaration, r.version from semap.map m"
            " join semap.frame f using (map_id) join semap.frame_pose p using (frame_id)"
            " join semap.continuous_query q using (map_id)"
            " join semap.concept c on c.concept_id = q.object_concept_id"
            " join semap.rule_query using (query_id) join semap.rule r using (rule_id)"
        )
    ).all()
    declaration = {"input": "track_in_room", "emit": {"began": "entered", "ended": "left"}}
    assert rows == [("map", 0, 1, "track_in_room", "Room", "room_visits", declaration, 1)]


def test_the_uid_of_a_map_depends_on_its_name_only(connection: Connection) -> None:
    first = create_map(connection, "office").uid
    delete_map(connection, "office")
    other = create_map(connection, "other").uid
    assert create_map(connection, "office").uid == first != other


def test_a_name_is_given_once(connection: Connection) -> None:
    create_map(connection, "office")
    with pytest.raises(Conflict) as caught:
        create_map(connection, "office")
    assert caught.value.remedy


def test_an_unfit_map_is_refused(engine: Engine) -> None:
    for name, cell_m in (("", 4.0), ("office", 0.0), ("nul\0", 4.0)):
        with pytest.raises(InvalidInput), engine.begin() as connection:
            create_map(connection, name, cell_m)


def test_an_unknown_map_is_not_found(connection: Connection) -> None:
    for act in (get_map, delete_map, lambda c, name: import_building(c, name, office())):
        with pytest.raises(NotFound, match="There is no map nowhere"):
            act(connection, "nowhere")


def test_lists_go_on_where_they_ended(connection: Connection) -> None:
    for name in ("b", "a", "c"):
        create_map(connection, name)
    assert [m.name for m in list_maps(connection, limit=2)] == ["a", "b"]
    assert [m.name for m in list_maps(connection, after="b")] == ["c"]


def test_an_import_is_reported(connection: Connection) -> None:
    create_map(connection, "office")
    steps: list[tuple[int, int]] = []
    report = import_building(connection, "office", office(), lambda *step: steps.append(step))
    assert steps == [(4, 4)]
    assert report.concepts == {"Door": 1, "Room": 2, "Shelf": 1, "Storey": 1}
    assert report.doors == {3: 1}
    assert report.findings == (
        Finding("repaired", "square", "ring closed"),
        Finding("note", "Shelf", "a new concept, put below Thing"),
        Finding("skipped", "door", "it joins cellar, which is not there"),
    )


def test_an_imported_room_stands_where_its_pose_says(connection: Connection) -> None:
    create_map(connection, "office")
    import_building(connection, "office", office())
    found = {each.name: get_instance(connection, each.instance_id) for each in list_instances(connection)}
    assert list(found) == ["first", "ell", "square", "door", "shelf"]

    ell = found["ell"]
    turned = shapely.affinity.translate(shapely.affinity.rotate(ELL, 90, origin=(0, 0)), 10, 20)
    assert ell.footprint.symmetric_difference(turned).area < 1e-9
    assert ell.band == HeightBand(3.5, 6.0)
    assert ell.pose.matrix() == pytest.approx(pose_from_yaw(10, 20, 3.5, np.pi / 2).matrix())
    assert (ell.instance.storey, ell.has_body, ell.attributes) == ("first", True, {"number": 7})

    assert shapely.equals_exact(found["square"].footprint, shapely.box(10, 23, 14, 27))
    assert found["square"].band == HeightBand(3.5, 6)
    assert found["shelf"].band is None
    assert found["shelf"].instance.concept == "Shelf"
    assert set(found["door"].joins.values()) == {"ell", "square"}
    assert set(found["ell"].joins.values()) == {"door"}
    assert found["first"].pose.z_m == 3.5


def test_relative_descriptions_are_in_the_own_frame(connection: Connection) -> None:
    create_map(connection, "office")
    import_building(connection, "office", office())
    rows = connection.execute(
        text(
            "select i.name, a.type, st_area(a.geometry), a.z_min_m, a.z_max_m from semap.instance i"
            " join semap.abstraction a on a.description_id = i.relative_description_id"
            " where i.name = 'ell' and a.type in ('Footprint', 'FootprintHull', 'Position3D') order by a.type"
        )
    ).all()
    assert rows == [
        ("ell", "Footprint", pytest.approx(ELL.area), 0, 2.5),
        ("ell", "FootprintHull", pytest.approx(ELL.convex_hull.area), 0, 2.5),
        ("ell", "Position3D", 0, 0, 2.5),
    ]
    parents = connection.execute(
        text(
            "select f.name, p.name, o.z_m from semap.frame f join semap.frame p on p.frame_id = f.parent_id"
            " join semap.frame_pose o on o.frame_id = f.frame_id order by f.frame_id"
        )
    ).all()
    assert parents == [
        ("first", "map", 3.5),
        ("ell", "first", 0),
        ("square", "first", -3.5),
        ("door", "first", -3.5),
        ("shelf", "map", 0),
    ]


def test_a_footprint_of_the_file_wins_over_the_body(connection: Connection) -> None:
    create_map(connection, "office")
    given = shapely.box(-1, -1, 5, 5)
    item = room("hall", footprint=given, body=extrude(ELL, 0, 2.5))
    import_building(connection, "office", Building((), (item,)))
    detail = get_instance(connection, list_instances(connection)[0].instance_id)
    assert shapely.equals_exact(detail.footprint, given)
    assert detail.band == HeightBand(0, 2.5)


def test_a_body_without_area_is_noted(connection: Connection) -> None:
    create_map(connection, "office")
    wall = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 2]]), np.array([[0, 1, 2]]))
    report = import_building(connection, "office", Building((), (room("flat", body=wall),)))
    (finding,) = report.findings
    assert (finding.action, finding.subject) == ("note", "flat")
    assert finding.reason.startswith("without a footprint")


def test_a_floor_plate_holds_at_every_height(connection: Connection) -> None:
    create_map(connection, "office")
    plate = Mesh(np.array([[0.0, 0, 1], [1, 0, 1], [0, 1, 1]]), np.array([[0, 1, 2]]))
    import_building(connection, "office", Building((), (room("plate", body=plate),)))
    assert get_instance(connection, list_instances(connection)[0].instance_id).band is None


def test_importing_twice_is_refused_and_changes_nothing(engine: Engine) -> None:
    with engine.begin() as connection:
        create_map(connection, "office")
        import_building(connection, "office", office())
        before = counts(connection)
    with pytest.raises(Conflict) as caught, engine.begin() as connection:
        import_building(connection, "office", office())
    assert str(caught.value) == "The map office has first, ell, square, door, shelf already."
    assert "delete that map" in caught.value.remedy
    with engine.begin() as connection:
        assert counts(connection) == before


def test_a_failing_import_changes_nothing(engine: Engine) -> None:
    with engine.begin() as connection:
        create_map(connection, "office")
        before = counts(connection)
    vast = room("vast", footprint=shapely.box(0, 0, 1e6, 1e6))
    for item in (vast, room("ell"), room("map"), room("nul\0")):
        building = replace(office(), items=(*office().items, item))
        with pytest.raises((InvalidInput, Conflict)), engine.begin() as connection:
            import_building(connection, "office", building)
        with engine.begin() as connection:
            assert counts(connection) == before, item.name


def test_the_same_name_may_be_on_two_maps(connection: Connection) -> None:
    for name in ("a", "b"):
        create_map(connection, name)
        import_building(connection, name, office())
    assert [m.instances for m in list_maps(connection)] == [5, 5]


def test_a_deleted_map_leaves_nothing(engine: Engine) -> None:
    with engine.begin() as connection:
        empty = counts(connection)
        create_map(connection, "office")
        import_building(connection, "office", office())
    with engine.begin() as connection:
        delete_map(connection, "office")
        assert counts(connection) == empty


def test_thousands_of_rooms_take_one_statement_each_table(engine: Engine) -> None:
    rooms = tuple(
        room(f"r{x}-{y}", pose=pose_from_yaw(x * 5, y * 4, 0, 0.0), body=extrude(ELL, 0, 3))
        for x in range(50)
        for y in range(60)
    )
    with engine.begin() as connection:
        create_map(connection, "tower")
        import_building(connection, "tower", Building((), rooms))
    with engine.begin() as connection:
        assert counts(connection)["region"] == 3000
        areas = text("select sum(st_area(footprint)) from semap.region")
        assert connection.scalar(areas) == pytest.approx(3000 * ELL.area)
