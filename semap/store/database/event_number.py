"""The number of the newest event: from where on those who wait for events want them."""

from __future__ import annotations

from sqlalchemy import Connection, func, literal_column, select

from semap.store.database.connection import translated
from semap.store.database.tables import event, event_count, place, progress

NEWEST = select(
    func.greatest(
        select(func.max(progress.c.event_seq)).scalar_subquery(),
        select(func.max(event.c.seq)).scalar_subquery(),
        literal_column("0"),
    )
)
NEWEST_OF_MAPS = select(place.c.name, event_count.c.newest).join(
    event_count, event_count.c.map_id == place.c.map_id
)


def newest_event(connection: Connection, of_map: str | None = None) -> int:
    """The number of the newest event; 0 where there was none. It does not go back when events are deleted.

    of_map  by the numbers of this map, and not by those of all
    """
    newest = NEWEST
    if of_map is not None:
        newest = NEWEST_OF_MAPS.with_only_columns(event_count.c.newest).where(place.c.name == of_map)
    with translated():
        return int(connection.execute(newest).scalar_one_or_none() or 0)
