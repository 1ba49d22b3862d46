"""Shards made and drained, and maps placed on them: what concerns two databases.

Whoever changes where a map is holds the lock of its name in the directory meanwhile. So a place of which its
shard does not know, seen under that lock, is of a deleted map, or of somebody who was killed: it goes.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager

from sqlalchemy import Connection, text

from semap.errors import Conflict, InvalidInput
from semap.store.database.connection import one_transaction, own_session, translated
from semap.store.database.name import require_name
from semap.store.map.places import MAIN, Place, Shard, find_place, get_shard, is_made_here, list_shards
from semap.store.operate.schema import migrate

ROLE = "semap_admin"
DIRECTORY_LOCK = 7377

HOLD_NAME = text("select pg_advisory_lock(:key, hashtext(:name))")
HOLD_DIRECTORY = text("select pg_try_advisory_xact_lock(:key, 0)")
OWN = text("select shard_id, name from semap.shard where dsn is null")
ADD = text("""
    insert into semap.shard (shard_id, name, dsn)
    select min(n), :name, :dsn from generate_series(1, 63) n
    where n not in (select shard_id from semap.shard)
    returning shard_id
""")
RENEW = text("update semap.shard set dsn = :dsn where name = :name and dsn is not null returning shard_id")
BECOME = text("select semap.become_shard(:shard_id, :name)")
DRAIN = text("update semap.shard set draining = :draining where name = :name")
NEW_PLACE = text("""
    insert into semap.place (map_id, name, shard_id)
    values (nextval(pg_get_serial_sequence('semap.map', 'map_id')), :name, :shard_id)
    returning map_id, name, shard_id
""")
TAKE = text("""
    insert into semap.place (map_id, name, shard_id) values (:map_id, :name, :shard_id) on conflict do nothing
""")
KNOWS = text("select exists (select from semap.place where map_id = :map_id)")
LEAVE = text("select semap.leave_place(:map_id, :to)")
FORGET = text("select semap.forget_place(:map_id)")


def add_shard(dsn: str, name: str, shard_dsn: str) -> Shard:
    """Let a database without maps be a shard; its schema is made. One of that name gets the new DSN.

    raises  Conflict where the database is a shard or a directory already, or has maps; ServerUnavailable
    """
    migrate(shard_dsn)
    with one_transaction(dsn) as directory, one_transaction(shard_dsn) as there:
        require_directory(directory)
        keys = {"key": DIRECTORY_LOCK}
        with translated():
            directory.execute(HOLD_DIRECTORY, keys)
            if not there.execute(HOLD_DIRECTORY, keys).scalar_one():
                raise Conflict("This is the directory's own database.", "Give another one.")
            said = {"name": name, "dsn": shard_dsn}
            shard_id = directory.scalar(RENEW, said)
            if shard_id is None:
                shard_id = directory.scalar(ADD, said)
            elif there.execute(OWN).one() != (shard_id, name):
                raise Conflict(f"There is a shard {name}, and this database is not it.", "Choose a name.")
            there.execute(BECOME, {"shard_id": shard_id, "name": name})
            there.commit()
        return get_shard(directory, name)


def require_directory(connection: Connection) -> None:
    """raises Conflict where a database is a shard of another"""
    with translated():
        shard_id, name = connection.execute(OWN).one()
    if shard_id != MAIN:
        raise Conflict(f"This database is the shard {name}.", "Give the DSN of the directory.")


def drain_shard(connection: Connection, name: str, *, draining: bool = True) -> Shard:
    """Place no new map on a shard, or again; those that it has stay until they are placed elsewhere.

    raises  NotFound
    """
    get_shard(connection, name)
    with translated():
        connection.execute(DRAIN, {"name": name, "draining": draining})
    return get_shard(connection, name)


def place_map(dsn: str, map_name: str, shard_name: str) -> Place:
    """Say on which shard a map is to be made.

    raises  NotFound for an unknown shard; Conflict where it is drained, or the map was made elsewhere
    """
    require_name(map_name)
    with _holding(dsn, map_name) as directory:
        wanted = get_shard(directory, shard_name)
        found = _standing(directory, map_name)
        if found is not None and found.shard_id == wanted.shard_id:
            return found
        if wanted.draining:
            raise Conflict(f"The shard {shard_name} is being drained.", "Choose another one.")
        with translated():
            if found is None:
                said = {"name": map_name, "shard_id": wanted.shard_id}
                found = Place(*directory.execute(NEW_PLACE, said).one())
            else:
                _leave(directory, found, wanted)
                found = Place(found.map_id, found.name, wanted.shard_id)
        _take(wanted, found)
        return found


def place_new_map(dsn: str, map_name: str) -> Shard | None:
    """Where a map is, or a new one of that name is to be made: on the directory, unless it is drained.

    returns  None: here
    raises   Conflict where every shard is drained
    """
    with one_transaction(dsn, "semap_read") as directory:
        if is_made_here(directory, map_name):
            return None
    with one_transaction(dsn, ROLE) as directory:
        shards = list_shards(directory)
        found = find_place(directory, map_name)
    own = next(each for each in shards if each.dsn is None)
    if found is None and own.draining:
        free = [each for each in shards if not each.draining]
        if not free:
            raise Conflict("Every shard is being drained.", "Add one: semap shard add NAME --dsn DSN")
        found = place_map(dsn, map_name, min(free, key=lambda each: each.maps).name)
    return own if found is None else next(each for each in shards if each.shard_id == found.shard_id)


def forget_map(dsn: str, map_name: str) -> bool:
    """Forget the place of a map that was deleted on its shard, with the events that were gathered of it.

    returns  whether it is gone
    """
    with _holding(dsn, map_name) as directory:
        return _standing(directory, map_name) is None


@contextmanager
def _holding(dsn: str, map_name: str) -> Iterator[Connection]:
    """The directory, while nobody else changes where a map of this name is; each statement commits."""
    with closing(own_session(dsn, ROLE, application="semap shard")) as directory:
        require_directory(directory)
        with translated():
            directory.execute(HOLD_NAME, {"key": DIRECTORY_LOCK, "name": map_name})
        yield directory


def _standing(directory: Connection, map_name: str) -> Place | None:
    """The place of a map, if its shard knows of it; else it is forgotten here."""
    found = find_place(directory, map_name)
    if found is None or found.shard_id == MAIN or _knows(_shard(directory, found), found):
        return found
    with translated():
        directory.execute(FORGET, {"map_id": found.map_id})
    return None


def _shard(directory: Connection, place: Place) -> Shard:
    return next(each for each in list_shards(directory) if each.shard_id == place.shard_id)


def _knows(shard: Shard, place: Place) -> bool:
    with one_transaction(_dsn(shard), ROLE) as there, translated():
        return bool(there.scalar(KNOWS, {"map_id": place.map_id}))


def _leave(directory: Connection, place: Place, to: Shard) -> None:
    """Take the place of a map that was not made yet from its shard; raises Conflict where it was made."""
    said = {"map_id": place.map_id, "to": to.shard_id}
    if place.shard_id != MAIN:
        with one_transaction(_dsn(_shard(directory, place)), ROLE) as there, translated():
            there.execute(LEAVE, said)
    directory.execute(LEAVE, said)


def _take(shard: Shard, place: Place) -> None:
    if shard.dsn is not None:
        with one_transaction(shard.dsn, ROLE) as there, translated():
            there.execute(TAKE, vars(place))


def _dsn(shard: Shard) -> str:
    if shard.dsn is None:
        raise InvalidInput(f"the shard {shard.name} is here", "Give another one.")
    return shard.dsn
