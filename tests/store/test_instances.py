"""Instances: made, edited, deleted, with all that is derived from them."""

from datetime import UTC, datetime, timedelta
from uuid import NAMESPACE_URL, uuid4, uuid5

import numpy as np
import psycopg
import pytest
import shapely
from shapely import Polygon
from shapely.affinity import rotate, translate
from sqlalchemy import Connection, Engine, text

from semap.errors import Conflict, InvalidInput, NotFound
from semap.geometry.pose import pose_from_yaw
from semap.geometry.prism import extrude
from semap.model.building import Building, HeightBand, Item, Mesh, Storey
from semap.model.pose import Pose
from semap.store.map.building import import_building
from semap.store.map.concept import Concept, create_concept, list_concepts
from semap.store.map.instance_edit import Changes, create_instance, delete_instance, edit_instance
from semap.store.map.instances import get_instance, list_instances
from semap.store.map.maps import create_map
from semap.store.relation.relations import Wanted, get_room, list_occupants, list_relations, list_rooms

ELL = Polygon([(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (0, 3)])
START = datetime(2026, 1, 31, tzinfo=UTC)
TILTED = Pose(qx=np.sqrt(0.5), qw=np.sqrt(0.5))


@pytest.fixture
def connection(engine: Engine):
    with engine.begin() as connection:
        create_map(connection, "office")
        yield connection


def ell(**more: object) -> Item:
    parts = {"uid": uuid4(), "name": "ell", "concept": "Room", "body": extrude(ELL, 0, 2.5)}
    return Item(**{**parts, **more})


def footprint(connection: Connection, instance_id: int) -> shapely.Geometry:
    return get_instance(connection, instance_id).footprint


def refused(engine: Engine, act, error: type[Exception], match: str) -> None:
    with pytest.raises(error, match=match), engine.begin() as connection:
        act(connection)


def test_an_instance_is_found_by_map_concept_and_name(connection: Connection) -> None:
    create_map(connection, "other")
    create_concept(connection, Concept(0, "Kitchen", ("Room",)))
    create_concept(connection, Concept(0, "Shelf", ()))
    for map_name, name, concept in (
        ("office", "a", "Room"),
        ("office", "b", "Kitchen"),
        ("office", "c", "Shelf"),
        ("other", "a", "Room"),
    ):
        create_instance(connection, map_name, Item(uuid4(), name, concept, alias=f"Old {name}"))

    def names(**filters: object) -> list[tuple[str, str]]:
        return [(each.map, each.name) for each in list_instances(connection, **filters)]

    everything = [("office", "a"), ("office", "b"), ("office", "c"), ("other", "a")]
    assert names() == everything
    assert names(map_name="office", concept_name="Room") == [("office", "a"), ("office", "b")]
    assert names(concept_name="Thing") == everything
    assert names(concept_name="Nothing") == []
    assert names(name="A") == names(name="old A") == [("office", "a"), ("other", "a")]
    _first, second = list_instances(connection, limit=2)
    assert [each.name for each in list_instances(connection, after=second.instance_id)] == ["c", "a"]
    parents = {each.name: each.parents for each in list_concepts(connection)}
    assert (parents["Kitchen"], parents["Shelf"], parents["Thing"]) == (("Room",), ("Thing",), ())


def test_a_new_instance_has_the_outline_of_its_body(connection: Connection) -> None:
    pose = pose_from_yaw(5, 6, 7, np.pi / 6)
    made = get_instance(connection, create_instance(connection, "office", ell(pose=pose)))
    expected = translate(rotate(ELL, 30, origin=(0, 0)), 5, 6)
    assert made.footprint.symmetric_difference(expected).area < 1e-9
    assert made.band == HeightBand(7, 9.5)
    assert made.pose.matrix() == pytest.approx(pose.matrix())


def test_a_tilted_body_has_the_outline_that_it_then_has(connection: Connection) -> None:
    made = get_instance(connection, create_instance(connection, "office", ell(pose=TILTED)))
    assert made.footprint.symmetric_difference(shapely.box(0, -2.5, 4, 0)).area < 1e-9
    assert made.band.z_max_m == pytest.approx(3)


def test_a_moved_instance_takes_its_footprint_along_exactly(connection: Connection) -> None:
    instance_id = create_instance(connection, "office", ell())
    edit_instance(connection, instance_id, Changes(pose=Pose(x_m=100, y_m=-50, z_m=3)))
    assert shapely.equals(footprint(connection, instance_id), translate(ELL, 100, -50))
    assert get_instance(connection, instance_id).band == HeightBand(3, 5.5)
    edit_instance(connection, instance_id, Changes(pose=pose_from_yaw(1, 2, 0, np.pi / 2)))
    turned = translate(rotate(ELL, 90, origin=(0, 0)), 1, 2)
    assert footprint(connection, instance_id).symmetric_difference(turned).area < 1e-9
    edit_instance(connection, instance_id, Changes(pose=Pose()))
    assert shapely.equals(footprint(connection, instance_id), ELL)


def test_a_given_outline_moves_too(connection: Connection) -> None:
    given, band = shapely.box(10, 10, 12, 13), HeightBand(1, 2)
    item = ell(body=None, footprint=given, band=band, pose=Pose(x_m=10))
    instance_id = create_instance(connection, "office", item)
    edit_instance(connection, instance_id, Changes(pose=Pose(x_m=11, z_m=4)))
    assert shapely.equals(footprint(connection, instance_id), translate(given, 1, 0))
    assert get_instance(connection, instance_id).band == HeightBand(5, 6)


def test_a_tilt_projects_what_it_tilts(connection: Connection) -> None:
    flat_id = create_instance(connection, "office", ell(body=None, footprint=shapely.box(0, 0, 1, 1)))
    solid_id = create_instance(connection, "office", ell(name="solid"))
    edit_instance(connection, solid_id, Changes(pose=TILTED))
    assert footprint(connection, solid_id).area == pytest.approx(10)
    leaning = Pose(qx=float(np.sin(np.pi / 6)), qw=float(np.cos(np.pi / 6)))
    edit_instance(connection, flat_id, Changes(pose=leaning))
    assert footprint(connection, flat_id).equals_exact(
        shapely.box(0, 0, 1, 0.5).normalize(), 1e-9, normalize=True
    )
    edit_instance(connection, flat_id, Changes(pose=TILTED))
    assert get_instance(connection, flat_id).footprint is None


def test_an_outline_given_to_what_is_tilted_stays_as_given(connection: Connection) -> None:
    instance_id = create_instance(connection, "office", ell(pose=TILTED))
    outline = shapely.box(0, 0, 9, 9)
    edit_instance(connection, instance_id, Changes(footprint=outline, band=HeightBand(1, 2)))
    given = get_instance(connection, instance_id)
    assert given.footprint is not None
    assert given.footprint.symmetric_difference(outline).area < 1e-9
    assert (given.band.z_min_m, given.band.z_max_m) == (pytest.approx(1), pytest.approx(2))


def test_outline_heights_and_body_change_together_with_the_pose(connection: Connection) -> None:
    instance_id = create_instance(connection, "office", ell())
    outline = shapely.box(0, 0, 9, 9)
    edit_instance(connection, instance_id, Changes(footprint=outline))
    assert shapely.equals(footprint(connection, instance_id), outline)
    assert get_instance(connection, instance_id).band == HeightBand(0, 2.5)
    edit_instance(connection, instance_id, Changes(pose=Pose(x_m=1), band=HeightBand(-1, 7)))
    assert shapely.equals(footprint(connection, instance_id), translate(outline, 1, 0))
    assert get_instance(connection, instance_id).band == HeightBand(-1, 7)
    edit_instance(connection, instance_id, Changes(band=None))
    assert get_instance(connection, instance_id).band == HeightBand(0, 2.5)
    edit_instance(connection, instance_id, Changes(body=extrude(shapely.box(0, 0, 2, 2), 1, 2)))
    assert shapely.equals(footprint(connection, instance_id), shapely.box(1, 0, 3, 2))
    assert get_instance(connection, instance_id).band == HeightBand(1, 2)


def test_what_an_edit_does_not_name_stays(connection: Connection) -> None:
    instance_id = create_instance(connection, "office", ell(alias="old", attributes={"a": 1}))
    before = get_instance(connection, instance_id)
    edit_instance(connection, instance_id, Changes(name="new"))
    after = get_instance(connection, instance_id)
    assert (after.instance.name, after.instance.alias) == ("new", "old")
    assert (after.attributes, after.band, after.pose) == (before.attributes, before.band, before.pose)
    assert after.updated_at > before.updated_at
    edit_instance(connection, instance_id, Changes(alias=None, concept="Door", attributes={"b": [2]}))
    after = get_instance(connection, instance_id)
    assert (after.instance.alias, after.instance.concept, after.attributes) == (None, "Door", {"b": [2]})
    frames = connection.scalars(text("select name from semap.frame order by name")).all()
    assert frames == ["map", "new"]


def test_moving_a_storey_moves_what_stands_on_it(connection: Connection) -> None:
    storey = Storey(uuid4(), "first", 3.0)
    item = ell(storey="first", pose=Pose(x_m=1, z_m=3))
    import_building(connection, "office", Building((storey,), (item,)))
    storey_id, room_id = (each.instance_id for each in list_instances(connection))
    edit_instance(connection, storey_id, Changes(pose=Pose(x_m=10, z_m=4)))
    moved = get_instance(connection, room_id)
    assert shapely.equals(moved.footprint, translate(ELL, 11, 0))
    assert (moved.band, moved.pose) == (HeightBand(4, 6.5), Pose(x_m=11, z_m=4))
    edit_instance(connection, room_id, Changes(pose=Pose(x_m=2, z_m=4)))
    assert get_instance(connection, room_id).pose == Pose(x_m=2, z_m=4)
    with pytest.raises(Conflict, match="first carries other things: ell"):
        delete_instance(connection, storey_id)
    delete_instance(connection, room_id)
    delete_instance(connection, storey_id)
    assert list_instances(connection) == ()


def test_what_cannot_be_is_refused_and_changes_nothing(engine: Engine, connection: Connection) -> None:
    instance_id = create_instance(connection, "office", ell())
    create_instance(connection, "office", ell(name="other"))
    connection.commit()
    wall = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 2]]), np.array([[0, 1, 2]]))
    bow_tie = Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])
    for changes, error, match in (
        (Changes(name="other"), Conflict, "other"),
        (Changes(name="new", concept="Nothing"), InvalidInput, "there is no concept Nothing"),
        (Changes(name="new", footprint=bow_tie), InvalidInput, "crosses itself"),
        (Changes(name="new", band=HeightBand(2, 1)), InvalidInput, "heights from 2 m to 1 m"),
        (Changes(name="new", pose=Pose(qw=0)), InvalidInput, "quaternion"),
        (Changes(name="new", pose=Pose(x_m=float("nan"))), InvalidInput, "finite"),
    ):
        refused(engine, lambda c, changes=changes: edit_instance(c, instance_id, changes), error, match)
    for item, error, match in (
        (ell(), Conflict, "ell"),
        (ell(name="map"), Conflict, "map"),
        (ell(name="new", concept="Nothing"), InvalidInput, "there is no concept Nothing"),
        (ell(name="new", storey="ell"), InvalidInput, "there is no storey ell"),
        (ell(name="new", joins=("nowhere",)), InvalidInput, "nothing named nowhere"),
        (ell(name="new", body=wall, band=HeightBand(0, 1)), InvalidInput, "no footprint"),
    ):
        refused(engine, lambda c, item=item: create_instance(c, "office", item), error, match)
    refused(engine, lambda c: create_instance(c, "nowhere", ell()), NotFound, "no map nowhere")
    for act in (get_instance, delete_instance, lambda c, id_: edit_instance(c, id_, Changes(name="x"))):
        refused(engine, lambda c, act=act: act(c, 10**6), NotFound, "no instance 1000000")
    with engine.begin() as fresh:
        assert [each.name for each in list_instances(fresh)] == ["ell", "other"]
        assert shapely.equals(footprint(fresh, instance_id), ELL)


