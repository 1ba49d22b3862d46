"""Continuous queries that were asked for in SQL are made, or refused with the place and the reason.

`semap.create_continuous_query` (sql/360) leaves a request; the rule worker's process reads it in a thread and
over connections of its own, since PostgreSQL's parser is here. A request is answered in the transaction that
makes the query, and by one worker, however many there are. Who answers holds advisory lock 7375 in share
mode, so that the database knows whether anybody does. A worker without the parser leaves requests to others.
"""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from threading import Event as Signal

from sqlalchemy import Connection, Engine, func, select, update

from semap.errors import CallerError, InvalidInput, ServerUnavailable
from semap.store.database.connection import listen, one_session, translated, wait_for_notice
from semap.store.database.tables import map_, query_request
from semap.store.relation.queries import add_query, declaration_from_sql
from semap.worker.beside import again_and_again, beside

log = logging.getLogger(__name__)

ROLE = "semap_api"
ANSWERING_LOCK = 7375
LOOK_S = 5.0
"""So often it is looked for what another worker has begun and not ended."""
WAKE_S = 0.5
RETRY_S = 2.0
FAULT = "semap failed on this text"


@contextmanager
def answering(dsn: str) -> Iterator[None]:
    """Requests are answered as long as this lasts."""
    with beside("query requests", partial(_keep, dsn)):
        yield


def _keep(dsn: str, stop: Signal) -> None:
    if find_spec("pglast") is None:
        log.info("Requests for queries in SQL are not answered. To do so: pip install 'semap[sql]'")
        return
    waits = "Requests for queries in SQL wait"
    again_and_again(partial(_follow, dsn), stop, log, waits, RETRY_S)


def _follow(dsn: str, stop: Signal) -> None:
    application = "semap work: requests"
    with (
        one_session(dsn, ROLE, application=application) as engine,
        listen(dsn, "semap_query_request", ROLE, application=application) as listening,
        translated(),
    ):
        listening.execute("select pg_advisory_lock_shared(%s, 0)", [ANSWERING_LOCK])
        look_s = 0.0
        while not stop.is_set():
            if time.monotonic() >= look_s:
                while not stop.is_set() and answer_next(engine):
                    pass
                look_s = time.monotonic() + LOOK_S
            if wait_for_notice(listening, WAKE_S):
                look_s = 0.0


def answer_next(engine: Engine) -> bool:
    """Answer the oldest request that waits and that nobody else is at; False where there is none."""
    with translated(), engine.begin() as connection:
        if connection.execute(_WAITS).first() is None:
            return False
        # as all who edit do, before any row is locked
        connection.execute(select(func.semap.lock_regions_exclusive()))
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
