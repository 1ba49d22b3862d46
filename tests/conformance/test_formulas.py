"""Formulas whose verdicts were worked out by hand, by the engine and by the checker of certificates."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from semap.certificate import verify
from semap.rules.explanation.certifying import Span, certify
from semap.rules.language.reading import parse_declaration
from semap.rules.row import RANKS, Row

S = 1_000_000
CASES = yaml.safe_load((Path(__file__).parent / "formulas.yaml").read_text())


def row(word: str) -> Row:
    parts = re.fullmatch(r"([pqrs])([+-]?)@(\d+)", word)
    assert parts, word
    stamp_us = int(parts[3]) * S
    values = {
        "input": parts[1],
        "type": {"+": "on", "-": "off", "": "asked"}[parts[2]],
        "stamp": stamp_us,
        "instance_id": 1,
    }
    return Row(stamp_us, RANKS["object_state"], word, "object_state", values)


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case['formula']}: {case['rows']}")
def test_formula(case: dict[str, Any]) -> None:
    used = [name for name in "PQR" if name in case["formula"]]
    declaration = parse_declaration({
        "name": "case", "input": [{"object_state": each} for each in "pqrs"], "when": "S", "formula": case["formula"],
        "define": {"S": "input = 's'", **{name: f"input = '{name.lower()}' and type = 'on'" for name in used}},
        "emit": {"holds": "holds", "fails": "fails"},
    })  # fmt: skip
    document = certify(declaration, [row(word) for word in case["rows"].split()], Span(0, 200 * S, 200 * S))
    verify(document)
    found: Any = document["events"]
    stamps = {word: row(word).stamp_us // S for word in case["rows"].split()}
    told = [f"{stamps[each['rows'][0][1]]} {each['event']} {each['stamp_us'] / S:g}" for each in found]
    assert told == case["verdicts"], case["source"]
