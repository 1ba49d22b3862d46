"""The log as CSV and Parquet, read back by csv and pyarrow."""

from __future__ import annotations

import csv
import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from uuid import UUID

import pyarrow.parquet as pq
import pytest

from semap.event_log.table import COLUMNS, write_csv, write_parquet
from semap.model.event_log import Entry

T = datetime(2026, 1, 31, 12, 0, 0, 123456, tzinfo=UTC)
ENTRIES = [
    Entry(
        UUID(int=1), "entered", T, T - timedelta(seconds=1), "office", "visits", 1, 3, 'ann, "a"\nb', 7, "Küche",
        "Room", "moved", None, None, {"room": "Küche"},
    ),
    Entry(UUID(int=2), "dark", T + timedelta(microseconds=1), T, "office", "dark", 2, confidence=0.5, measures={"n": 1.5}),
]  # fmt: skip


def wanted(entry: Entry) -> dict[str, object]:
    row = {name: getattr(entry, name) for name in COLUMNS}
    return {**row, "event_id": str(entry.event_id), "key": dict(entry.key), "measures": dict(entry.measures)}


def test_csv(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    assert write_csv(ENTRIES, path) == 2
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for row, entry in zip(rows, ENTRIES, strict=True):
        said = {name: value or None for name, value in row.items()}
        for name in ("key", "measures"):
            said[name] = json.loads(row[name])
        for name in ("stamp", "since"):
            said[name] = datetime.fromisoformat(row[name])
        for name, kind in (
            ("rule_version", int),
            ("track_id", int),
            ("instance_id", int),
            ("confidence", float),
        ):
            said[name] = kind(row[name]) if row[name] else None
        assert said == wanted(entry)


@pytest.mark.parametrize("count", [2, 0])
def test_parquet(tmp_path: Path, count: int) -> None:
    path = tmp_path / "log.parquet"
    assert write_parquet(ENTRIES[:count], path) == count
    table = pq.read_table(path)
    assert table.column_names == list(COLUMNS)
    for row, entry in zip(table.to_pylist(), ENTRIES[:count], strict=True):
        assert {**row, "key": json.loads(row["key"]), "measures": json.loads(row["measures"])} == wanted(
            entry
        )
