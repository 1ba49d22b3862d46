"""Blueprints and concepts: what is shared by instances."""

from uuid import uuid4

import pytest
import shapely
from sqlalchemy import Connection, Engine

from semap.errors import Conflict, InvalidInput, NotFound
from semap.geometry.prism import extrude
from semap.model.building import Item
from semap.model.pose import Pose
from semap.model.source_geometry import BODY, SourceGeometry
from semap.store.map import blueprints
from semap.store.map.concept import (
    Concept,
    change_concept,
    check_attributes,
    create_concept,
    delete_concept,
    list_concepts,
)
from semap.store.map.instance_edit import Changes, create_instance, delete_instance, edit_instance
from semap.store.map.instances import get_instance, list_instances
from semap.store.map.maps import create_map


@pytest.fixture
def connection(engine: Engine):
    with engine.begin() as connection:
        create_map(connection, "office")
        yield connection


def body(width_m: float) -> SourceGeometry:
    return SourceGeometry(BODY, "TRIANGLEMESH3D", extrude(shapely.box(0, 0, width_m, 1), 0, 1))


def table(connection: Connection, name: str, x_m: float, blueprint: int) -> int:
    made = create_instance(connection, "office", Item(uuid4(), name, "Table", pose=Pose(x_m=x_m)))
    blueprints.switch_description(connection, made, blueprint)
    return made


def bounds(connection: Connection, instance_id: int) -> tuple[float, ...] | None:
    footprint = get_instance(connection, instance_id).footprint
    return None if footprint is None else footprint.bounds


def test_instances_follow_their_blueprint(connection: Connection) -> None:
    small = blueprints.create_blueprint(connection, "office", "small", [body(1)]).description_id
    large = blueprints.create_blueprint(connection, "office", "large", [body(5)]).description_id
    a, b = table(connection, "a", 0, small), table(connection, "b", 10, small)
    blueprints.put_geometry(connection, small, body(2))
    assert (bounds(connection, a), bounds(connection, b)) == ((0, 0, 2, 1), (10, 0, 12, 1))
    blueprints.put_geometry(
        connection, small, SourceGeometry(BODY, "TRIANGLEMESH3D", body(2).shape, Pose(y_m=4))
    )
    assert bounds(connection, b) == (10, 4, 12, 5)
    edit_instance(connection, a, Changes(body=body(3).shape))
    assert (bounds(connection, a), bounds(connection, b)) == ((0, 0, 3, 1), (10, 4, 12, 5))
    assert [each.instances for each in blueprints.list_blueprints(connection, "office")] == [1, 0]
    blueprints.delete_blueprint(connection, small, large)
    assert bounds(connection, b) == (10, 0, 15, 1)
    blueprints.remove_geometry(connection, large, BODY)
    assert bounds(connection, b) is None
    blueprints.put_geometry(connection, large, body(1))
    blueprints.delete_blueprint(connection, large)
    assert (bounds(connection, a), bounds(connection, b)) == ((0, 0, 3, 1), None)
    assert blueprints.list_blueprints(connection, "office") == ()


def test_a_copy_looks_alike_until_one_of_both_is_reshaped(connection: Connection) -> None:
    first = create_instance(connection, "office", Item(uuid4(), "first", "Table", body=body(1).shape))
    copy = connection.exec_driver_sql("select semap.copy_instance(%s, 'second')", (first,)).scalar_one()
    assert bounds(connection, copy) == (0, 0, 1, 1)
    edit_instance(connection, copy, Changes(pose=Pose(x_m=3)))
    edit_instance(connection, first, Changes(body=body(2).shape))
    assert (bounds(connection, first), bounds(connection, copy)) == ((0, 0, 2, 1), (3, 0, 4, 1))
    delete_instance(connection, first)
    assert bounds(connection, copy) == (3, 0, 4, 1)
    delete_instance(connection, copy)
    left = connection.exec_driver_sql(
        "select (select count(*) from semap.description), (select count(*) from semap.abstraction),"
        " (select count(*) from semap.frame)"
    ).one()
    assert tuple(left) == (0, 0, 1)


