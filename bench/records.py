"""What a row costs as a record between intake and rules: in columns, as semap writes it, and row by row.

The rows are those of the benchmark `rules`, a thousand in a record. The clock is that of the processor; ways
take turns, and what is read is compared with what was written. `rules` is the second half of the engine: a
record in, texts of events out, what changed of the state noted, by the rule `A B within 2 s`; `engine` is
the same on rows in memory.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence

from bench.figure import Figure, Rows, figure
from bench.rules import BATCH, MAP_ID, RULE, make_rows
from semap.rules.engine.engine import Engine
from semap.rules.engine.map_rules import MapRules
from semap.rules.engine.record import dump_record, load_steps, split_head
from semap.rules.engine.step import Due, RuleChanged
from semap.rules.row import Row
from semap.rules.row_json import dump_row, load_row

ROWS = 100_000
ROUNDS = 5
UID = "4e1243bd-22c6-5e79-9f8d-5c2f6d3a1b90"


def measure() -> Rows:
    """A row of the table for each way."""
    rows = list(make_rows(0, ROWS))
    batches = [rows[first : first + BATCH] for first in range(0, ROWS, BATCH)]
    dues = [Due(MAP_ID, batch[-1].stamp_us, batch) for batch in batches]
    written: list[tuple[int, float, float]] = []
    plain: list[tuple[int, float, float]] = []
    rates: dict[str, list[float]] = {"rules": [], "engine": []}
    for _ in range(ROUNDS + 1):
        written.append(_columns(dues))
        plain.append(_row_by_row(batches))
        rates["rules"].append(_rules(dues))
        rates["engine"].append(_engine(dues))
    return [_cost("columns", written[1:]), _cost("JSON row by row", plain[1:])] + [
        {"way": way, "rows_per_s": figure(of_way[1:])} for way, of_way in rates.items()
    ]


def _cost(way: str, rounds: Sequence[tuple[int, float, float]]) -> dict[str, object]:
    def us(place: int) -> Figure:
        return figure([each[place] / ROWS * 1e6 for each in rounds], 2)

    return {"way": way, "bytes_per_row": round(rounds[0][0] / ROWS), "write_us": us(1), "read_us": us(2)}


def _columns(dues: Sequence[Due]) -> tuple[int, float, float]:
    """Bytes, and seconds to write and to read."""
    began_s = time.process_time()
    texts = [text for lsn, due in enumerate(dues) for text in dump_record(UID, "main", lsn, [due])]
    written_s = time.process_time()
    found = [load_steps(split_head(text)[1]) for text in texts]
    read_s = time.process_time()
    assert found == [[due] for due in dues]
    return sum(map(len, texts)), written_s - began_s, read_s - written_s


def _row_by_row(batches: Sequence[Sequence[Row]]) -> tuple[int, float, float]:
    began_s = time.process_time()
    texts = [json.dumps([dump_row(row) for row in batch]) for batch in batches]
    written_s = time.process_time()
    found = [[load_row(each) for each in json.loads(text)] for text in texts]
    read_s = time.process_time()
    assert found == batches
    return sum(map(len, texts)), written_s - began_s, read_s - written_s


def _rules(dues: Sequence[Due]) -> float:
    """Rows a second."""
    texts = [text for lsn, due in enumerate(dues, 1) for text in dump_record(UID, "main", lsn, [due])]
    rules = MapRules({})
    rules.take(*dump_record(UID, "main", 0, [RuleChanged(MAP_ID, RULE.rule_id, RULE)]))
    began_s = time.process_time()
    for text in texts:
        rules.take(text)
        rules.changes()
    return ROWS / (time.process_time() - began_s)


def _engine(dues: Sequence[Due]) -> float:
    engine = Engine()
    engine.change_rule(RULE.rule_id, RULE)
    began_s = time.process_time()
    for due in dues:
        engine.take(due)
        engine.changes()
    return ROWS / (time.process_time() - began_s)
