"""A view for each query: the columns that it selects, of what holds by it now."""

from __future__ import annotations

import json

import pytest
import shapely
from made_relations import KINDS, Thing, at, hold, pair_query
from psycopg.rows import dict_row
from psycopg.sql import SQL as SQL_TEXT
from world import SECOND_US, World

from semap.errors import NotFound
from semap.store.database.connection import connect, one_transaction
from semap.store.relation.queries import (
    add_query,
    change_query,
    declaration_from_sql,
    delete_query,
    find_query,
    query_result,
)

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


def test_the_view_of_pairs_shows_either_kind_of_side(world: World) -> None:
    """Relations by hand, of a query that rests: the columns that it selects, of what is held."""
    rooms: list[Thing] = [
        ("instance", world.add_room(name, shapely.box(x, 0, x + 4, 4)), name)
        for name, x in (("kitchen", 0), ("hall", 5))
    ]
    tracks: list[Thing] = []
    for n, name in enumerate(("ann", "bob")):
        tracks.append(("track", world.add_track(name), name))
        world.add_states([(tracks[-1][1], SECOND_US, float(n), 1.0, None)])
    things = {"track": tracks, "instance": rooms}
    payload = {"who": "subject.name", "whom": "object.name", "x": "subject.x_m", "gone": "subject.never"}
    for subject, object_ in KINDS:
        plain = pair_query(world, f"{subject} {object_}", subject, object_)
        chosen = pair_query(
            world, f"{subject} {object_} by name", subject, object_, payload=json.dumps(payload)
        )
        for query_id in (plain, chosen):
            hold(world, query_id, things[subject][0], things[object_][1], 2)
            hold(world, query_id, things[subject][1], things[object_][0], 3)
            world.run("update semap.relation set confirmed = false, since = null where since = %s", at(3))
        names = ("track_id", "track", "instance_id", "instance")
        if (subject, object_) != ("track", "instance"):
            names = ("subject_id", "subject", "object_id", "object")
        first, second = things[subject][0], things[object_][1]
        assert shown(world, f"{subject} {object_}") == [
            dict(zip((*names, "since"), (*first[1:], *second[1:], at(2)), strict=True))
        ]
        expected = {"who": first[2], "whom": second[2], "since": at(2)}
        if subject == "track":
            expected["x"] = 0.0
        assert shown(world, f"{subject} {object_} by name") == [expected]
        with one_transaction(world.dsn) as connection:
            (row,) = query_result(connection, chosen)
        assert row.columns == {**expected, "since": "1970-01-01T00:00:02+00:00"}


def test_the_view_follows_a_change_of_sides(world: World) -> None:
    room: Thing = ("instance", world.add_room("room", shapely.box(0, 0, 4, 4)), "room")
    query_id = pair_query(world, "near", "track", "track")
    assert shown(world, "near") == []
    world.run("update semap.continuous_query set subject_kind = 'instance' where query_id = %s", query_id)
    track = ("track", world.add_track("t"), "t")
    world.add_states([(track[1], SECOND_US, 9.0, 9.0, None)])
    hold(world, query_id, room, track, 5)
    assert [(row["subject"], row["object"]) for row in shown(world, "near")] == [("room", "t")]


def test_a_result_is_read_in_pages(world: World) -> None:
    room: Thing = ("instance", world.add_room("room", shapely.box(0, 0, 4, 4)), "room")
    tracks = [world.add_track(f"t{n}") for n in range(7)]
    for track_id in tracks:
        world.add_states([(track_id, SECOND_US, 1.0, 1.0, None)])
    pairs = pair_query(world, "faced", "instance", "track")
    for n, track_id in enumerate(tracks):
        hold(world, pairs, room, ("track", track_id, f"t{n}"), n)
    for query_id, column in ((world.query_id, "track"), (pairs, "object")):
        found, after = [], None
        with one_transaction(world.dsn) as connection:
            while page := query_result(connection, query_id, after=after, limit=3):
                found += [row.columns[column] for row in page]
                after = page[-1].place
        assert sorted(found) == [f"t{n}" for n in range(7)]
    with one_transaction(world.dsn) as connection, pytest.raises(NotFound):
        query_result(connection, 10**6)


def shown(world: World, name: str) -> list[dict[str, object]]:
    with connect(world.dsn, "semap_read") as connection, connection.cursor(row_factory=dict_row) as cursor:
        return cursor.execute(
            SQL_TEXT('select * from semap_result."world/{}"').format(SQL_TEXT(name))
        ).fetchall()
