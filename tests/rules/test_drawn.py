"""The drawing of a rule: the pattern's own structure, with all of its variables and events, each once a place."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, assume, given, settings
from rules.certificate_cases import edge_rules, formula_rules, interval_rules, pattern_rules

from semap.errors import InvalidInput
from semap.rules.declaration import Edges
from semap.rules.language.drawn import Part, draw
from semap.rules.language.names import names_of
from semap.rules.language.reading import parse_declaration, read_declaration

RULES = re.findall(r"```yaml\n(.*?)```", Path("docs/rules.md").read_text(), re.DOTALL)


def outline(part: Part) -> str:
    """The drawing on one line: joint, kind and label of each box."""
    inside = " ".join(map(outline, part.parts))
    box = (
        f"{part.kind}({inside})"
        if part.parts
        else part.label
        if part.kind == "step"
        else f"{part.kind}:{part.label}"
    )
    return f"-{part.joint.split()[0]}> {box}" if part.joint else box


def boxes(part: Part) -> Iterator[Part]:
    yield part
    for each in part.parts:
        yield from boxes(each)


@pytest.mark.parametrize(
    ("pattern", "drawn"),
    [
        ("A B", "sequence(-directly> A -directly> B event:e)"),
        ("A followed by B?", "sequence(-directly> A -later> repeat(B) event:e)"),
        ("A followed by any (B | A B)", "sequence(-directly> A -each> choice(B sequence(-directly> A -directly> B)) event:e)"),
        ("A not followed by B", "sequence(-directly> A -later> never:B event:e)"),
        ("permute(A, B)", "sequence(all(A B) event:e)"),
        ("A{2,4} relaxed until B", "sequence(repeat(A) event:e)"),
    ],
)  # fmt: skip
def test_a_pattern_is_drawn_as_it_is_built(pattern: str, drawn: str) -> None:
    names = {name: "type = 'began'" for name in "AB" if re.search(rf"\b{name}\b", pattern)}
    document = {"name": "r", "input": "q", "pattern": pattern, "define": names, "within": "5 s", "emit": "e"}
    assert outline(draw(parse_declaration(document))) == drawn


@pytest.mark.parametrize("text", RULES, ids=lambda text: re.findall(r"name: (\w+)", text)[0])
def test_every_rule_of_the_documentation_is_drawn_to_its_events(text: str) -> None:
    declared = read_declaration(text)
    events = [each.label for each in boxes(draw(declared)) if each.kind == "event"]
    assert sorted(events) == sorted(declared.emit.values())


@settings(max_examples=200, deadline=None, suppress_health_check=list(HealthCheck))
@given(pattern_rules() | formula_rules() | interval_rules() | edge_rules())
def test_no_event_and_no_variable_is_left_out(document: dict[str, Any]) -> None:
    try:
        declared = parse_declaration(document)
    except InvalidInput:
        assume(False)
    drawn = list(boxes(draw(declared)))
    assert {each.label for each in drawn if each.kind == "event"} == set(declared.emit.values())
    if not isinstance(declared.body, Edges):
        names = names_of(declared.body)
        said = " ".join(each.text for each in drawn)
        assert names.all - names.ending == {
            each.label for each in drawn if each.kind in ("step", "never")
        } - {""}
        assert all(f"({name})" in said for name in names.ending)
