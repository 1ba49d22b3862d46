"""The files of sql/ are read as source: their lines and functions are no longer than a reader sees at once."""

from __future__ import annotations

import re
from pathlib import Path

from semap.schema_files import schema_folder, sql_files
from semap.store.operate.object_comment import CREATE, STATEMENT

CHECKOUT = Path(__file__).parents[2]
COLUMNS = 120
LINES = 60

WIDE = set[str]()
"""Files with lines that are wider: none is added, and what is wrapped leaves the list."""


def test_lines_are_within_the_columns() -> None:
    wide = {
        file.name
        for file in sql_files("sql")
        if any(len(line) > COLUMNS for line in file.read_text().split("\n"))
    }
    assert wide == WIDE


def test_functions_and_views_are_seen_at_once() -> None:
    long = {}
    for file in sql_files("sql"):
        sql = file.read_text()
        for statement in STATEMENT.finditer(sql):
            created = CREATE.match(sql, statement.start())
            if created is not None:
                lines = sql.count("\n", created.start("create"), statement.end()) + 1
                if lines > LINES:
                    long[created["name"]] = lines
    assert long == {}


def test_a_test_of_one_file_has_its_number() -> None:
    """`test_NNN_topic.py` is about the file of sql/ with that number, or about those of that folder."""
    known = {path.name[:3] for path in schema_folder("sql").iterdir()}
    tests = [path.name for path in (CHECKOUT / "tests").rglob("test_[0-9]*.py")]
    assert {name for name in tests if not re.fullmatch(r"test_\d{3}_\w+\.py", name)} == set()
    assert {name for name in tests if name[5:8] not in known} == set()
    assert {name[5:8] for name in tests} > {"104", "117", "415"}
