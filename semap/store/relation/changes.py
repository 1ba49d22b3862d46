"""Changes of relations in one order, each told only when nothing before it can yet appear.

Numbers are given before a transaction is committed, so that a lower one may become visible after a higher.
What is up to the highest number that was visible is settled when all transactions have ended that ran then.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from uuid import UUID

from sqlalchemy import Connection, text

from semap.store.database.connection import translated

NEWEST = text("select coalesce(max(change_id), 0) from semap.relation_change")
OWN_NUMBER = text("select pg_current_xact_id()::text::bigint")
OLDEST_RUNNING = text("select pg_snapshot_xmin(pg_current_snapshot())::text::bigint")
"""Of transactions that write; numbers are given when they write first."""
READ = text("""
    select c.change_id, c.uid, m.name, c.query_name, c.kind::text, c.cause::text, c.stamp, c.transition_at,
           c.since, c.track_id, coalesce(c.track_name, c.subject_instance_name), c.subject_instance_id,
           c.instance_id, coalesce(c.instance_name, c.object_track_name), c.object_track_id, c.x_m, c.y_m,
           c.direction, c.door_id, c.door_name, c.amendment, c.retracts, c.received_at
    from semap.relation_change c join semap.map m using (map_id)
    where c.change_id > :after and c.change_id <= :through and m.name = :map
    order by c.change_id limit :limit
""")


@dataclass(frozen=True)
class StoredChange:
    """A relation began, ended or was crossed, as a continuous query sees it.

    seq        its number, which rises, with gaps
    track_id, subject_instance_id  one of them: what the subject is
    instance_id, object_track_id   one of them: what the object is
    stamp      of the state that told; transition_at: when it happened
    amendment  added or retracted in hindsight; retracts: the change that did not happen
    """

    seq: int
    uid: UUID
    map: str
    query: str
    kind: str
    cause: str
    stamp: datetime
    transition_at: datetime
    since: datetime
    track_id: int | None
    subject: str
    subject_instance_id: int | None
    instance_id: int | None
    object: str
    object_track_id: int | None
    x_m: float | None
    y_m: float | None
    direction: str | None
    door_id: int | None
    door_name: str | None
    amendment: str | None
    retracts: UUID | None
    created_at: datetime


def newest_change(connection: Connection) -> int:
    """The number of the newest change that is visible; 0 where there is none."""
    with translated():
        return int(connection.scalar(NEWEST) or 0)


@dataclass
class ChangeReader:
    """Mutable: up to which number all is settled, and what is waited for.

    pending  a number that was visible, and a transaction that began to write only after it was
    """

    map_name: str
    settled: int = 0
    pending: tuple[int, int] | None = None

    def read(self, connection: Connection, after: int, limit: int) -> tuple[list[StoredChange], int, bool]:
        """Changes after a number, up to which all was looked at then, and whether there are more already."""
        with translated():
            newest = newest_change(connection)
            if self.pending is None and newest > self.settled:
                self.pending = newest, connection.execute(OWN_NUMBER).scalar_one()
            if self.pending and connection.execute(OLDEST_RUNNING).scalar_one() >= self.pending[1]:
                self.settled, self.pending = self.pending[0], None
            wanted = {"after": after, "through": self.settled, "map": self.map_name, "limit": limit}
            changes = [StoredChange(*row) for row in connection.execute(READ, wanted)]
        if len(changes) == limit:
            return changes, changes[-1].seq, True
        return changes, max(after, self.settled), False