def test_what_stands_on_a_deleted_thing_goes_or_stays(connection: Connection) -> None:
    def stacked() -> int:
        lower = create_instance(
            connection, "office", Item(uuid4(), "lower", "Table", pose=Pose(x_m=1), body=body(1).shape)
        )
        for name, above in (("cup", "lower"), ("spoon", "cup")):
            create_instance(
                connection, "office", Item(uuid4(), name, "Thing", pose=Pose(x_m=2), body=body(1).shape)
            )
            connection.exec_driver_sql(
                "select semap.change_frame(a.frame_id, b.frame_id) from semap.frame a, semap.frame b"
                " where a.name = %s and b.name = %s",
                (name, above),
            )
        return lower

    lower = stacked()
    with pytest.raises(Conflict, match="carries other things: cup"), connection.begin_nested():
        delete_instance(connection, lower)
    delete_instance(connection, lower, "keep")
    cup = next(each for each in list_instances(connection) if each.name == "cup")
    assert bounds(connection, cup.instance_id) == (2, 0, 3, 1)
    delete_instance(connection, cup.instance_id, "delete")
    assert list_instances(connection) == ()
    assert connection.exec_driver_sql("select count(*) from semap.frame").scalar_one() == 1


def test_a_description_of_another_map_is_refused(connection: Connection) -> None:
    create_map(connection, "other")
    foreign = blueprints.create_blueprint(connection, "other", "x", [body(1)]).description_id
    here = create_instance(connection, "office", Item(uuid4(), "a", "Table"))
    with pytest.raises(InvalidInput, match="another map"), connection.begin_nested():
        blueprints.switch_description(connection, here, foreign)
    with pytest.raises(NotFound), connection.begin_nested():
        blueprints.switch_description(connection, here, 10**9)
    with pytest.raises(Conflict), connection.begin_nested():
        blueprints.create_blueprint(connection, "other", "x")
    with pytest.raises(NotFound, match="geometry nothing"), connection.begin_nested():
        blueprints.remove_geometry(connection, foreign, "nothing")


def test_the_taxonomy_is_a_graph_without_circles(connection: Connection) -> None:
    create_concept(connection, Concept(0, "Kitchen", ("Room",), ("https://example.org/Kitchen",)))
    create_concept(connection, Concept(0, "EatInKitchen", ("Kitchen", "Furniture")))
    is_a = {
        pair: connection.exec_driver_sql("select semap.is_a(%s, %s)", pair).scalar_one()
        for pair in (
            ("EatInKitchen", "Space"), ("EatInKitchen", "Furniture"), ("Kitchen", "Furniture"), ("Room", "Room"),
            ("Kitchen", "https://w3id.org/bot#Space"), ("Kitchen", "nothing"),
        )
    }  # fmt: skip
    assert list(is_a.values()) == [True, True, False, True, True, None]
    with pytest.raises(InvalidInput, match="lies below"), connection.begin_nested():
        change_concept(connection, "Room", parents=["EatInKitchen"])
    with pytest.raises(Conflict, match="root"), connection.begin_nested():
        delete_concept(connection, "Thing")
    with pytest.raises(InvalidInput, match="no concept Nothing"), connection.begin_nested():
        create_concept(connection, Concept(0, "Odd", ("Nothing",)))
    delete_concept(connection, "Kitchen")
    parents = {each.name: each.parents for each in list_concepts(connection)}
    assert parents["EatInKitchen"] == ("Furniture", "Room")


def test_attributes_follow_the_schemas_of_all_concepts_above(connection: Connection) -> None:
    schema = {
        "type": "object",
        "properties": {"seats": {"type": "integer", "minimum": 1}},
        "required": ["seats"],
    }
    with pytest.raises(InvalidInput, match="no JSON Schema"), connection.begin_nested():
        change_concept(connection, "Furniture", attribute_schema={"type": "nonsense"})
    change_concept(connection, "Furniture", attribute_schema=schema)
    check_attributes(connection, [("c", "Chair", {"seats": 2}), ("r", "Room", {})])
    for attributes, match in (({}, "'seats' is a required"), ({"seats": 0}, "attributes.seats: c: 0")):
        with pytest.raises(InvalidInput, match=match) as told:
            check_attributes(connection, [("c", "Chair", attributes)])
        assert "Furniture" in told.value.remedy
    chair = create_instance(connection, "office", Item(uuid4(), "c", "Chair", attributes={"seats": 1}))
    for act in (
        lambda: create_instance(connection, "office", Item(uuid4(), "d", "Chair")),
        lambda: edit_instance(connection, chair, Changes(attributes={})),
    ):
        with pytest.raises(InvalidInput, match="'seats' is a required"), connection.begin_nested():
            act()
    other = create_instance(connection, "office", Item(uuid4(), "e", "Room"))
    with pytest.raises(InvalidInput, match="'seats' is a required"), connection.begin_nested():
        edit_instance(connection, other, Changes(concept="Chair"))
