"""A rule in one sentence: of each kind word for word, of any rule with all of its events and variables."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, assume, given, settings
from rules.certificate_cases import edge_rules, formula_rules, interval_rules, pattern_rules

from semap.errors import InvalidInput
from semap.rules.declaration import Edges
from semap.rules.language.described import describe
from semap.rules.language.names import names_of
from semap.rules.language.reading import parse_declaration, read_declaration

RULES = re.findall(r"```yaml\n(.*?)```", Path("docs/rules.md").read_text(), re.DOTALL)
SAID = {
    "room_visits": "It makes entered when track_in_room begins and left when track_in_room ends.",
    "opened_then_entered": "For each room, it makes opened_then_entered when door becomes open (O), later track_in_room"
    " begins with track = first(O.actor) (E), all in less than 6 s.",
    "long_stay": "For each track and instance, it makes long_stay when track_in_room begins (I), and it is never so that"
    " track_in_room ends (O) until the window ends, all in less than 10 min, reading only rows with instance ="
    " 'kitchen'.",
    "open_and_empty": "For each room, it makes open_and_empty where at every moment 0 s to 5 min from then (O lasts and"
    " (not P lasts)), asked whenever door becomes open or track_in_room ends (S), where what lasts is O from when door"
    " becomes open (O) and P from when track_in_room begins (P).",
    "there_while_open": "For each room, it makes there_while_open where the time in which track_in_room changes (P) lasts"
    " in the relation during or starts to that in which door becomes open (D) lasts.",
    "door_moved": "It makes door_changed when something of the map is changed and door_removed when something of the map"
    " is removed, reading only rows with isA('Door').",
}


@pytest.mark.parametrize("text", RULES, ids=lambda text: re.findall(r"name: (\w+)", text)[0])
def test_the_rules_of_the_documentation_are_said_in_one_sentence(text: str) -> None:
    declaration = read_declaration(text)
    said = describe(declaration)
    assert said == SAID.get(declaration.name, said)
    assert said.count("\n") == 0
    assert said.endswith(".")


@settings(max_examples=200, deadline=None, suppress_health_check=list(HealthCheck))
@given(pattern_rules() | formula_rules() | interval_rules() | edge_rules())
def test_no_event_and_no_variable_of_a_rule_is_left_out(document: dict[str, Any]) -> None:
    try:
        declaration = parse_declaration(document)
    except InvalidInput:
        assume(False)
    said = describe(declaration)
    assert all(re.search(rf"\b{event}\b", said) for event in declaration.emit.values())
    if not isinstance(declaration.body, Edges):
        assert all(f"({name})" in said for name in names_of(declaration.body).all)
