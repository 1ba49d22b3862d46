"""A building on a map and a recording played on it, through the whole way."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from semap_ingest.replay import Plan, replay
from semap_ingest.track_file import Tracks

from semap.model.building import Building
from semap.store.database.connection import connect, one_transaction
from semap.store.map.building import ImportReport, import_building
from semap.store.map.maps import create_map

EVENTS = """
    select type, cause, track_name, instance_name, extract(epoch from e.stamp)::float8
    from semap.event e join semap.map m using (map_id) where m.name = %s order by seq
"""


def bring_in(dsn: str, name: str, building: Building) -> ImportReport:
    """Import a building into a new map."""
    with one_transaction(dsn, "semap_api") as connection:
        create_map(connection, name)
        return import_building(connection, name, building)


def play(dsn: str, name: str, tracks: Tracks, **options: object) -> None:
    plan = Plan(name, "recording", str(Path(name)), f"{name} {options}")
    replay(dsn, replace(plan, **options), tracks)


def changes(dsn: str, name: str) -> int:
    with connect(dsn) as connection:
        row = connection.execute(
            "select count(*) from semap.relation_change join semap.map m using (map_id) where m.name = %s",
            [name],
        ).fetchone()
    assert row is not None
    return row[0]


def events(dsn: str, name: str) -> list[tuple[str, str, str, str, float]]:
    with connect(dsn) as connection:
        return connection.execute(EVENTS, [name]).fetchall()
