"""Tokens: made, listed, revoked, and found by what a caller shows.

A token is `semap_` and 256 random bits. It is shown once, when it is made; the database keeps its SHA-256. A
hash that is slow on purpose protects what people think up, which can be guessed; of 2^256 tokens none can.
"""

from __future__ import annotations

import hashlib
import re
import secrets
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, func, insert, select, text, update
from sqlalchemy.dialects.postgresql import aggregate_order_by

from semap.errors import InvalidInput, NotFound
from semap.store.database.connection import translated
from semap.store.database.tables import place, token, token_map
from semap.store.map.places import place_of
from semap.store.operate.jobs import cancel_jobs_of

SCOPES = ("read", "write", "ingest", "admin")
PREFIX = "semap_"
SECRET_BYTES = 32
HINT_LENGTH = len(PREFIX) + 4
FORM = re.compile(r"semap_[A-Za-z0-9_-]{43}")
MOST_MAPS = 1000
LONGEST_NAME = 200

FIND = text("""
    with found as (
      select token_id, name, scopes, all_maps, last_used_at from semap.token
      where hash = :hash and revoked_at is null and (expires_at is null or expires_at > clock_timestamp())),
    used as (
      update semap.token t set last_used_at = clock_timestamp() from found f
      where t.token_id = f.token_id
        and (f.last_used_at is null or f.last_used_at < clock_timestamp() - interval '1 minute'))
    select f.token_id, f.name, f.scopes, f.all_maps,
           array(select m.map_id from semap.token_map tm join semap.place m using (map_id)
                 where tm.token_id = f.token_id order by m.map_id),
           array(select m.name from semap.token_map tm join semap.place m using (map_id)
                 where tm.token_id = f.token_id order by m.map_id)
    from found f
""")


@dataclass(frozen=True)
class Token:
    """A token as its keepers see it; it cannot be used by what is here.

    hint  how it begins
    maps  the names of the only maps that it is for; None: all
    """

    token_id: int
    name: str
    hint: str
    scopes: tuple[str, ...]
    maps: tuple[str, ...] | None
    created_at: datetime
    created_by: str
    expires_at: datetime | None
    last_used_at: datetime | None
    revoked_at: datetime | None


@dataclass(frozen=True)
class ValidToken:
    """What a token that was shown allows; map_ids and maps are None where it is for all maps."""

    token_id: int
    name: str
    scopes: frozenset[str]
    map_ids: frozenset[int] | None
    maps: frozenset[str] | None


def add_token(
    connection: Connection,
    name: str,
    scopes: Iterable[str],
    *,
    maps: Sequence[str] | None = None,
    expires_at: datetime | None = None,
    created_by: str,
) -> tuple[Token, str]:
    """Make a token; the text beside it is the token itself, which cannot be had again.

    raises  InvalidInput for an unknown scope, a time that has passed, or `admin` for some maps only; NotFound
            for an unknown map; Conflict where a token of this name is in use
    """
    wanted = _scopes(scopes)
    _check(name, wanted, maps, expires_at)
    secret = PREFIX + secrets.token_urlsafe(SECRET_BYTES)
    map_ids = None if maps is None else sorted({place_of(connection, each).map_id for each in maps})
    with translated():
        token_id = connection.scalar(
            insert(token)
            .values(
                name=name,
                hash=hash_of(secret),
                hint=secret[:HINT_LENGTH],
                scopes=list(wanted),
                all_maps=map_ids is None,
                created_by=created_by,
                expires_at=expires_at,
            )
            .returning(token.c.token_id)
        )
        if map_ids:
            rows = [{"token_id": token_id, "map_id": map_id} for map_id in map_ids]
            connection.execute(insert(token_map), rows)
    assert token_id is not None  # noqa: S101  (it was inserted)
    return get_token(connection, token_id), secret


def list_tokens(connection: Connection, *, after: int = 0, limit: int = 100) -> tuple[Token, ...]:
    """At most `limit` tokens in the order in which they were made, also those that are over."""
    with translated():
        rows = connection.execute(
            _TOKENS.where(token.c.token_id > after).order_by(token.c.token_id).limit(limit)
        )
        return tuple(_token(row) for row in rows)


