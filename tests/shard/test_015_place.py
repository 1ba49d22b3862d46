"""A directory and its shards: ids that never meet, and names that are one map's alone."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import psycopg
import pytest
from server import fresh_database
from world import World

from semap.cluster import Cluster
from semap.errors import Conflict, InvalidInput, NotFound
from semap.store.database.connection import connect, one_transaction
from semap.store.map.maps import create_map, delete_map
from semap.store.map.places import find_place, list_shards
from semap.store.operate import shards
from semap.store.operate.shards import add_shard, drain_shard, forget_map, place_map, place_new_map
from semap.store.operate.tokens import add_token, find_token, hash_of

ADMIN = "semap_admin"


def made(dsn: str, name: str) -> int:
    with one_transaction(dsn, "semap_api") as connection:
        return create_map(connection, name).map_id


def place(dsn: str, name: str) -> tuple[int, int] | None:
    with one_transaction(dsn, ADMIN) as connection:
        found = find_place(connection, name)
    return None if found is None else (found.map_id, found.shard_id)


def test_a_database_without_shards_places_its_own_maps(database: str) -> None:
    world = World(database)
    assert place(database, "world") == (world.map_id, 0)
    world.run("update semap.map set name = 'house'")
    assert (place(database, "world"), place(database, "house")) == (None, (world.map_id, 0))
    world.run("delete from semap.map")
    assert place(database, "house") is None
    world.close()


def test_a_map_is_made_where_it_is_placed_with_the_id_of_the_directory(database: str, north: str) -> None:
    local = made(database, "local")
    claimed = place_map(database, "remote", "north")
    assert place_map(database, "remote", "north") == claimed
    assert made(north, "remote") == claimed.map_id != local
    assert place(database, "remote") == place(north, "remote") == (claimed.map_id, 1)
    with one_transaction(database, ADMIN) as connection:
        assert [(each.name, each.maps) for each in list_shards(connection)] == [("main", 1), ("north", 1)]


def test_one_name_is_one_map_on_all_shards(database: str, north: str) -> None:
    place_map(database, "remote", "north")
    made(north, "remote")
    with pytest.raises(Conflict, match="remote is on another shard"):
        made(database, "remote")
    with pytest.raises(InvalidInput, match="the shard north, whose maps the directory places"):
        made(north, "unplaced")
    made(database, "local")
    with pytest.raises(Conflict, match="local has been made on the shard main"):
        place_map(database, "local", "north")
    with pytest.raises(Conflict, match="remote has been made on the shard north"):
        place_map(database, "remote", "main")
    with connect(database) as owner, pytest.raises(psycopg.errors.UniqueViolation):
        owner.execute("insert into semap.place (map_id, name, shard_id) values (99, 'remote', 0)")


def test_of_two_who_want_a_name_at_once_one_gets_it(database: str, north: str) -> None:
    ready = threading.Barrier(2)

    def want(number: int, shard: str) -> str:
        ready.wait()
        try:
            place_map(database, f"map {number}", shard)
            made(database if shard == "main" else north, f"map {number}")
        except (Conflict, InvalidInput):  # the other has taken the place, or it was moved away meanwhile
            return ""
        return shard

    with ThreadPoolExecutor(2) as threads:
        for number in range(5):
            wanted = [threads.submit(want, number, shard) for shard in ("main", "north")]
            won = [each.result() for each in wanted if each.result()]
            holding = []
            for name, dsn in (("main", database), ("north", north)):
                with connect(dsn) as owner:
                    holding += [name] * owner.execute(
                        "select from semap.map where name = %s", [f"map {number}"]
                    ).rowcount
            assert won == holding
            assert len(won) == 1


def test_a_place_moves_until_its_map_is_made(database: str, north: str) -> None:
    first = place_map(database, "wing", "north")
    place_map(database, "wing", "main")
    assert (place(database, "wing"), place(north, "wing")) == ((first.map_id, 0), None)
    assert made(database, "wing") == first.map_id


def test_ids_of_two_shards_never_meet(database: str, north: str) -> None:
    place_map(database, "there", "north")
    worlds = [World(database, "here"), World(north, "there")]
    for world in worlds:
        world.add_track("ann")
    for table, column, width in (("track", "track_id", 2**47), ("rule", "rule_id", 2**25)):
        here, there = (world.one(f"select {column} from semap.{table}") for world in worlds)
        assert (here // width, there // width) == (0, 1), table
    assert (
        worlds[1].one("select last_value from pg_sequences where sequencename = 'concept_concept_id_seq'")
        is None
    )
    for world in worlds:
        world.close()


def test_only_an_empty_database_becomes_a_shard(
    cluster: Cluster, template: str, database: str, north: str
) -> None:
    with fresh_database(cluster, template) as full:
        made(full, "full")
        with pytest.raises(Conflict, match="has maps"):
            add_shard(database, "south", full)
    with pytest.raises(Conflict, match="shard or a directory already"):
        add_shard(database, "south", north)
    with pytest.raises(Conflict, match="directory's own database"):
        add_shard(database, "south", database)
    with pytest.raises(Conflict, match="is the shard north"):
        add_shard(north, "south", database)
    with pytest.raises(InvalidInput):
        add_shard(database, "Up North", north)
    with fresh_database(cluster, template) as other, pytest.raises(Conflict, match="this database is not it"):
        add_shard(database, "north", other)
    assert add_shard(database, "north", north).shard_id == 1  # again: its DSN is renewed


def test_a_drained_shard_takes_no_new_map(database: str, north: str) -> None:
    place_map(database, "before", "north")
    with one_transaction(database, ADMIN) as connection:
        drain_shard(connection, "north")
        drain_shard(connection, "main")
    with pytest.raises(Conflict, match="being drained"):
        place_map(database, "after", "north")
    with pytest.raises(Conflict, match="Every shard"):
        place_new_map(database, "after")
    with one_transaction(database, ADMIN) as connection:
        drain_shard(connection, "north", draining=False)
        with pytest.raises(NotFound):
            drain_shard(connection, "south")
    for name in ("after", "before"):
        found = place_new_map(database, name)
        assert found is not None
        assert found.name == "north"
    assert place(north, "after") == place(database, "after")


def test_a_map_that_was_deleted_leaves_its_tokens_and_its_name(database: str, north: str) -> None:
    first = place_map(database, "wing", "north")
    made(north, "wing")
    with one_transaction(database, ADMIN) as connection:
        _, secret = add_token(connection, "guest", ["read"], maps=["wing"], created_by="test")
    assert not forget_map(database, "wing")  # it is there
    with one_transaction(north, "semap_api") as connection:
        delete_map(connection, "wing")
    second = place_map(database, "wing", "main")
    assert made(database, "wing") == second.map_id != first.map_id
    with one_transaction(database, ADMIN) as connection:
        found = find_token(connection, hash_of(secret))
    assert found is not None
    assert (found.map_ids, found.maps) == (frozenset(), frozenset())


@pytest.mark.parametrize("killed_at", ["_take", "NEW_PLACE"])
def test_whoever_is_killed_while_placing_leaves_nothing_in_the_way(
    database: str, north: str, monkeypatch: pytest.MonkeyPatch, killed_at: str
) -> None:
    with monkeypatch.context() as patch, pytest.raises(Exception, match=r"."):  # noqa: PT012
        patch.setattr(shards, killed_at, None)
        place_map(database, "wing", "north")
    assert place(north, "wing") is None
    place_map(database, "wing", "main")
    made(database, "wing")
    assert (place(north, "wing"), place(database, "wing")[1]) == (None, 0)


def test_the_way_into_a_shard_is_seen_by_administrators_alone(database: str, north: str) -> None:
    for role in (
        "semap_read",
        "semap_ingest",
        "semap_worker",
        "semap_api",
        "semap_read_map",
        "semap_api_map",
    ):
        with connect(database, role) as connection, pytest.raises(psycopg.errors.InsufficientPrivilege):
            connection.execute("select dsn from semap.shard")
    with connect(database, "semap_read") as connection:
        assert connection.execute("select name from semap.shard order by shard_id").fetchall() == [
            ("main",),
            ("north",),
        ]
    with one_transaction(database, ADMIN) as connection:
        assert north not in repr(list_shards(connection))
