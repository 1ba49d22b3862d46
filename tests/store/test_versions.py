"""Who changed what, how it was before, and undo."""

from datetime import datetime
from uuid import uuid4

import pytest
import shapely
from server import OWNER
from sqlalchemy import Engine

from semap.errors import Conflict, InvalidInput, NotFound
from semap.geometry.prism import extrude
from semap.model.building import HeightBand, Item
from semap.model.pose import Pose
from semap.store.map import frames, history
from semap.store.map.concept import Concept, change_concept, create_concept, list_concepts
from semap.store.map.instance_edit import Changes, create_instance, delete_instance, edit_instance
from semap.store.map.instances import get_instance, list_instances
from semap.store.map.maps import create_map, delete_map

SQUARE = shapely.box(0, 0, 2, 2)


@pytest.fixture
def office(engine: Engine) -> int:
    with engine.begin() as connection:
        history.sign(connection, "ada", "a new office")
        create_map(connection, "office")
        return create_instance(
            connection,
            "office",
            Item(uuid4(), "table", "Furniture", body=extrude(SQUARE, 0, 1), attributes={"legs": 4}),
        )


def edit(engine: Engine, instance_id: int, changes: Changes, author: str = "ada", message: str = "") -> None:
    with engine.begin() as connection:
        history.sign(connection, author, message)
        edit_instance(connection, instance_id, changes)


def now(engine: Engine) -> datetime:
    with engine.begin() as connection:
        return connection.exec_driver_sql("select clock_timestamp()").scalar_one()


def test_a_map_is_shown_as_of_any_time(engine: Engine, office: int) -> None:
    first = now(engine)
    edit(engine, office, Changes(pose=Pose(x_m=5), name="desk"))
    second = now(engine)
    edit(engine, office, Changes(body=extrude(shapely.box(0, 0, 1, 1), 0, 3), attributes={"legs": 3}))
    third = now(engine)
    with engine.begin() as connection:
        delete_instance(connection, office)
    with engine.begin() as connection:
        shown = [
            [
                (p.name, p.concept, p.attributes, p.pose, p.footprint.bounds, p.band)
                for p in history.instances_as_of(connection, "office", at)
            ]
            for at in (first, second, third, now(engine))
        ]
        assert (
            history.instances_as_of(connection, "office", datetime.fromisoformat("2000-01-01T00:00Z")) == ()
        )
        with pytest.raises(InvalidInput, match="time zone"):
            history.instances_as_of(connection, "office", datetime(2026, 1, 1))  # noqa: DTZ001
    four, three = {"legs": 4}, {"legs": 3}
    assert shown == [
        [("table", "Furniture", four, Pose(), (0, 0, 2, 2), HeightBand(0, 1))],
        [("desk", "Furniture", four, Pose(x_m=5), (5, 0, 7, 2), HeightBand(0, 1))],
        [("desk", "Furniture", three, Pose(x_m=5), (5, 0, 6, 1), HeightBand(0, 3))],
        [],
    ]


def test_a_change_set_says_who_did_what_and_why(engine: Engine, office: int) -> None:
    edit(engine, office, Changes(name="desk"), "grace", "it is a desk")
    with engine.begin() as connection:
        newest, oldest = history.list_change_sets(connection, "office")
        assert (newest.author, newest.message, newest.undoes) == ("grace", "it is a desk", None)
        assert (oldest.author, oldest.message) == ("ada", "a new office")
        assert history.list_change_sets(connection, "office", before=newest.change_set_id) == (oldest,)
        assert {(r.table, r.name, r.action) for r in history.rows_of(connection, newest.change_set_id)} == {
            ("instance", "desk", "changed"), ("frame", "desk", "changed"),
        }  # fmt: skip
        assert ("instance", "table", "made") in {
            (r.table, r.name, r.action) for r in history.rows_of(connection, oldest.change_set_id)
        }
    with engine.begin() as connection:
        connection.exec_driver_sql("update semap.instance set alias = 'x'")
    with engine.begin() as connection:
        assert history.list_change_sets(connection, limit=1)[0].author == OWNER


def test_undo_takes_a_change_set_back_unless_it_was_changed_since(engine: Engine, office: int) -> None:
    edit(engine, office, Changes(pose=Pose(y_m=3)))
    edit(engine, office, Changes(name="desk"))
    with engine.begin() as connection:
        renamed, moved, made = history.list_change_sets(connection, "office")
        with pytest.raises(NotFound), connection.begin_nested():
            history.undo(connection, 10**6)
        with pytest.raises(Conflict, match="came after it") as told, connection.begin_nested():
            history.undo(connection, made.change_set_id)
        assert "later change first" in told.value.remedy
    with engine.begin() as connection:
        undone = history.undo(connection, renamed.change_set_id)
        assert undone.undoes == renamed.change_set_id
    with engine.begin() as connection:
        assert get_instance(connection, office).instance.name == "table"
        with pytest.raises(Conflict, match="came after it"):
            history.undo(connection, moved.change_set_id)
    with engine.begin() as connection:
        delete_instance(connection, office)
    with engine.begin() as connection:
        assert list_instances(connection) == ()
        history.undo(connection, history.list_change_sets(connection, limit=1)[0].change_set_id)
    with engine.begin() as connection:
        again = get_instance(connection, office)
        assert (again.instance.name, again.pose, again.footprint.bounds) == (
            "table",
            Pose(y_m=3),
            (0, 3, 2, 5),
        )


