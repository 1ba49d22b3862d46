"""The end of the log of events, for the one who follows it and for whom all others wait.

Its questions are those of `events`, prepared and asked by psycopg: all events wait for each of them.
"""

from __future__ import annotations

from sqlalchemy.dialects.postgresql.psycopg import PGDialect_psycopg

from semap.store.database.connection import connect, listen, translated
from semap.store.database.event_number import NEWEST, NEWEST_OF_MAPS
from semap.store.event.events import NEXT_EVENTS, UNPLACED_EVENTS, StoredEvent, event_of

_DRIVER = PGDialect_psycopg()  # type: ignore[no-untyped-call]  # of a library without types there
_NEWEST, _NEWEST_OF_MAPS, _PLACED, _UNPLACED = (
    str(each.compile(dialect=_DRIVER)) for each in (NEWEST, NEWEST_OF_MAPS, NEXT_EVENTS, UNPLACED_EVENTS)
)


class EventTail:
    """Two connections of its own: one is told that there are events, the other reads them.

    raises  ServerUnavailable, as all that it does, where the server does not answer or went away
    """

    def __init__(self, dsn: str, role: str, *, application: str) -> None:
        self._told = listen(dsn, "semap_event", role, application=application)
        try:
            self._reading = connect(dsn, role, application=application)
        except BaseException:
            self._told.close()
            raise

    def close(self) -> None:
        self._told.close()
        self._reading.close()

    def fileno(self) -> int:
        """Of what can be read as soon as it was told of events."""
        with translated():
            return self._told.fileno()

    def pass_notices(self) -> None:
        """Take what it was told, so that it is told anew."""
        with translated():
            for _ in self._told.notifies(timeout=0):
                pass

    def newest(self) -> tuple[int, dict[str, int]]:
        """The number of the newest event by the numbers of all maps, and by those of each."""
        with translated():
            of_maps: dict[str, int] = dict(self._reading.execute(_NEWEST_OF_MAPS).fetchall())
            row = self._reading.execute(_NEWEST).fetchone()
        return int(row[0]) if row else 0, of_maps

    def events(self, *, after: int, limit: int, placed: bool) -> tuple[StoredEvent, ...]:
        """At most `limit` events with numbers above `after`, in their order.

        placed  False: all places are None, whose look-up takes a third of the time
        """
        statement = _PLACED if placed else _UNPLACED
        with translated():
            rows = self._reading.execute(statement, {"after": after, "most": limit}, prepare=True).fetchall()
        return tuple(event_of(row) for row in rows)
