"""How many live tracks a source has is asked with each frame, and is found without those of other sources."""

from __future__ import annotations

import json

from bench.crowd import build_map
from semap.store.database.connection import connect

COUNT = "select count(*) from semap.track_now where map_id = %s and live and source_id = %s"


def test_tracks_of_other_sources_are_not_read(database: str) -> None:
    with connect(database) as connection:
        map_id, _ = build_map(connection, "floor", [], 4_000, per_source=100)
        connection.execute("update semap.track_now set live = true")
        connection.execute("vacuum analyze semap.track_now")
        (source_id,) = connection.execute("select min(source_id) from semap.source").fetchone() or (0,)
        assert connection.execute(COUNT, [map_id, source_id]).fetchone() == (100,)
        ((plan,),) = (
            connection.execute(f"explain (analyze, format json) {COUNT}", [map_id, source_id]).fetchall()
        )  # fmt: skip
    assert "track_now_live" in json.dumps(plan)
    assert "Rows Removed by Filter" not in json.dumps(plan)
