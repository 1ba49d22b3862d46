"""A rule that is written out is read as the same rule."""

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from semap.rules.language.reading import read_declaration
from semap.rules.language.source_text import DEEPEST, read_source
from semap.rules.language.template import TEMPLATES, fill
from semap.rules.language.written import write_rule

WORDS = st.sampled_from(
    ["on", "no", "1e5", "0x1f", "12:30", "~", "null", ".5", "- a", "a: b", "#", "", "a\n b\n"]
)
TEXTS = WORDS | st.text(
    st.characters(exclude_categories=["Cs", "Cc"], include_characters="\n\t"), max_size=200
)
NUMBERS = st.integers(-(10**17), 10**17) | st.floats(allow_nan=False, allow_infinity=False)
VALUES = st.recursive(
    st.none() | st.booleans() | NUMBERS | TEXTS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXTS, inner, max_size=4),
    max_leaves=12,
)


def depth(value: object) -> int:
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else None
    return 0 if inner is None else 1 + max(map(depth, inner), default=0)


@pytest.mark.parametrize("template", TEMPLATES)
def test_a_template_comes_back(template: str) -> None:
    declared = read_declaration(fill(template))
    assert read_declaration(write_rule(declared.name, declared.as_json())) == declared


@given(st.dictionaries(TEXTS.filter(lambda key: key != "name"), VALUES, max_size=5))
def test_whatever_is_stored_comes_back(declaration: dict[str, object]) -> None:
    if depth(declaration) >= DEEPEST:
        return
    text = write_rule("a", declaration)
    assert read_source(text).document == {"name": "a", **declaration}


def test_clauses_come_in_the_order_in_which_they_are_read() -> None:
    declared = read_declaration(fill("opened_then_entered"))
    text = write_rule(declared.name, dict(sorted(declared.as_json().items())))
    assert list(yaml.safe_load(text)) == [
        "name", "input", "partition_by", "pattern", "define", "measures", "within", "after_match", "emit",
    ]  # fmt: skip
