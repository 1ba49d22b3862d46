"""Sources: who says where tracks are and what state objects have, and how far each is believed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import Connection, literal_column, select, update

from semap.errors import InvalidInput, NotFound
from semap.store.database.connection import translated
from semap.store.database.tables import map_, source
from semap.store.map.maps import map_id_of

LONGEST_LATENESS_S = 86_400.0
FARTHEST_M = 1e6
FASTEST_MPS = 1e6
"""Bounds of the settings."""


@dataclass(frozen=True)
class Settings:
    """How far a source is believed.

    lateness_s  rules wait so long for rows of it that come after others of later stamps
    jump_m      a position further from the last one than this, and `jump_mps` for the time between added
                to it, is set aside until the next one agrees with it; None: every position is taken
    """

    lateness_s: float = 0.0
    jump_m: float | None = 15.0
    jump_mps: float = 30.0


@dataclass(frozen=True)
class Source:
    """A source of tracks or of states of objects.

    late_states  states that came after later ones of their track
    outliers     positions that were set aside, and that no other agreed with
    complete_through  up to which stamp all of its states have come; None where it has brought in nothing
    """

    source_id: int
    map: str
    name: str
    settings: Settings
    late_states: int
    outliers: int
    complete_through: datetime | None


def list_sources(
    connection: Connection, *, map_name: str | None = None, after: int = 0, limit: int = 100
) -> tuple[Source, ...]:
    """At most `limit` sources in the order of their ids, from the first after `after`."""
    found = _SOURCES.where(source.c.source_id > after).order_by(source.c.source_id).limit(limit)
    if map_name is not None:
        found = found.where(map_.c.name == map_name)
    with translated():
        return tuple(_source(row) for row in connection.execute(found))


def get_source(connection: Connection, source_id: int) -> Source:
    """raises NotFound"""
    with translated():
        row = connection.execute(_SOURCES.where(source.c.source_id == source_id)).one_or_none()
    if row is None:
        raise NotFound("source", source_id, "List the sources to see their ids.")
    return _source(row)


def find_source(connection: Connection, map_name: str, name: str) -> Source:
    """The source of a name on a map; raises NotFound"""
    map_id = map_id_of(connection, map_name)
    with translated():
        row = connection.execute(
            _SOURCES.where(source.c.map_id == map_id, source.c.name == name)
        ).one_or_none()
    if row is None:
        raise NotFound("source", name, f"List the sources of the map: semap source list --map {map_name}")
    return _source(row)


def change_source(connection: Connection, source_id: int, settings: Settings) -> Source:
    """Believe a source so far from its next batch on; what was written stays as it is.

    raises  NotFound, InvalidInput
    """
    _check(settings)
    values: Mapping[str, object] = {
        "lateness": timedelta(seconds=settings.lateness_s),
        "jump_m": settings.jump_m,
        "jump_mps": settings.jump_mps,
    }
    with translated():
        connection.execute(update(source).where(source.c.source_id == source_id).values(**values))
    return get_source(connection, source_id)


def _check(settings: Settings) -> None:
    """raises InvalidInput"""
    if not 0 <= settings.lateness_s <= LONGEST_LATENESS_S:
        raise InvalidInput(
            f"a lateness of {settings.lateness_s:g} s", "Give seconds from 0 to a day.", "lateness_s"
        )
    if settings.jump_m is not None and not 0 < settings.jump_m <= FARTHEST_M:
        raise InvalidInput(
            f"a jump of {settings.jump_m:g} m", "Give metres above 0, or none for no gate.", "jump_m"
        )
    if not 0 <= settings.jump_mps <= FASTEST_MPS:
        raise InvalidInput(
            f"a jump of {settings.jump_mps:g} m/s", "Give metres a second, 0 or above.", "jump_mps"
        )


def _source(row: Sequence[Any]) -> Source:
    source_id, map_name, name, lateness, jump_m, jump_mps, late_states, outliers, complete_through = row
    settings = Settings(lateness.total_seconds(), jump_m, jump_mps)
    return Source(source_id, map_name, name, settings, late_states, outliers, complete_through)


_SOURCES = select(
    source.c.source_id,
    map_.c.name,
    source.c.name,
    source.c.lateness,
    source.c.jump_m,
    source.c.jump_mps,
    source.c.late_states,
    source.c.outliers,
    literal_column("nullif(semap.complete_through(source), '-infinity')"),
).join(map_, map_.c.map_id == source.c.map_id)
