"""What came late corrects what is known of the past (sql/148), as soon as it is there.

It is done in a thread of the rule worker's process and over a connection of its own, so many states in a
transaction, so that writers go on meanwhile.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from threading import Event as Signal

from semap.store.database.connection import listen, wait_for_notice
from semap.store.motion.correction import correct_some
from semap.worker.beside import again_and_again, beside

log = logging.getLogger(__name__)

ROLE = "semap_worker"
CHANNEL = "semap_late"
EACH_S = 1.0
RETRY_S = 1.0


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
    with listen(dsn, CHANNEL, ROLE, application="semap work: correcting") as connection:
        while not stop.is_set():
            if not correct_some(connection):
                wait_for_notice(connection, EACH_S)
