"""Frame structure from spatial relations: nothing moves by it, contents move with their container from then on."""

from collections.abc import Iterator

import numpy as np
import pytest
from furnishing import House, box, room, thing
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapely import box as area

from semap.geometry.pose import pose_from_yaw
from semap.model.pose import Pose
from semap.store.database.connection import one_transaction

QUICK = settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
IN = "select target_id, reference_id, outcome from semap.structure_by_containment(:map_id, {})"
ON = "select target_id, reference_id, outcome from semap.structure_by_support(:map_id, {})"
FREE = "select target_id, outcome from semap.unstructure(:ids)"
TURN = pose_from_yaw(7, -3, 0.5, 0.9)


@pytest.fixture
def house(database: str) -> Iterator[House]:
    with one_transaction(database, "semap_api") as connection:
        yield House(connection)


def carriers(house: House) -> dict[str, str]:
    """The name of the frame right around each instance's frame."""
    return dict(
        house.rows(
            "select i.name, p.name from semap.instance i join semap.frame f using (frame_id)"
            " left join semap.frame p on p.frame_id = f.parent_id where i.map_id = :map_id",
            map_id=house.map_id,
        )
    )


def done(house: House, rows: list[tuple]) -> dict[str, tuple[str, str]]:
    return {str(*house.named([t])): (str(*house.named([r])), outcome) for t, r, outcome in rows}


def move(house: House, name: str, world: np.ndarray, pose: Pose = TURN) -> None:
    """Put the frame of an instance elsewhere in its parent."""
    house.one(
        "select 1 from semap.set_transform((select frame_id from semap.instance where instance_id = :id),"
        " row(:x, :y, :z, 0, 0, :qz, :qw)::semap.pose)",
        id=house.ids[name],
        x=pose.x_m,
        y=pose.y_m,
        z=pose.z_m,
        qz=pose.qz,
        qw=pose.qw,
    )


