"""Requests for continuous queries that were left in SQL (sql/360)."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping

from sqlalchemy import Connection, Engine, func, select, update

from semap.errors import CallerError, InvalidInput, ServerUnavailable
from semap.store.database.connection import translated
from semap.store.database.tables import map_, query_request
from semap.store.map.history import lock_edits
from semap.store.relation.queries import add_query, declaration_from_sql

log = logging.getLogger(__name__)

FAULT = "semap failed on this text"


def answer_next(engine: Engine) -> bool:
    """Answer the oldest request that waits and that nobody else is at; False where there is none."""
    with translated(), engine.begin() as connection:
        if connection.execute(_WAITS).first() is None:
            return False
        # as all who edit do, before any row is locked
        lock_edits(connection)
        row = connection.execute(_NEXT).one_or_none()
        if row is None:
            return False
        connection.execute(
            update(query_request)
            .where(query_request.c.request_id == row.request_id)
            .values(answered_at=func.clock_timestamp(), **_answer(connection, row.map, row.name, row.sql))
        )
        connection.execute(select(func.pg_notify("semap_query_answer", str(row.request_id))))
    return True


def _answer(connection: Connection, map_name: str, name: str, sql: str) -> Mapping[str, object]:
    """The query that was made, or the refusal.

    raises  ServerUnavailable where it has to be tried again
    """
    try:
        with connection.begin_nested():
            made = add_query(connection, map_name, declaration_from_sql(connection, name, sql), sql=sql)
            return {"query_id": made.query_id}
    except CallerError as error:
        return {"refusal": _refusal(error)}
    except ServerUnavailable:
        raise
    except Exception as error:
        # the others are not to wait for one that cannot be read
        log.exception("The continuous query %s could not be made.", name)
        return {"refusal": {"reason": f"{FAULT}: {error}", "remedy": "Please report it."}}


def _refusal(error: CallerError) -> Mapping[str, object]:
    place = error.where if isinstance(error, InvalidInput) else ""
    found = re.fullmatch(r"line (\d+), column (\d+)", place)
    reason = str(error) if found is None else str(error).removeprefix(f"{place}: ")
    at = {} if found is None else {"line": int(found[1]), "column": int(found[2])}
    return {**at, "reason": reason, "remedy": error.remedy or "See semap.query_requests."}


_WAITS = select(query_request.c.request_id).where(query_request.c.answered_at.is_(None)).limit(1)
_NEXT = (
    select(query_request, map_.c.name.label("map"))
    .join(map_, map_.c.map_id == query_request.c.map_id)
    .where(query_request.c.answered_at.is_(None))
    .order_by(query_request.c.request_id)
    .limit(1)
    .with_for_update(of=query_request, skip_locked=True)
)
