"""A place in the log with the database as it was there, so that no change falls between the two."""

from __future__ import annotations

from dataclasses import dataclass
from uuid import uuid4

from psycopg import pq
from psycopg.pq.abc import PGconn

from semap.errors import ServerUnavailable
from semap.replication.pgoutput import parse_lsn
from semap.replication.stream import connect_replication, losing_connection


@dataclass(frozen=True)
class Beginning:
    """A temporary slot, which keeps no log back once its connection is gone.

    connection  in replication mode; its next command ends the snapshot
    snapshot    for `set transaction snapshot` in another connection
    """

    connection: PGconn
    slot: str
    lsn: int
    snapshot: str


def begin_at_snapshot(dsn: str, purpose: str) -> Beginning:
    """Make a temporary slot.

    purpose  part of the slot's name
    raises   ServerUnavailable
    """
    connection = connect_replication(dsn)
    slot = f"semap_{purpose}_{uuid4().hex}"
    with losing_connection():
        result = connection.exec_(
            f"CREATE_REPLICATION_SLOT \"{slot}\" TEMPORARY LOGICAL pgoutput (SNAPSHOT 'export')".encode()
        )
    if result.status != pq.ExecStatus.TUPLES_OK:
        message = connection.get_error_message().strip()
        connection.finish()
        raise ServerUnavailable(
            message, f"See that max_replication_slots leaves room for one more ({purpose})."
        )
    lsn = (result.get_value(0, 1) or b"").decode()
    return Beginning(connection, slot, parse_lsn(lsn), (result.get_value(0, 2) or b"").decode())
