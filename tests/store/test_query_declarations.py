"""What a query asks is the same when it comes back: from the database, and from a map file."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from uuid import UUID

import pytest
from hypothesis import given
from hypothesis import strategies as st

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
from semap.store.map.maps import create_map
from semap.store.relation.queries import add_query, change_query, get_query

TRACKS, CUPS, ROOMS = Side("track"), Side("instance", "Door"), Side("instance", "Room")
CHOSEN = Side("track", None, (UUID(int=5),), {"op": "=", "args": [{"property": "source"}, "camera"]})
KEPT = [
    Declaration("q", "contains", TRACKS, ROOMS),
    Declaration("q", "contains", CUPS, ROOMS, dimensions=2),
    Declaration("q", "covers", ROOMS, Side("track"), debounce=Debounce(0.1, 0.2, 1, 2)),
    Declaration("q", "intersects", CHOSEN, Side("track"), abstraction="FootprintHull"),
    Declaration("q", "within_distance", TRACKS, Side("track"), distance_m=2.0),
    Declaration("q", "nearest", TRACKS, ROOMS, count=3),
    Declaration("q", "nearest", CUPS, Side("track", where=CHOSEN.where), count=1, distance_m=4.0),
    Declaration("q", "on", CUPS, Side("instance", "Furniture")),
    Declaration("q", "in_front_of", Side("instance"), TRACKS, distance_m=3.0),
    Declaration("q", "facing", TRACKS, CUPS, angle_rad=math.radians(15), distance_m=5.0),
    Declaration("q", "facing", CUPS, TRACKS, angle_rad=math.pi),
    Declaration("q", "approaching", CUPS, TRACKS, speed_mps=0.5, distance_m=10.0),
    Declaration("q", "crosses", TRACKS, ROOMS),
    Declaration("q", "crosses", CHOSEN, ROOMS, direction="left_to_right", between_samples=BetweenSamples(5, 10)),
    Declaration("q", "contains", TRACKS, ROOMS, certainty=Certainty(), payload={"who": "subject.name"}),
]  # fmt: skip


@pytest.mark.parametrize(
    "asked", KEPT, ids=lambda each: f"{each.subject.kind} {each.predicate} {each.object.kind}"
)
def test_the_database_gives_back_what_was_declared(database: str, asked: Declaration) -> None:
    with one_transaction(database) as connection:
        create_map(connection, "m")
        made = add_query(connection, "m", asked)
        assert made.declaration == asked
        other = add_query(connection, "m", Declaration("other", "contains", TRACKS, ROOMS))
        assert change_query(connection, other.query_id, replace(asked, name="x")).declaration == replace(
            asked, name="x"
        )
        assert get_query(connection, made.query_id).declaration == asked


kinds = st.sampled_from(["track", "instance"])
wheres = st.none() | st.just({"op": "=", "args": [{"property": "name"}, "x"]})
sides = st.builds(Side, kinds, st.none() | st.just("Room"), st.none() | st.just((UUID(int=1),)), wheres)
positive = st.none() | st.floats(0.001, 3)


@given(
    st.builds(
        Declaration, st.just("q"), st.sampled_from(["contains", "nearest", "crosses"]), sides, sides, positive,
        st.none() | st.integers(1, 100), positive, positive, st.sampled_from([None, "left_to_right", "right_to_left"]),
    )
)  # fmt: skip
def test_a_map_file_gives_back_what_was_declared(asked: Declaration) -> None:
    options = json.loads(json.dumps(options_of(asked)))
    assert declared("q", asked.predicate, asked.object.concept, options) == asked


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"predicate": "nearest"}, "nearest needs a count"),
        ({"predicate": "facing"}, "facing needs an angle"),
        ({"predicate": "approaching", "distance_m": 3.0}, "approaching needs a speed"),
        ({"predicate": "approaching", "speed_mps": 3.0}, "approaching needs a distance"),
        ({"predicate": "approaching", "speed_mps": 1.0, "distance_m": 3.0, "subject": CUPS}, "instance to instance"),
        ({"predicate": "within_distance"}, "within_distance needs a distance"),
        ({"distance_m": 1.0}, "contains takes no distance"),
        ({"direction": "left_to_right"}, "contains takes no direction"),
        ({"predicate": "on", "object": TRACKS}, "on does not relate track to track"),
        ({"predicate": "crosses", "subject": CUPS}, "crosses does not relate instance to instance"),
        ({"predicate": "facing", "angle_rad": 0.0}, "an angle .rad. of 0"),
        ({"name": " "}, "name of at most 200"),
        ({"name": "x" * 201}, "name of at most 200"),
        ({"predicate": "within_distance", "distance_m": math.nan}, "a distance .m. of nan"),
        ({"predicate": "within_distance", "distance_m": 10_001.0}, "a distance .m. of 10001"),
        ({"predicate": "nearest", "count": 101}, "a count of 101"),
        ({"predicate": "approaching", "distance_m": 1.0, "speed_mps": math.inf}, "a speed .m/s. of inf"),
        ({"predicate": "crosses", "direction": "up"}, "no direction up"),
        ({"debounce": Debounce(enter_margin_m=-0.1)}, "a margin to enter .m. of -0.1"),
        ({"debounce": Debounce(leave_confirm_s=1e30)}, "a time to confirm leaving .s. of 1e.30"),
        ({"certainty": Certainty(enter=1.0)}, "a probability to enter of 1"),
        ({"between_samples": BetweenSamples(longest_gap_s=math.nan)}, "a longest gap .s. of nan"),
        ({"between_samples": BetweenSamples(fastest_mps=math.nan)}, "a highest speed .m/s. of nan"),
        ({"abstraction": "BoundingHull"}, "abstraction BoundingHull"),
        ({"predicate": "touches"}, "touches cannot be kept"),
    ],
)  # fmt: skip
def test_what_cannot_be_kept_is_refused_with_the_reason(
    database: str, change: dict[str, object], message: str
) -> None:
    with one_transaction(database) as connection:
        create_map(connection, "m")
        with pytest.raises(InvalidInput, match=message) as refused:
            add_query(connection, "m", replace(Declaration("q", "contains", TRACKS, ROOMS), **change))
        assert refused.value.remedy
