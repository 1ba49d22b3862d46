"""The log as a table: CSV (RFC 4180) or Parquet. One row an event; key and measures are JSON texts."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from semap.errors import InvalidInput
from semap.model.event_log import ENTRY_TYPES, Entry

if TYPE_CHECKING:
    import pyarrow

KINDS = {"datetime": "stamp", "int": "int64", "float": "float64"}
"""Of columns that are no text."""
COLUMNS: Mapping[str, str] = {name: KINDS.get(type_, "string") for name, type_ in ENTRY_TYPES.items()}
BATCH = 10_000


def write_csv(entries: Iterable[Entry], path: Path) -> int:
    """Stamps are RFC 3339 in UTC; what is missing is empty. Returns how many rows."""
    count = 0
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(COLUMNS), lineterminator="\r\n")
        writer.writeheader()
        for entry in entries:
            row = _row(entry)
            row["stamp"] = entry.stamp.astimezone(UTC).isoformat()
            row["since"] = entry.since.astimezone(UTC).isoformat()
            writer.writerow(row)
            count += 1
    return count


def write_parquet(entries: Iterable[Entry], path: Path) -> int:
    """Stamps are timestamps in UTC [us]. Returns how many rows.

    raises InvalidInput without pyarrow
    """
    try:
        import pyarrow as pa  # noqa: PLC0415
        import pyarrow.parquet as pq  # noqa: PLC0415
    except ImportError as error:
        raise InvalidInput(
            "writing Parquet needs pyarrow", "pip install 'semap[parquet]'", path.name
        ) from error
    schema = _schema(pa)
    count = 0
    with pq.ParquetWriter(path, schema) as writer:
        for rows in _batches(entries):
            writer.write_batch(pa.RecordBatch.from_pylist(rows, schema=schema))
            count += len(rows)
    return count


def _schema(pa: pyarrow) -> pyarrow.Schema:
    types = {
        "string": pa.string(),
        "int64": pa.int64(),
        "float64": pa.float64(),
        "stamp": pa.timestamp("us", "UTC"),
    }
    return pa.schema([(name, types[kind]) for name, kind in COLUMNS.items()])


def _batches(entries: Iterable[Entry]) -> Iterator[list[dict[str, object]]]:
    left = iter(entries)
    while rows := [_row(entry) for entry in islice(left, BATCH)]:
        yield rows


def _row(entry: Entry) -> dict[str, object]:
    row = {name: getattr(entry, name) for name in COLUMNS}
    row["event_id"] = str(entry.event_id)
    for name in ("key", "measures"):
        row[name] = json.dumps(row[name], ensure_ascii=False, sort_keys=True)
    return row
