"""Several editors of one map at once: no deadlock, nothing lost, and what is derived is what it should be."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from random import Random

import shapely
from sqlalchemy import Connection

from semap.geometry.prism import extrude
from semap.model.pose import Pose
from semap.model.source_geometry import BODY, SourceGeometry
from semap.store.database.connection import connect, one_transaction
from semap.store.map import blueprints, frames
from semap.store.map.instance_edit import delete_instance
from semap.store.map.maps import create_map

EDITORS = 4
EDITS = 25
DIFFERENT = """
    with wanted as (
      select w.instance_id, w.type, st_asewkb(w.geometry), w.z_min_m, w.z_max_m
      from semap.abstractions_wanted(array(select instance_id from semap.instance)) w
    ), present as (
      select instance_id, type, st_asewkb(geometry), z_min_m, z_max_m from semap.abstraction where instance_id is not null
    )
    select count(*) from ((table wanted except table present) union all (table present except table wanted)) d
"""


def body(width_m: float) -> SourceGeometry:
    return SourceGeometry(BODY, "TRIANGLEMESH3D", extrude(shapely.box(0, 0, width_m, 1), 0, 1))


def edit(connection: Connection, dice: Random, editor: int, number: int, blueprint: int) -> None:
    names = connection.exec_driver_sql(
        "select f.name, f.frame_id, i.instance_id from semap.frame f left join semap.instance i using (frame_id)"
        " where f.parent_id is not null order by 2"
    ).all()
    kind = dice.choice(["make", "make", "move", "hang", "reshape", "delete"]) if names else "make"
    chosen = dice.choice(names) if names else None
    if kind == "make":
        above = "map" if chosen is None else chosen.name
        made = frames.create_frame(connection, "office", f"{editor} {number}", above, Pose(x_m=dice.random()))
        connection.exec_driver_sql(
            "insert into semap.instance (map_id, name, concept_id, frame_id, relative_description_id)"
            " select m.map_id, %s, c.concept_id, %s, %s from semap.map m, semap.concept c where c.name = 'Room'",
            (made.name, made.frame_id, blueprint),
        )
    elif kind == "move":
        frames.set_pose(connection, chosen.frame_id, Pose(x_m=dice.random(), z_m=1))
    elif kind == "hang":
        frames.change_frame(connection, chosen.frame_id, "map")
    elif kind == "reshape":
        blueprints.put_geometry(connection, blueprint, body(1 + dice.random()))
    elif chosen.instance_id is not None:
        delete_instance(connection, chosen.instance_id, "keep")


def test_editors_wait_for_each_other(database: str) -> None:
    with one_transaction(database) as connection:
        create_map(connection, "office")
        blueprint = blueprints.create_blueprint(connection, "office", "box", [body(1)]).description_id

    def editor(number: int) -> None:
        dice = Random(number)
        for count in range(EDITS):
            with one_transaction(database, "semap_api") as connection:
                connection.exec_driver_sql("select semap.lock_regions_exclusive()")
                edit(connection, dice, number, count, blueprint)

    with ThreadPoolExecutor(EDITORS) as pool:
        list(pool.map(editor, range(EDITORS)))
    with connect(database) as plain:
        assert plain.execute(DIFFERENT).fetchone() == (0,)
        sets = plain.execute("select count(*) from semap.change_set where message is null").fetchone()
        made = plain.execute(
            "select count(distinct row_key) from semap.row_version where table_name = 'instance'"
        ).fetchone()
        stamps = plain.execute("select made_at from semap.change_set order by change_set_id").fetchall()
    assert made is not None
    assert made[0] > EDITORS
    assert sets is not None
    assert EDITORS * EDITS // 2 < sets[0] <= EDITORS * EDITS + 1
    assert stamps == sorted(stamps)


def test_a_crash_between_two_statements_leaves_nothing_behind(database: str) -> None:
    """A frame is moved and the server's session dies before the commit: nothing moved, no change set."""
    with one_transaction(database) as connection:
        create_map(connection, "office")
        blueprint = blueprints.create_blueprint(connection, "office", "box", [body(1)]).description_id
        edit(connection, Random(1), 0, 0, blueprint)
    before = "select count(*), max(change_set_id) from semap.row_version"
    dying = connect(database, autocommit=False)
    with closing(dying), connect(database) as plain:
        shown = plain.execute(before).fetchone()
        dying.execute("update semap.frame_pose set x_m = 7")
        moved = dying.execute(
            "select min(st_xmin(geometry)) from semap.abstraction where instance_id is not null"
        )
        assert moved.fetchone() >= (7,)
        plain.execute("select pg_terminate_backend(%s)", [dying.info.backend_pid])
        assert plain.execute(before).fetchone() == shown
        assert plain.execute(DIFFERENT).fetchone() == (0,)
