"""Continuous queries in SQL: what a text declares, and why another one is refused, at which place."""

from __future__ import annotations

import re

import pytest
from corpus import ACCEPTED, CONCEPTS, REFUSED, Accepted

from semap.cql2 import check, parse
from semap.errors import InvalidInput
from semap.query_text import declaration_of
from semap.query_text.condition import KINDS
from semap.query_text.reasons import REASONS
from semap.query_text.refusal import Refusal


@pytest.mark.parametrize("accepted", ACCEPTED, ids=lambda each: each.sql[:90])
def test_a_text_declares_what_it_says(accepted: Accepted) -> None:
    declaration = declaration_of("q", accepted.sql, CONCEPTS)
    assert declaration == accepted.declaration
    for side in (declaration.subject, declaration.object):
        if side.where is not None:
            check(parse(side.where), KINDS[side.kind])


def refused(sql: str) -> tuple[Refusal, InvalidInput]:
    with pytest.raises(InvalidInput) as told:
        declaration_of("q", sql, CONCEPTS)
    assert isinstance(told.value.__cause__, Refusal)
    return told.value.__cause__, told.value


@pytest.mark.parametrize(("reason", "sql", "part"), REFUSED, ids=[f"{r}: {s[-60:]}" for r, s, _ in REFUSED])
def test_a_text_is_refused_for_its_reason_at_its_place(reason: str, sql: str, part: str | None) -> None:
    cause, told = refused(sql)
    assert cause.reason == reason
    assert told.remedy
    assert "{" not in str(told) + told.remedy.replace("'{\"", "")
    if part is not None:
        assert cause.at is not None
        assert sql[cause.at :].startswith(part)
        assert re.match(r"line 1, column \d+: ", str(told)) or "\n" in sql


def test_each_reason_there_is_refuses_something() -> None:
    assert {reason for reason, _, _ in REFUSED} == set(REASONS)


def test_the_place_is_a_line_and_a_column_in_characters() -> None:
    _, told = refused(
        "select t.name -- wärmer\nfrom track t, room r\nwhere r.name = 'Küche' and\tnow() > t.stamp"
    )
    assert told.where == "line 3, column 28"


def test_a_name_that_is_near_is_told() -> None:
    assert "Did you mean room?" in refused("select * from track t, rom r")[1].remedy
    assert "Did you mean name?" in refused("select t.nane from track t, room r where is_in(t, r)")[1].remedy


def test_concepts_are_asked_for_in_snake_case() -> None:
    declaration = declaration_of(
        "q", "select t.name from track t, dining_table d where ST_Covers(d.footprint, t.position)", CONCEPTS
    )
    assert declaration.object.concept == "DiningTable"
