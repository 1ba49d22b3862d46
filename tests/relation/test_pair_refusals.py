"""What queries about pairs may say, and what is refused because it has no meaning."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from world import World

from semap.errors import InvalidInput
from semap.model.continuous_query import (
    BetweenSamples,
    Certainty,
    Debounce,
    Declaration,
    Side,
    declared,
    options_of,
)
from semap.store.database.connection import one_transaction
from semap.store.relation.queries import add_query, change_query, get_query

TRACK, THING = Side("track"), Side("instance", "Furniture")


def query(predicate: str, subject: Side = TRACK, object_: Side = TRACK, **more: Any) -> Declaration:
    return Declaration(f"{predicate} {subject.kind} {object_.kind}", predicate, subject, object_, **more)


KEPT = [
    query("contains"),
    query("intersects", TRACK, THING),
    query("within_distance", distance_m=2.0, debounce=Debounce(0.2, 0.2, 1.0, 1.0)),
    query("nearest", TRACK, THING, count=3),
    query("nearest", THING, THING, count=1, distance_m=5.0),
    query("on", THING, THING),
    query("in_front_of", THING, TRACK, distance_m=2.0),
    query("facing", angle_rad=0.3, distance_m=4.0),
    query("approaching", THING, TRACK, speed_mps=0.5, distance_m=4.0),
    query(
        "crosses", TRACK, THING, direction="left_to_right", abstraction="Line",
        between_samples=BetweenSamples(10, 5),
    ),
]  # fmt: skip


def test_a_query_about_pairs_says_what_it_was_told(world: World) -> None:
    for declaration in KEPT:
        with one_transaction(world.dsn) as connection:
            made = add_query(connection, world.name, declaration)
            assert get_query(connection, made.query_id).declaration == declaration
            other = replace(declaration, dimensions=2)
            assert change_query(connection, made.query_id, other).declaration == other
        in_pairs = "select in_pairs from semap.continuous_query where query_id = %s"
        assert world.one(in_pairs, made.query_id) is declaration.in_pairs is True
        said = options_of(declaration)
        assert (
            declared(declaration.name, declaration.predicate, declaration.object.concept, said) == declaration
        )


REFUSED = [
    (query("approaching", THING, THING, speed_mps=1.0, distance_m=1.0), "neither approaches"),
    (query("crosses", THING, THING), "only tracks cross"),
    (query("crosses"), "only what stands still is crossed"),
    (query("on", THING, TRACK), "nothing stands on a track"),
    (query("within_distance", distance_m=1.0, certainty=Certainty()), "a probability is that of a position"),
    (
        query("within_distance", distance_m=1.0, between_samples=BetweenSamples()),
        "both sides of a pair may move",
    ),
    (query("nearest", count=1, debounce=Debounce(0.1, 0.1)), "no boundary in metres"),
    (query("crosses", TRACK, THING, debounce=Debounce(0, 0, 1)), "a crossing is a moment"),
    (query("nearest"), "nearest needs a count"),
    (query("facing"), "facing needs an angle"),
    (query("approaching", distance_m=3.0), "approaching needs a speed"),
    (query("approaching", speed_mps=3.0), "approaching needs a distance"),
    (query("contains", count=2), "contains takes no count"),
    (query("intersects", distance_m=2.0), "intersects takes no distance"),
    (query("facing", angle_rad=1.0, direction="left_to_right"), "facing takes no direction"),
    (query("nearest", TRACK, THING, count=1, abstraction="Line"), "only crosses compares lines"),
]


def test_what_has_no_meaning_is_refused(world: World) -> None:
    for declaration, reason in REFUSED:
        with (
            one_transaction(world.dsn) as connection,
            pytest.raises(InvalidInput, match=reason) as refused,
        ):
            add_query(connection, world.name, declaration)
        assert refused.value.remedy
