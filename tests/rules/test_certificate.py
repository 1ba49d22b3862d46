"""Certificates: the checker agrees with the engine, and passes none that says what the engine does not find."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from conformance.case import Case, read_corpus
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from rules.certificate_cases import (
    S,
    changed,
    changes,
    edge_rules,
    formula_rules,
    interval_rules,
    pattern_rules,
    quantified_rules,
    streams,
)
from scene import OPENED_THEN_ENTERED, STAYED, door, rule, visit

from semap import certificate
from semap.certificate import Unable, Wrong, verify
from semap.errors import InvalidInput
from semap.rules.explanation.certifying import Span, certify
from semap.rules.language.reading import parse_declaration
from semap.rules.row_json import load_row

RELAXED = settings(
    max_examples=60,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)


def declared(document: dict[str, Any]) -> Any:
    try:
        return parse_declaration(document)
    except InvalidInput:
        assume(False)


def certified(
    declaration: Any, rows: list[Any], span: Span, key: dict[str, str] | None = None
) -> dict[str, Any]:
    return json.loads(json.dumps(certify(declaration, rows, span, key)))


@st.composite
def spans(draw: st.DrawFn) -> Span:
    begin = draw(st.integers(9, 22))
    end = begin + draw(st.integers(0, 6))
    return Span(begin * S, end * S, draw(st.sampled_from((12, 20, 24, 60))) * S)


@RELAXED
@given(pattern_rules(), streams(), spans())
def test_the_checker_agrees_with_the_engine_about_patterns(
    rule: dict[str, Any], rows: list[Any], span: Span
) -> None:
    rows = [row for row in rows if row.stamp_us <= span.known_us]
    verify(certified(declared(rule), rows, span))


def claims(certificate: dict[str, Any]) -> Any:
    """What is claimed, whatever number a stream has."""
    keys = [json.dumps(stream["key"]) for stream in certificate["streams"]]
    return [
        sorted(
            json.dumps({**each, "stream": keys[each["stream"]]}, sort_keys=True) for each in certificate[name]
        )
        for name in ("events", "attempts")
    ] + [certificate["other_attempts"]]


def require_no_lie(document: dict[str, Any]) -> None:
    """What passes is what the engine finds of the same rule, rows and span."""
    try:
        verify(document)
    except (Wrong, Unable):
        return
    rows = [load_row(row) for stream in document["streams"] for row in stream["rows"]]
    span = Span(*(document[name] for name in ("from_us", "until_us", "known_us")))
    try:
        declaration = parse_declaration(document["rule"])
    except InvalidInput:
        return  # a rule that could not be added makes no events; what it would make is no claim of the engine's
    found = certified(declaration, rows, span)
    assert claims(found) == claims(document)


@RELAXED
@given(pattern_rules(), streams(), spans(), st.data())
def test_no_changed_certificate_that_lies_passes(
    rule: dict[str, Any], rows: list[Any], span: Span, data: st.DataObject
) -> None:
    rows = [row for row in rows if row.stamp_us <= span.known_us]
    require_no_lie(data.draw(changed(certified(declared(rule), rows, span))))


OTHER_KINDS = formula_rules() | quantified_rules() | interval_rules() | edge_rules()


@RELAXED
@given(OTHER_KINDS, changes(), spans())
def test_the_checker_agrees_about_formulas_intervals_and_edges(
    rule: dict[str, Any], rows: list[Any], span: Span
) -> None:
    rows = [row for row in rows if row.stamp_us <= span.known_us]
    verify(certified(declared(rule), rows, span))


@RELAXED
@given(OTHER_KINDS, changes(), spans(), st.data())
def test_none_of_formulas_intervals_and_edges_that_lies_passes(
    rule: dict[str, Any], rows: list[Any], span: Span, data: st.DataObject
) -> None:
    rows = [row for row in rows if row.stamp_us <= span.known_us]
    require_no_lie(data.draw(changed(certified(declared(rule), rows, span))))


@pytest.mark.parametrize("case", read_corpus(), ids=lambda case: case.name)
def test_the_checker_agrees_about_the_corpus(case: Case) -> None:
    rows = [replace(row, values={**row.values, "input": "moves"}) for row in case.rows]
    for later_s in (0, 3, 1000):
        span = Span(0, rows[-1].stamp_us, rows[-1].stamp_us + later_s * S)
        verify(certified(case.declaration, rows, span))


def test_a_certificate_of_some_keys_and_all_says_what_ended_each() -> None:
    rows = [
        door("kitchen_door", "open", 1, actor="bob"), visit("ann", "kitchen", "began", 4),
        door("office_door", "open", 5, actor="ann"), visit("ann", "office", "began", 6),
    ]  # fmt: skip
    declaration = rule(1, OPENED_THEN_ENTERED).declaration
    whole = certified(declaration, rows, Span(0, 10 * S, 60 * S))
    assert verify(whole) == [
        "The rule opened_then_entered makes entered_by_door at 1970-01-01T00:00:06.000000Z:",
        "  O: door open office_door at 1970-01-01T00:00:05.000000Z",
        "  E: track_in_room began ann office at 1970-01-01T00:00:06.000000Z",
        "  gap_s = 1.0",
        *(
            line
            for room in ("kitchen", "hall")
            for line in (
                f"An attempt came to nothing (room {room}):",
                "  O: door open kitchen_door at 1970-01-01T00:00:01.000000Z",
                "  next would have been E",
                "  nothing that fits came until 1970-01-01T00:00:07.000000Z",
            )
        ),
        "An attempt came to nothing (room hall):",
        "  O: door open office_door at 1970-01-01T00:00:05.000000Z",
        "  next would have been E",
        "  nothing that fits came until 1970-01-01T00:00:11.000000Z",
        "That follows from 6 rows of 3 keys, known up to 1970-01-01T00:01:00.000000Z.",
    ]
    of_office = certified(declaration, rows, Span(0, 10 * S, 60 * S), {"room": "office"})
    assert [each["event"] for each in of_office["events"]] == ["entered_by_door"]
    assert of_office["attempts"] == []
    with pytest.raises(InvalidInput, match="not in the key"):
        certify(declaration, rows, Span(0, 10 * S, 60 * S), {"track": "ann"})


def test_the_checker_is_one_file_that_runs_alone(tmp_path: Path) -> None:
    """Without semap, or anything else that is installed."""
    copy = tmp_path / "checker.py"
    copy.write_bytes(Path(str(certificate.__file__)).read_bytes())
    rows = [visit("ann", "kitchen", "began", 1), visit("ann", "kitchen", "ended", 9)]
    document = certified(rule(1, STAYED).declaration, rows, Span(0, 10 * S, 60 * S))
    (tmp_path / "right.json").write_text(json.dumps(document))
    document["events"][0]["stamp_us"] += 1
    (tmp_path / "wrong.json").write_text(json.dumps(document))
    ran = [
        subprocess.run(
            [sys.executable, "-I", "-S", copy, tmp_path / name], capture_output=True, text=True, check=False
        )
        for name in ("right.json", "wrong.json", "none.json")
    ]
    assert [each.returncode for each in ran] == [0, 1, 1]
    assert ran[0].stdout.startswith("The rule stayed makes stayed at 1970-01-01T00:00:04.000000Z:")
    assert "the rule does not make" in ran[1].stderr
