"""A view for each query: the columns that it selects, of what holds by it now."""

from __future__ import annotations

import shapely
from world import SECOND_US, World

from semap.store.database import one_transaction
from semap.store.queries import add_query, change_query, declaration_from_sql, delete_query, find_query

SQL = "select r.name, t.name, t.x_m as x from track t, room r where st_contains(r.footprint, t.position)"


def views(world: World) -> list[str]:
    return [name for (name,) in world.rows(
        "select relname::text from pg_class where relnamespace = 'semap_result'::regnamespace order by 1")]  # fmt: skip


def test_the_view_of_a_query_shows_what_the_query_itself_would(world: World) -> None:
    world.add_room("kitchen", shapely.box(0, 0, 4, 4))
    world.add_room("hall", shapely.box(4, 0, 9, 4))
    for second, (name, x) in enumerate({"ann": 1.0, "bob": 5.0, "eve": 20.0}.items(), 1):
        world.add_states([(world.add_track(name), second * SECOND_US, x, 1.0, None)])
    with one_transaction(world.dsn) as connection:
        add_query(connection, "world", declaration_from_sql(connection, "who", SQL), sql=SQL)
    assert views(world) == ["world/track_in_room", "world/who"]
    shown = world.rows('select room_name, track_name, x from semap_result."world/who" order by 1')
    assert shown == [("hall", "bob", 5.0), ("kitchen", "ann", 1.0)]
    world.run("set search_path = semap_query, public")
    assert sorted(world.rows(SQL)) == shown
    assert world.rows('select track, instance, extract(epoch from since)::int'
                      ' from semap_result."world/track_in_room" order by 1') == [
        ("ann", "kitchen", 1), ("bob", "hall", 2)
    ]  # fmt: skip
    other = SQL.replace("t.x_m as x", "r.alias")
    with one_transaction(world.dsn) as connection:
        asked = declaration_from_sql(connection, "what", other)
        change_query(connection, find_query(connection, "world", "who").query_id, asked, sql=other)
    assert views(world) == ["world/track_in_room", "world/what"]
    assert world.rows('select alias from semap_result."world/what"') == [(None,), (None,)]
    with one_transaction(world.dsn) as connection:
        delete_query(connection, find_query(connection, "world", "what").query_id)
    world.run("update semap.map set name = 'house'")
    assert views(world) == ["house/track_in_room"]
    world.run("delete from semap.map")
    assert views(world) == []
