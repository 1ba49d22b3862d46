"""How long what is kept, and what has been dropped. Nothing is dropped unless somebody says so.

Age is by event time against the clock of the database, and what goes, goes by whole days (UTC).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, Literal

from sqlalchemy import Connection, Select, select, update

from semap.errors import InvalidInput
from semap.store.database.connection import translated
from semap.store.database.tables import retention

Kind = Literal["states", "lines", "changes", "events"]
WORDS: Mapping[Kind, str] = {
    "states": "states of tracks",
    "lines": "lines",
    "changes": "changes of relations",
    "events": "events",
}
LONGEST = timedelta(days=36_525)

_READ = select(retention.c.kind, retention.c.drop_after, retention.c.gone_before)


@dataclass(frozen=True)
class Retention:
    """How long a kind is kept. None: for ever; what is before `gone_before` was dropped."""

    kind: Kind
    drop_after: timedelta | None = None
    gone_before: datetime | None = None


def read_retention(connection: Connection) -> Mapping[Kind, Retention]:
    """All kinds, in the order of WORDS."""
    with translated():
        return _read(connection, _READ)


def change_retention(
    connection: Connection, ages: Mapping[Kind, timedelta | None]
) -> Mapping[Kind, Retention]:
    """Change these ages and leave all others, in the caller's transaction; None is never.

    raises  InvalidInput for an age that is not above zero
    """
    with translated():
        _read(connection, _READ.with_for_update())
        for kind, age in ages.items():
            if age is not None and not timedelta(0) < age <= LONGEST:
                raise InvalidInput(
                    f"to drop {WORDS[kind]} after {age}", "Give an age such as 7d, or never.", kind
                )
            connection.execute(update(retention).where(retention.c.kind == kind).values(drop_after=age))
        return _read(connection, _READ)


def gone(kind: Kind, before: datetime, margin: timedelta = timedelta(0)) -> InvalidInput:
    """The error of whoever needs what was dropped.

    margin  so much more is needed before what is asked for
    """
    first = (before + margin).isoformat().replace("+00:00", "Z")
    return InvalidInput(
        f"the {WORDS[kind]} before {before:%Y-%m-%d} were dropped", f"Begin at {first} or later."
    )


def _read(connection: Connection, statement: Select[Any]) -> Mapping[Kind, Retention]:
    rows = {row[0]: Retention(*row) for row in connection.execute(statement)}
    return {kind: rows[kind] for kind in WORDS}
