"""Each predicate is one file: what the database, the check of queries and the documentation know of it is from there."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import psycopg
import pytest
from world import World

from semap.model.continuous_query import Declaration, Side
from semap.model.predicate import ANY, Predicate, predicates, read_predicate
from semap.query_text.relation import NUMBERS
from semap.store.relation.query_check import PARAMETERS

QUERIES = Path(__file__).parents[2] / "docs" / "queries.md"
SAMPLE = {"distance_m": 2.0, "count": 3, "angle_rad": 0.3, "speed_mps": 0.5, "direction": "left_to_right"}
EACH = pytest.mark.parametrize("each", predicates().values(), ids=lambda each: each.name)


def sentences(heading: str) -> dict[str, str]:
    """By predicate: what the first table of predicates after these words says of it."""
    text = QUERIES.read_text()
    rows = re.search(r"(?:^\|.*\n)+", text[text.index(heading) :], re.M)
    assert rows is not None
    cells = [line.strip("|").split(" | ") for line in rows[0].splitlines()[2:]]
    return {name: last[-1].strip() for first, *last in cells for name in re.findall(r"`(\w+)`", first)}


def test_the_documentation_says_what_the_files_say() -> None:
    in_regions = {each.name: each.holds_in_regions for each in predicates().values() if each.region_test}
    assert sentences("has one query, `track_in_room`") == in_regions
    assert sentences("## Pairs") == {each.name: each.holds for each in predicates().values()}
    text = QUERIES.read_text()
    for each in predicates().values():
        assert each.rows is None or f"`{each.rows.name}(" in text


def add(world: World, predicate: str, subject: str, object_: str, **parameters: Any) -> bool:
    """Add a query by SQL alone, as who may write the table can, and say whether it is kept in pairs."""
    names = ", ".join(["map_id", "name", "predicate", "subject_kind", "object_kind", *parameters])
    values = [
        world.map_id,
        f"{predicate} {subject} {object_} {sorted(parameters)}",
        predicate,
        subject,
        object_,
    ]
    places = ", ".join(["%s"] * (len(values) + len(parameters)))
    return bool(
        world.one(
            f"insert into semap.continuous_query ({names}) values ({places}) returning in_pairs",
            *values,
            *parameters.values(),
        )
    )


@EACH
def test_the_database_asks_for_what_a_file_says(world: World, each: Predicate) -> None:
    needed = {name: SAMPLE[name] for name in each.needs}
    taken = {name: SAMPLE[name] for name in each.takes}
    for kinds in ANY:
        subject, object_ = kinds.split()
        if kinds in each.relates:
            declared = Declaration("any", each.name, Side(subject), Side(object_))  # type: ignore[arg-type]
            assert add(world, each.name, subject, object_, **needed) == declared.in_pairs
        else:
            with pytest.raises(psycopg.errors.CheckViolation, match="does not relate"):
                add(world, each.name, subject, object_, **needed)
    subject, object_ = each.relates[0].split()
    if taken:
        add(world, each.name, subject, object_, **needed, **taken)
    for name in each.needs:
        with pytest.raises(psycopg.errors.CheckViolation, match="is told"):
            add(world, each.name, subject, object_, **{key: needed[key] for key in needed if key != name})
    for name in SAMPLE.keys() - needed.keys() - taken.keys():
        with pytest.raises(psycopg.errors.CheckViolation, match="is told"):
            add(world, each.name, subject, object_, **needed, **{name: SAMPLE[name]})


def test_a_predicate_without_a_file_is_refused(world: World) -> None:
    with pytest.raises(psycopg.errors.IntegrityError):
        add(world, "overlooks", "track", "track")


@EACH
def test_a_file_names_parameters_and_functions_that_there_are(world: World, each: Predicate) -> None:
    assert {*each.needs, *each.takes} <= PARAMETERS.keys()
    function = "select to_regproc(%s) is not null"
    assert world.one(function, f"semap.{each.name}_stands") == (each.follows_from in ("moment", "trend"))
    assert bool(each.why_not) == (each.relates != ANY)
    assert bool(each.holds_in_regions) == (each.region_test is not None)
    if each.rows is not None:
        assert set(each.rows.numbers) <= NUMBERS.keys()
        assert {*each.needs} <= {*each.rows.numbers, *each.rows.always}
        assert world.one(function, f"semap_query.{each.rows.name}")


def test_a_file_that_does_not_say_what_it_is_is_refused() -> None:
    for sql in ("select 1", "/* holds = 'a'", "/* holds */"):
        with pytest.raises(ValueError):
            read_predicate("new", sql)
    with pytest.raises(TypeError, match="halds"):
        read_predicate("new", "/* halds = 'it is' */")
