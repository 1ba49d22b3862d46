"""Where a client begins to follow, and what it has missed until then."""

from __future__ import annotations

from dataclasses import dataclass

from sqlalchemy import Engine

from semap.errors import InvalidInput, NotFound
from semap.store.event.event_selection import Selection
from semap.store.event.events import kept_events
from semap.store.map.places import place_of
from semap_service.context.caller import SYSTEM, acting_as
from semap_service.database.transaction import transaction


@dataclass(frozen=True)
class StartPosition:
    """Everything with a number above `cursor` is to follow.

    head    the newest event
    oldest  the oldest event that is kept; None where none is
    gap     events between the client's own cursor and this one were deleted
    """

    cursor: int
    head: int
    oldest: int | None
    gap: bool


def begin(engine: Engine, after: int | None, selection: Selection) -> StartPosition:
    """Where to begin after a cursor; without one, with what comes.

    raises  NotFound for an unknown map, InvalidInput for a filter that cannot be used, or for a cursor that
            no event has reached
    """
    require_usable(engine, selection)
    # What is kept is the same for all, also for those who may see some of it only.
    with acting_as(SYSTEM, "read"), transaction(engine) as connection:
        kept = kept_events(connection, selection.own_of)
    if after is None:
        return StartPosition(kept.newest, kept.newest, kept.oldest, gap=False)
    if after > kept.newest:
        raise InvalidInput(
            f"{after} is beyond the newest event, {kept.newest}",
            "The database is another one, or was restored: begin again without a cursor.",
            "after",
        )
    first_kept = kept.newest + 1 if kept.oldest is None else kept.oldest
    gap = after < first_kept - 1
    return StartPosition(first_kept - 1 if gap else after, kept.newest, kept.oldest, gap)


def require_usable(engine: Engine, selection: Selection) -> None:
    """raises NotFound for an unknown map, InvalidInput for a filter that cannot be used"""
    selection.check()
    if selection.map is None:
        return
    if selection.maps is not None and selection.map not in selection.maps:
        raise NotFound("map", selection.map, "List the maps to see their names.")
    with transaction(engine) as connection:
        place_of(connection, selection.map)
