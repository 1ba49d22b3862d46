"""The clause `about`: which of a match's rows says whose instance the event is of."""

import pytest
from rules.scene import S, rule, visit

from semap.errors import InvalidInput
from semap.rules.engine.run_over import run_over
from semap.rules.language.reading import parse_declaration

RULE = {"name": "left", "input": "track_in_room", "partition_by": "track", "pattern": "R H", "emit": "left"}


def test_about_names_a_variable_of_the_pattern():
    assert parse_declaration(RULE).about is None
    declaration = parse_declaration({**RULE, "about": "R"})
    assert declaration.about == "R"
    assert declaration.document["about"] == "R"


@pytest.mark.parametrize("about", ["X", 3, ["R"], ""])
def test_about_anything_else_is_refused(about):
    with pytest.raises(InvalidInput, match="about"):
        parse_declaration({**RULE, "about": about})


def test_only_patterns_of_rows_are_about_something():
    with pytest.raises(InvalidInput, match="about"):
        parse_declaration({"name": "visits", "input": "track_in_room", "emit": {"began": "a"}, "about": "R"})


def test_a_verdict_is_about_whom_it_was_asked_of():
    """Whoever came at that moment or later, and decided it."""
    others = rule(1, {
        "name": "joined", "input": "track_in_room", "when": "A", "formula": "eventually[0 s, 5 s] O",
        "define": {"A": "type = 'began'", "O": "instance_id <> A.instance_id and track_id <> A.track_id"},
        "emit": {"holds": "elsewhere", "fails": "alone"},
    })  # fmt: skip
    rows = [visit("ann", "kitchen", "began", 10), visit("bob", "hall", "began", 12)]
    told = [(event.type, event.track_name, event.instance_name) for event in run_over([others], rows, 60 * S)]
    assert told == [("elsewhere", "ann", "kitchen"), ("elsewhere", "bob", "hall")]
