"""The files of sql/ are read as source: their lines and functions are no longer than a reader sees at once."""

from __future__ import annotations

from semap.schema_files import sql_files
from semap.store.operate.object_comment import CREATE, STATEMENT

COLUMNS = 120
LINES = 60

WIDE = set[str]()
"""Files with lines that are wider: none is added, and what is wrapped leaves the list."""

LONG = {
    "semap.undo_change_set": 100,
    "semap.probability_inside": 66,
    "semap.refresh_regions": 103,
    "semap.way_meets": 84,
    "semap.refresh_map_pairs": 63,
    "semap.write_pair_amendments": 131,
    "semap.follow_steps": 103,
    "semap.rechoose_tracks": 63,
    "semap.write_amendments": 83,
    "semap.lines_arrived": 68,
    "semap.ways_from": 77,
    "semap.repair_relations": 78,
    "semap.pair_as_logged": 64,
}
"""What is longer, and how long: nothing is added, and what is cut to size or gone leaves the list."""


def test_lines_are_within_the_columns() -> None:
    wide = {
        file.name
        for file in sql_files("sql")
        if any(len(line) > COLUMNS for line in file.read_text().split("\n"))
    }
    assert wide == WIDE


def test_functions_and_views_are_seen_at_once() -> None:
    lines = {}
    for file in sql_files("sql"):
        sql = file.read_text()
        for statement in STATEMENT.finditer(sql):
            created = CREATE.match(sql, statement.start())
            if created is not None:
                lines[created["name"]] = sql.count("\n", created.start("create"), statement.end()) + 1
    assert {name: max(each, LONG.get(name, 0)) for name, each in lines.items() if each > LINES} == LONG