def close(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> bool:
    return a.keys() == b.keys() and all(np.allclose(a[name], b[name], rtol=0, atol=1e-9) for name in a)


def test_contents_move_with_the_room_that_they_are_in(house: House) -> None:
    house.put(
        room("study", area(0, 0, 4, 4)),
        thing("chest", box(1, 1, 1), pose_from_yaw(1, 1, 0, 0.3)),
        thing("coin", box(0.1, 0.1, 0.1), pose_from_yaw(1, 1, 0.2, 1.1)),
        thing("far", box(1, 1, 1), Pose(9, 9)),
    )
    before = house.world_poses()
    assert done(house, house.rows(IN.format("null"), map_id=house.map_id)) == {
        "chest": ("study", "carried"),
        "coin": ("chest", "carried"),
    }
    assert carriers(house) == {"study": "map", "chest": "study", "coin": "chest", "far": "map"}
    assert close(house.world_poses(), before)
    again = done(house, house.rows(IN.format("null"), map_id=house.map_id))
    assert {outcome for _, outcome in again.values()} == {"carried already"}

    move(house, "study", before["study"])
    moved = house.world_poses()
    step = moved["study"] @ np.linalg.inv(before["study"])
    expected = {name: pose if name == "far" else step @ pose for name, pose in before.items()}
    assert close(moved, expected)
    x_m, y_m = house.rows(
        "select public.st_x(geometry), public.st_y(geometry) from semap.abstraction"
        " where instance_id = :id and type = 'Position2D'",
        id=house.ids["coin"],
    )[0]
    assert (step @ [1, 1, 0, 1])[:2] == pytest.approx([x_m, y_m])

    freed = {str(*house.named([t])): outcome for t, outcome in house.rows(FREE, ids=list(house.ids.values()))}
    assert freed == {"study": "free already", "far": "free already", "chest": "freed", "coin": "freed"}
    assert set(carriers(house).values()) == {"map"}
    assert close(house.world_poses(), moved)


def test_what_lies_on_a_table_moves_with_it(house: House) -> None:
    house.put(
        thing("table", box(2, 1, 0.7), pose_from_yaw(5, 5, 0, 0.4), concept="Table"),
        thing("tray", box(0.5, 0.5, 0.05), pose_from_yaw(5, 5, 0.7, 1.0)),
        thing("cup", box(0.1, 0.1, 0.1), Pose(5.05, 5, 0.75)),
        thing("lamp", box(0.1, 0.1, 0.1), Pose(5, 5, 2)),
        thing("stool", box(0.4, 0.4, 0.4), Pose(8, 8)),
    )
    before = house.world_poses()
    found = done(house, house.rows(ON.format("null"), map_id=house.map_id))
    assert found == {"tray": ("table", "carried"), "cup": ("tray", "carried")}
    assert close(house.world_poses(), before)
    move(house, "table", before["table"])
    moved = house.world_poses()
    step = moved["table"] @ np.linalg.inv(before["table"])
    carried = {"table", "tray", "cup"}
    assert close(moved, {name: step @ pose if name in carried else pose for name, pose in before.items()})


def test_only_what_is_asked_for_is_put_on_what_is_named(house: House) -> None:
    house.put(
        room("study", area(0, 0, 4, 4)),
        thing("chest", box(1, 1, 1), Pose(1, 1)),
        thing("coin", box(0.1, 0.1, 0.1), Pose(1, 1, 0.2)),
    )
    rows = house.rows(
        IN.format(":ids, :references"),
        map_id=house.map_id,
        ids=house.of("coin"),
        references=house.of("study"),
    )
    assert done(house, rows) == {"coin": ("study", "carried")}
    assert carriers(house) == {"study": "map", "chest": "map", "coin": "study"}


def test_no_circle_is_made_and_shared_frames_stay(house: House) -> None:
    house.put(
        room("study", area(0, 0, 4, 4)),
        thing("chest", box(1, 1, 1), Pose(1, 1)),
        thing("pair", box(0.1, 0.1, 0.1), Pose(2, 2)),
        thing("other", box(0.1, 0.1, 0.1), Pose(2, 2)),
    )
    house.rows(
        "select semap.change_frame(s.frame_id, c.frame_id) from semap.instance s, semap.instance c"
        " where s.instance_id = :study and c.instance_id = :chest",
        study=house.ids["study"],
        chest=house.ids["chest"],
    )
    house.connection.exec_driver_sql(
        "update semap.instance o set frame_id = p.frame_id from semap.instance p where o.name = 'other' and p.name = 'pair'"
    )
    before = house.world_poses()
    rows = house.rows(IN.format("null"), map_id=house.map_id)
    assert done(house, rows) == {
        "chest": ("study", "kept: it carries what would carry it"),
        "pair": ("study", "kept: its frame is not its own"),
        "other": ("study", "kept: its frame is not its own"),
    }
    assert close(house.world_poses(), before)


@QUICK
@given(
    things=st.lists(
        st.tuples(*[st.integers(0, 12)] * 2, st.integers(0, 2), st.integers(0, 6), *[st.integers(1, 5)] * 3),
        min_size=2,
        max_size=6,
    ),
    order=st.lists(st.sampled_from(["in", "on", "free", "move"]), min_size=1, max_size=5),
    moved=st.integers(0, 5),
)
def test_no_order_of_structuring_moves_anything(house: House, things: list, order: list, moved: int) -> None:
    with house.undone():
        house.put(
            room("study", area(0, 0, 6, 6), (0, 6)),
            *(
                thing(f"t{n}", box(x * 0.4, y * 0.4, h * 0.3), pose_from_yaw(px / 2, py / 2, pz * 0.3, turn))
                for n, (px, py, pz, turn, x, y, h) in enumerate(things)
            ),
        )
        world = house.world_poses()
        for step in order:
            if step == "move":
                name = f"t{moved % len(things)}"
                below = house.rows(
                    "select i.name from semap.instance r, lateral semap.frames_below(array[r.frame_id]) b (frame_id)"
                    " join semap.instance i on i.frame_id = b.frame_id where r.instance_id = :id",
                    id=house.ids[name],
                )
                move(house, name, world[name])
                after = house.world_poses()
                turn = after[name] @ np.linalg.inv(world[name])
                world = {each: turn @ pose if (each,) in below else pose for each, pose in world.items()}
            elif step == "free":
                house.rows(FREE, ids=list(house.ids.values()))
                assert set(carriers(house).values()) == {"map"}
            else:
                rows = house.rows((IN if step == "in" else ON).format("null"), map_id=house.map_id)
                assert len({target for target, *_ in rows}) == len(rows)
                names = carriers(house)
                for target, reference, outcome in rows:
                    if not outcome.startswith("kept"):
                        assert names[str(*house.named([target]))] == str(*house.named([reference]))
            assert close(house.world_poses(), world)
