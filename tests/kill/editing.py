"""A map editor that is killed and started again: tables and what is near to them come, move and go. A process of its own.

Nothing that it does concerns rooms, so that what is told of them has to be what it is without it.
"""

from __future__ import annotations

import os
import random

import psycopg
import shapely
from patience import any_moment, moment

from semap.errors import SemapError
from semap.store.database.connection import connect

QUERY = "near a table"
ADD_QUERY = """
    insert into semap.continuous_query (map_id, name, object_concept_id, predicate, distance_m, enter_margin_m,
                                        leave_confirm, longest_gap, fastest_mps)
    select map_id, %s, concept_id, 'within_distance', %s, 0.2, '0.5 s', '3 s', 10
    from semap.map, semap.concept c where c.name = 'Table'
"""
ADD_TABLE = """
    with d as (insert into semap.description (map_id) select map_id from semap.map returning description_id, map_id),
         i as (insert into semap.instance (map_id, name, concept_id, frame_id, absolute_description_id)
               select d.map_id, %s, c.concept_id, (select min(frame_id) from semap.frame), d.description_id
               from d, semap.concept c where c.name = 'Table' returning absolute_description_id)
    insert into semap.abstraction (description_id, type, geometry)
    select absolute_description_id, 'Footprint', %s from i
"""
MOVE = """
    update semap.abstraction a set geometry = %s from semap.instance i
    where i.name = %s and a.description_id = i.absolute_description_id and a.type = 'Footprint'
"""


def edit(connection: psycopg.Connection, dice: random.Random) -> None:
    x, y = dice.uniform(0, 14), dice.uniform(0, 9)
    place, name = shapely.to_wkb(shapely.box(x, y, x + 1.5, y + 1), hex=True), f"table {dice.randrange(6)}"
    connection.execute("select semap.lock_regions_exclusive()")
    if dice.random() < 0.15:
        if not connection.execute("delete from semap.continuous_query where name = %s", [QUERY]).rowcount:
            connection.execute(ADD_QUERY, [QUERY, dice.choice([0.5, 1.0])])
    elif dice.random() < 0.2:
        connection.execute("delete from semap.instance where name = %s", [name])
    elif not connection.execute(MOVE, [place, name]).rowcount:
        connection.execute(ADD_TABLE, [name, place])


def main() -> None:
    dice = random.Random(os.getpid())
    while True:
        try:
            with connect(os.environ["SEMAP_DSN"], application="editor") as connection:
                while True:
                    with connection.transaction():
                        edit(connection, dice)
                    any_moment(dice, 0.02, 0.3)
        except (psycopg.Error, SemapError):
            moment()


if __name__ == "__main__":
    main()
