"""The files of sql/ are read as source: their lines and functions are no longer than a reader sees at once."""

from __future__ import annotations

from semap.store.object_comment import CREATE, STATEMENT
from semap.store.schema_files import schema_folder

COLUMNS = 120
LINES = 60

WIDE = {
    "110_region.sql",
    "115_query_track.sql",
    "118_region_shape.sql",
    "119_doorway.sql",
    "120_region_upkeep.sql",
    "121_pair_member.sql",
    "122_pair_predicate.sql",
    "123_pair.sql",
    "124_pair_crossing.sql",
    "125_source.sql",
    "126_pair_upkeep.sql",
    "128_pair_play.sql",
    "129_late_pair.sql",
    "130_track.sql",
    "131_outlier.sql",
    "132_careful.sql",
    "136_track_described.sql",
    "138_late_span.sql",
    "139_late_state.sql",
    "147_pair_follow.sql",
    "150_object_state.sql",
    "500_verify.sql",
    "505_log_verify.sql",
    "507_pair_verify.sql",
    "508_pair_history_verify.sql",
    "510_repair.sql",
    "512_pair_repair.sql",
}
"""Files with lines that are wider: none is added, and what is wrapped leaves the list."""

LONG = {
    "semap.undo_change_set": 100,
    "semap.probability_inside": 66,
    "semap.refresh_regions": 101,
    "semap.pair_candidates": 67,
    "semap.settle_pairs": 77,
    "semap.way_meets": 82,
    "semap.write_pair_amendments": 125,
    "semap.follow_steps": 113,
    "semap.write_amendments": 80,
    "semap.amend_track": 69,
    "semap.lines_arrived": 68,
    "semap.ways_from": 77,
    "semap.repair_relations": 75,
}
"""What is longer, and how long: nothing is added, and what is cut to size or gone leaves the list."""


def test_lines_are_within_the_columns() -> None:
    wide = {
        file.name
        for file in schema_folder("sql").glob("*.sql")
        if any(len(line) > COLUMNS for line in file.read_text().split("\n"))
    }
    assert wide == WIDE


def test_functions_and_views_are_seen_at_once() -> None:
    lines = {}
    for file in schema_folder("sql").glob("*.sql"):
        sql = file.read_text()
        for statement in STATEMENT.finditer(sql):
            created = CREATE.match(sql, statement.start())
            if created is not None:
                lines[created["name"]] = sql.count("\n", created.start("create"), statement.end()) + 1
    assert {name: max(each, LONG.get(name, 0)) for name, each in lines.items() if each > LINES} == LONG
