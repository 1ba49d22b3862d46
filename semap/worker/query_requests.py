"""Continuous queries that were asked for in SQL are made, or refused with the place and the reason.

`semap.create_continuous_query` (sql/360) leaves a request; the rule worker's process reads it in a thread and
over connections of its own, since PostgreSQL's parser is here. A request is answered in the transaction that
makes the query, and by one worker, however many there are. Who answers holds advisory lock 7375 in share
mode, so that the database knows whether anybody does. A worker without the parser leaves requests to others.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from threading import Event as Signal

from semap.store.database.connection import listen, one_session, translated, wait_for_notice
from semap.store.relation.query_requests import answer_next
from semap.worker.beside import again_and_again, beside

log = logging.getLogger(__name__)

ROLE = "semap_api"
ANSWERING_LOCK = 7375
LOOK_S = 5.0
"""So often it is looked for what another worker has begun and not ended."""
WAKE_S = 0.5
RETRY_S = 2.0


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