def test_relations_follow_edits_and_end_with_the_room(engine: Engine, database: str) -> None:
    with engine.begin() as connection:
        create_map(connection, "office")
        room_id = create_instance(connection, "office", ell())
    track_id = _seen_at(database, 0.5, 0.5)

    def present() -> list[str]:
        with engine.begin() as connection:
            occupants = list_occupants(connection, room_id)
            assert get_room(connection, room_id).occupants == len(occupants)
            assert [each.occupants for each in list_rooms(connection)] == [len(occupants)]
            related = list_relations(connection, Wanted(track="person", instance="ell"))
            assert [each.since for each in related] == [each.since for each in occupants]
            return [each.name for each in occupants]

    def edit(changes: Changes) -> None:
        with engine.begin() as connection:
            edit_instance(connection, room_id, changes)

    assert present() == ["person"]
    edit(Changes(pose=Pose(x_m=10)))
    assert present() == []
    edit(Changes(pose=Pose(x_m=0.2)))
    assert present() == ["person"]
    with engine.begin() as connection:
        delete_instance(connection, room_id)
        assert list_relations(connection) == ()
        with pytest.raises(NotFound, match="no room"):
            list_occupants(connection, room_id)
        changes = connection.execute(
            text("select track_id, kind::text, cause::text from semap.relation_change order by change_id")
        ).all()
    assert changes == [
        (track_id, "began", "appeared"),
        (track_id, "ended", "map"),
        (track_id, "began", "map"),
        (track_id, "ended", "map"),
    ]


def _seen_at(dsn: str, x_m: float, y_m: float) -> int:
    with psycopg.connect(dsn, autocommit=True) as plain:
        source_id = plain.execute(
            "insert into semap.source (map_id, name) select map_id, 's' from semap.map returning source_id"
        ).fetchone()[0]
        track_id = plain.execute(
            "insert into semap.track (uid, source_id, map_id, name)"
            " select %s, %s, map_id, 'person' from semap.map returning track_id",
            [uuid5(NAMESPACE_URL, "person"), source_id],
        ).fetchone()[0]
        plain.execute(
            "insert into semap.track_state (track_id, stamp, x_m, y_m) values (%s, %s, %s, %s)",
            [track_id, START + timedelta(seconds=1), x_m, y_m],
        )
    return track_id
