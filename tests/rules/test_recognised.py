"""A rule is known as the template that says the same, however it is written; else it is said in what it differs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rules.certificate_cases import edge_rules, formula_rules, interval_rules, pattern_rules

from semap.errors import InvalidInput
from semap.rules.language.duration import write_duration
from semap.rules.language.parameter import Parameter
from semap.rules.language.reading import parse_declaration, read_declaration
from semap.rules.language.recognised import recognise
from semap.rules.language.template import TEMPLATES, fill
from semap.rules.language.written import write_rule

NAMES = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,20}", fullmatch=True).map(lambda name: f"n{name}")
TEXTS = st.text(st.characters(codec="utf-8", categories=["L", "N", "P", "S", "Zs"]), max_size=40)
VALUES = {
    "query": NAMES.map(lambda name: f"q{name}"),
    "state": NAMES,
    "name": NAMES,
    "room": TEXTS,
    "person": TEXTS,
    "door": TEXTS,
    "duration": st.integers(1, 10**12).map(write_duration),
    "count": st.integers(0, 899_999).map(str),
    "distance_m": st.floats(0.01, 100).map(lambda value: f"{value:.2f}").filter(lambda text: float(text) > 0),
}
DOCUMENTED = re.findall(r"```yaml\n(.*?)```", Path("docs/rules.md").read_text(), re.DOTALL)


def value_of(parameter: Parameter, data: st.DataObject) -> str:
    return str(data.draw(VALUES[parameter.kind], parameter.name))


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(sorted(TEMPLATES)), st.data())
def test_what_a_template_was_filled_with_is_found_again(name: str, data: st.DataObject) -> None:
    values = {each.name: value_of(each, data) for each in TEMPLATES[name].parameters}
    declared = read_declaration(fill(name, **values))
    rewritten = read_declaration(write_rule(declared.name, declared.as_json()))
    for rule in (declared, rewritten):
        found = recognise(rule)
        assert found.template == name
        assert found.values is not None
        assert read_declaration(fill(name, **found.values)) == declared


@settings(max_examples=200, deadline=None, suppress_health_check=list(HealthCheck))
@given(pattern_rules() | formula_rules() | interval_rules() | edge_rules())
def test_no_other_rule_is_taken_for_a_template(document: dict[str, object]) -> None:
    try:
        declared = parse_declaration(document)
    except InvalidInput:
        return
    found = recognise(declared)
    if found.values is None:
        assert found.differs
    else:
        assert read_declaration(fill(found.template, **found.values)) == declared


@pytest.mark.parametrize(
    ("text", "template", "values", "differs"),
    [
        ("name: a\ninput: track_in_room\nemit: {began: b, ended: c}\n", "visits", {"entered": "b", "left": "c"}, ()),
        ("name: a\ninput: track_in_room\nemit: {began: b}\n", "visits", None, ("emit",)),
        (fill("dwell", room="Lab").replace("10 min", "{match: 10 min, step: 1 min}"), "dwell", None, ("within",)),
        (fill("dwell").replace("emit: dwelt", "emit: stayed"), "dwell", None, ("emit",)),
        (
            fill("dwell", room="Lab").replace("instance = 'Lab'", "instance = 'Lab' and   track='Ann'"),
            "dwell",
            None,
            ("where",),
        ),
        (fill("dwell", room="Lab", person="Ann").replace("=", " =  "), "dwell", {"room": "Lab", "person": "Ann"}, ()),
    ],
)  # fmt: skip
def test_a_rule_that_no_template_says_differs_in_what_is_named(
    text: str, template: str, values: dict[str, str] | None, differs: tuple[str, ...]
) -> None:
    found = recognise(read_declaration(text))
    assert (found.template, found.differs) == (template, differs)
    assert (found.values is None) == (values is None)
    assert (values or {}).items() <= (found.values or {}).items()


def test_of_the_documentation_only_the_same_rules_are_sentences() -> None:
    said = {}
    for text in DOCUMENTED:
        declared = read_declaration(text)
        found = recognise(declared)
        if found.values is not None:
            said[declared.name] = found.template
    assert said == {"room_visits": "visits", "meetings": "visits", "long_stay": "dwell"}
