"""The clause `about`: which of a match's rows says whose instance the event is of."""

import pytest

from semap.errors import InvalidInput
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
