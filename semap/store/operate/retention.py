"""How long what is kept, and what has been dropped. Nothing is dropped unless somebody says so.

Age is by event time against the clock of the database, and what goes, goes by whole days (UTC).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Literal

import psycopg

from semap.errors import InvalidInput
from semap.store.database.connection import translated

Kind = Literal["states", "lines", "changes", "events"]
WORDS: Mapping[Kind, str] = {
    "states": "states of tracks",
    "lines": "lines",
    "changes": "changes of relations",
    "events": "events",
}
LONGEST = timedelta(days=36_525)

READ = "select kind, drop_after, gone_before from semap.retention"
LOCK = "select kind, drop_after, gone_before from semap.retention for update"
CHANGE = "update semap.retention set drop_after = %s where kind = %s"
GONE = "select gone_before from semap.retention where kind = %s and gone_before > %s"
GONE_STATES = """
    select r.gone_before from semap.retention r
    where r.kind = 'states' and r.gone_before > %s
      and exists (select from semap.track_now where map_id = %s and first_stamp < r.gone_before)
"""


@dataclass(frozen=True)
class Retention:
    """How long a kind is kept. None: for ever; what is before `gone_before` was dropped."""

    kind: Kind
    drop_after: timedelta | None = None
    gone_before: datetime | None = None


def read_retention(connection: psycopg.Connection) -> Mapping[Kind, Retention]:
    """All kinds, in the order of WORDS."""
    with translated():
        return _read(connection, READ)


def change_retention(
    connection: psycopg.Connection, ages: Mapping[Kind, timedelta | None]
) -> Mapping[Kind, Retention]:
    """Change these ages and leave all others; None is never.

    raises  InvalidInput for an age that is not above zero
    """
    with translated(), connection.transaction():
        _read(connection, LOCK)
        for kind, age in ages.items():
            if age is not None and not timedelta(0) < age <= LONGEST:
                raise InvalidInput(
                    f"to drop {WORDS[kind]} after {age}", "Give an age such as 7d, or never.", kind
                )
            connection.execute(CHANGE, [age, kind])
        return _read(connection, READ)


def require_kept(connection: psycopg.Connection, kind: Kind, since: datetime) -> None:
    """raises InvalidInput where some of a kind may have been dropped that was later than this"""
    with translated():
        found = connection.execute(GONE, [kind, since]).fetchone()
    if found is not None:
        raise _gone(kind, found[0])


def require_states(
    connection: psycopg.Connection, map_id: int, since: datetime, margin: timedelta = timedelta(0)
) -> None:
    """Like `require_kept`, for the states of a map, of which so much more is needed before."""
    with translated():
        found = connection.execute(GONE_STATES, [since - margin, map_id]).fetchone()
    if found is not None:
        raise _gone("states", found[0], margin)


def _gone(kind: Kind, before: datetime, margin: timedelta = timedelta(0)) -> InvalidInput:
    first = (before + margin).isoformat().replace("+00:00", "Z")
    return InvalidInput(
        f"the {WORDS[kind]} before {before:%Y-%m-%d} were dropped", f"Begin at {first} or later."
    )


def _read(connection: psycopg.Connection, statement: str) -> Mapping[Kind, Retention]:
    rows = {row[0]: Retention(*row) for row in connection.execute(statement)}
    return {kind: rows[kind] for kind in WORDS}