def test_concepts_have_a_history_too_and_a_deleted_map_has_none(engine: Engine, office: int) -> None:
    with engine.begin() as connection:
        create_concept(connection, Concept(0, "Desk", ("Table",), ("ex:desk",)))
    with engine.begin() as connection:
        change_concept(connection, "Desk", parents=["Furniture", "Table"], iris=[])
    with engine.begin() as connection:
        history.undo(connection, history.list_change_sets(connection, limit=1)[0].change_set_id)
        desk = next(each for each in list_concepts(connection) if each.name == "Desk")
        assert (desk.parents, desk.iris) == (("Table",), ("ex:desk",))
    with engine.begin() as connection:
        delete_map(connection, "office")
    with engine.begin() as connection:
        left = connection.exec_driver_sql(
            "select distinct table_name from semap.row_version where table_name not like 'concept%%'"
        ).all()
        assert left == []


def test_undo_of_what_moved_in_time_gives_every_stamp_back(engine: Engine, office: int) -> None:
    first, last = (datetime.fromisoformat(f"2026-01-0{day}T00:00Z") for day in (1, 2))
    with engine.begin() as connection:
        frames.create_frame(connection, "office", "cart", "map", Pose(x_m=100))
        frame_id = frames.frame_named(connection, "office", "table").frame_id
        for stamp, x_m in ((first, 5), (last, 10)):
            frames.set_pose(connection, frame_id, Pose(x_m=x_m), stamp)
    with engine.begin() as connection:
        known = history.list_change_sets(connection, limit=1)[0]
        frames.change_frame(connection, frame_id, "cart")
    with engine.begin() as connection:
        assert get_instance(connection, office).footprint.bounds == (10, 0, 12, 2)
        (past,) = history.instances_as_of(connection, "office", known.made_at)
        assert (past.pose, past.footprint.bounds) == (Pose(x_m=10), (10, 0, 12, 2))
        undone = history.undo(connection, history.list_change_sets(connection, limit=1)[0].change_set_id)
        assert undone.change_set_id > known.change_set_id
    with engine.begin() as connection:
        assert get_instance(connection, office).footprint.bounds == (10, 0, 12, 2)
        assert [pose.x_m for _, pose in frames.list_poses(connection, frame_id)] == [0, 5, 10]
        delete_instance(connection, office)
    with engine.begin() as connection:
        history.undo(connection, history.list_change_sets(connection, limit=1)[0].change_set_id)
        assert [pose.x_m for _, pose in frames.list_poses(connection, frame_id)] == [0, 5, 10]


def test_undo_takes_nothing_along_that_came_later(engine: Engine, office: int) -> None:
    with engine.begin() as connection:
        (made,) = history.list_change_sets(connection, "office")
        with pytest.raises(Conflict, match="made the map"), connection.begin_nested():
            history.undo(connection, made.change_set_id)
        frames.create_frame(connection, "office", "lower", "map")
    with engine.begin() as connection:
        frames.create_frame(connection, "office", "upper", "lower")
    with engine.begin() as connection:
        upper, lower, _ = history.list_change_sets(connection, "office")
        with pytest.raises(Conflict, match="upper came after it and needs it"), connection.begin_nested():
            history.undo(connection, lower.change_set_id)
        history.undo(connection, upper.change_set_id)
    with engine.begin() as connection:
        history.undo(connection, lower.change_set_id)
        assert [each.name for each in frames.list_frames(connection, "office")] == ["map", "table"]


def test_names_that_were_swapped_are_swapped_back(engine: Engine, office: int) -> None:
    with engine.begin() as connection:
        other = create_instance(connection, "office", Item(uuid4(), "chair", "Chair"))
    with engine.begin() as connection:
        for instance_id, name in ((office, "x"), (other, "table"), (office, "chair")):
            edit_instance(connection, instance_id, Changes(name=name))
    with engine.begin() as connection:
        history.undo(connection, history.list_change_sets(connection, limit=1)[0].change_set_id)
    with engine.begin() as connection:
        names = {each.instance_id: each.name for each in list_instances(connection)}
        assert names == {office: "table", other: "chair"}
        left = connection.exec_driver_sql(
            "select count(*) from semap.description d where is_absolute and not exists"
            " (select from semap.instance i where i.absolute_description_id = d.description_id)"
        ).scalar_one()
        assert left == 0


def test_a_change_set_of_the_past_is_not_added_to(engine: Engine, office: int) -> None:
    with engine.begin() as connection:
        (made,) = history.list_change_sets(connection, "office")
        connection.exec_driver_sql(f"set semap.change_set = '{made.change_set_id}'")
        edit_instance(connection, office, Changes(alias="forged"))
    with engine.begin() as connection:
        assert len(history.list_change_sets(connection, "office")) == 2
        assert history.get_change_set(connection, made.change_set_id) == made
