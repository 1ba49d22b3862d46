"""Whether what is read of the past is still kept."""

from __future__ import annotations

from datetime import datetime, timedelta

import psycopg

from semap.store.database.connection import translated
from semap.store.operate.retention import Kind, gone

GONE = "select gone_before from semap.retention where kind = %s and gone_before > %s"
GONE_STATES = """
    select r.gone_before from semap.retention r
    where r.kind = 'states' and r.gone_before > %s
      and exists (select from semap.track_now where map_id = %s and first_stamp < r.gone_before)
"""


def require_kept(connection: psycopg.Connection, kind: Kind, since: datetime) -> None:
    """raises InvalidInput where some of a kind may have been dropped that was later than this"""
    with translated():
        found = connection.execute(GONE, [kind, since]).fetchone()
    if found is not None:
        raise gone(kind, found[0])


def require_states(
    connection: psycopg.Connection, map_id: int, since: datetime, margin: timedelta = timedelta(0)
) -> None:
    """Like `require_kept`, for the states of a map, of which so much more is needed before."""
    with translated():
        found = connection.execute(GONE_STATES, [since - margin, map_id]).fetchone()
    if found is not None:
        raise gone("states", found[0], margin)