def get_token(connection: Connection, token_id: int) -> Token:
    """raises NotFound"""
    with translated():
        row = connection.execute(_TOKENS.where(token.c.token_id == token_id)).one_or_none()
    if row is None:
        raise NotFound("token", token_id, "List the tokens to see their ids.")
    return _token(row)


def revoke_token(connection: Connection, token_id: int) -> Token:
    """Let a token be of no use from now on, and cancel its jobs; one that is revoked stays as it is.

    raises  NotFound
    """
    with translated():
        connection.execute(
            update(token)
            .where(token.c.token_id == token_id, token.c.revoked_at.is_(None))
            .values(revoked_at=func.clock_timestamp())
        )
    cancel_jobs_of(connection, token_id)
    return get_token(connection, token_id)


def token_id_of(connection: Connection, name: str) -> int:
    """The token of a name that is not revoked. raises NotFound"""
    with translated():
        found = connection.scalar(
            select(token.c.token_id).where(token.c.name == name, token.c.revoked_at.is_(None))
        )
    if found is None:
        raise NotFound("token", name, "List the tokens to see their names.")
    return int(found)


def has_tokens(connection: Connection) -> bool:
    """Whether anybody could show one: not revoked, not expired."""
    usable = select(token.c.token_id).where(
        token.c.revoked_at.is_(None),
        token.c.expires_at.is_(None) | (token.c.expires_at > func.clock_timestamp()),
    )
    with translated():
        return bool(connection.scalar(select(usable.exists())))


def hash_of(secret: str) -> bytes:
    return hashlib.sha256(secret.encode()).digest()


def find_token(connection: Connection, hash_: bytes) -> ValidToken | None:
    """The token of a hash if it may be used now; that it was used is noted once a minute."""
    with translated():
        row = connection.execute(FIND, {"hash": hash_}).one_or_none()
    if row is None:
        return None
    token_id, name, scopes, all_maps, map_ids, maps = row
    return ValidToken(
        token_id,
        name,
        frozenset(scopes),
        None if all_maps else frozenset(map_ids),
        None if all_maps else frozenset(maps),
    )


def _scopes(scopes: Iterable[str]) -> tuple[str, ...]:
    wanted = set(scopes)
    unknown = sorted(wanted - set(SCOPES))
    if unknown or not wanted:
        given = f"there is no scope {unknown[0]}" if unknown else "a token needs a scope"
        raise InvalidInput(given, f"Choose of {', '.join(SCOPES)}.", "scopes")
    return tuple(each for each in SCOPES if each in wanted)


def _check(
    name: str, scopes: tuple[str, ...], maps: Sequence[str] | None, expires_at: datetime | None
) -> None:
    if not 1 <= len(name) <= LONGEST_NAME or "\0" in name:
        raise InvalidInput("it is no name", f"Give 1 to {LONGEST_NAME} characters.", "name")
    if maps is not None and "admin" in scopes:
        raise InvalidInput(
            "admin is about the whole service", "Leave the maps out, or the scope admin.", "maps"
        )
    if maps is not None and not 1 <= len(maps) <= MOST_MAPS:
        raise InvalidInput(
            f"{len(maps)} maps", f"Name 1 to {MOST_MAPS} maps, or leave them out for all.", "maps"
        )
    if expires_at is not None:
        if expires_at.tzinfo is None:
            raise InvalidInput(
                "a time without a time zone", "Give it with its offset, such as Z.", "expires_at"
            )
        if expires_at <= datetime.now(tz=expires_at.tzinfo):
            raise InvalidInput("it has passed already", "Give a time to come.", "expires_at")


def _token(row: Sequence[Any]) -> Token:
    token_id, name, hint, scopes, all_maps, maps, *stamps = row
    return Token(token_id, name, hint, tuple(scopes), None if all_maps else tuple(maps or ()), *stamps)


_TOKENS = select(
    token.c.token_id,
    token.c.name,
    token.c.hint,
    token.c.scopes,
    token.c.all_maps,
    select(func.array_agg(aggregate_order_by(place.c.name, place.c.name)))
    .select_from(token_map.join(place, place.c.map_id == token_map.c.map_id))
    .where(token_map.c.token_id == token.c.token_id)
    .scalar_subquery(),
    token.c.created_at,
    token.c.created_by,
    token.c.expires_at,
    token.c.last_used_at,
    token.c.revoked_at,
)
