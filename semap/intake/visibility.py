"""Waits out the instant between the log showing transactions and other sessions seeing what they wrote.

The order in which transactions come to be seen is not that of the log, so that all are to be asked for.
"""

from __future__ import annotations

import time
from collections.abc import Collection

import psycopg

from semap.errors import ServerUnavailable
from semap.store.database.connection import translated

FIRST_PAUSE_S = 0.0002
PATIENCE_S = 30.0
UNSEEN = "select array_agg(x) from unnest(%s::bigint[]) x where not semap.is_visible(x)"


def await_visible(connection: psycopg.Connection, xids: Collection[int]) -> None:
    """Return once statements of this connection see what these transactions of the log have written.

    xids    their numbers, the lower 32 bits of each
    raises  ServerUnavailable where one is not seen for PATIENCE_S
    """
    pause_s = FIRST_PAUSE_S
    deadline_s = time.monotonic() + PATIENCE_S
    unseen = list(xids)
    with translated():
        while unseen:
            (found,) = connection.execute(UNSEEN, [unseen]).fetchone() or (None,)
            if not found:
                return
            unseen = found
            if time.monotonic() > deadline_s:
                raise ServerUnavailable(
                    f"Transactions {unseen} are in the log and cannot be seen.",
                    "See what holds the server up.",
                )
            time.sleep(pause_s)
            pause_s = min(pause_s * 2, 0.05)
