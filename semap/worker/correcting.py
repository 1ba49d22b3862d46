"""What came late corrects what is known of the past (sql/148), as soon as it is there.

It is done in a thread of the rule worker's process and over a connection of its own, so many states in a
transaction, so that writers go on meanwhile. Maps take turns; one that cannot be corrected does not stop the
others.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from threading import Event as Signal

from semap.store.database.connection import listen, own_session, translated, wait_for_notice
from semap.store.motion.correction import correct_some
from semap.worker.beside import OneByOne, again_and_again, beside

log = logging.getLogger(__name__)

ROLE = "semap_worker"
CHANNEL = "semap_late"
EACH_S = 1.0
RETRY_S = 1.0
WAITING = """
    select distinct s.map_id from semap.source s
    where exists (select from semap.late_state l where l.source_id = s.source_id)
       or exists (select from semap.reading_due d where d.source_id = s.source_id)
"""


@contextmanager
def correcting(dsn: str) -> Iterator[None]:
    """The past is corrected as long as this lasts."""
    work = partial(
        again_and_again,
        partial(_follow, dsn),
        log=log,
        waits="What came late is corrected later",
        retry_s=RETRY_S,
    )
    with beside("correcting", work):
        yield


def _follow(dsn: str, stop: Signal) -> None:
    maps = OneByOne(log, "The past of the map %d is not corrected: %s")
    application = "semap work: correcting"
    with (
        listen(dsn, CHANNEL, ROLE, application=application) as listening,
        own_session(dsn, ROLE, application=application) as connection,
    ):
        while not stop.is_set():
            with translated():
                waiting = listening.execute(WAITING).fetchall()
            if not maps.each((map_id for (map_id,) in waiting), partial(correct_some, connection)):
                wait_for_notice(listening, EACH_S)
