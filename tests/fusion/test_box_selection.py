from __future__ import annotations

from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st
from semap_ingest.fusion import selection
from semap_ingest.fusion.selection import Choice, best_disjoint

LISTS = st.lists(
    st.lists(
        st.tuples(st.integers(-3, 20), st.sets(st.integers(0, 6), min_size=1, max_size=2)), max_size=4
    ).map(
        lambda own: [
            Choice(float(gain), sum(1 << thing for thing in things), place)
            for place, (gain, things) in enumerate(own)
        ]
    ),
    max_size=5,
)


def gain_of(choices: list[list[Choice]], taken: list[int | None]) -> float:
    """Fails if a thing is taken twice."""
    chosen = [own[place] for own, place in zip(choices, taken, strict=True) if place is not None]
    things = 0
    for choice in chosen:
        assert not things & choice.things
        things |= choice.things
    return sum(choice.gain for choice in chosen)


def best_gain(choices: list[list[Choice]]) -> float:
    best = 0.0
    for combination in product(*([None, *range(len(own))] for own in choices)):
        try:
            best = max(best, gain_of(choices, list(combination)))
        except AssertionError:
            continue
    return best


@given(LISTS)
def test_the_sum_of_gains_is_that_of_trying_everything(choices: list[list[Choice]]) -> None:
    assert gain_of(choices, best_disjoint(choices)) == best_gain(choices)


@given(LISTS)
def test_without_time_to_search_nothing_is_taken_twice(choices: list[list[Choice]]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(selection, "MAX_STEPS", 1)
        taken = best_disjoint(choices)
    assert gain_of(choices, taken) >= max((each.gain for own in choices for each in own), default=0.0)


def test_who_wants_nothing_gets_nothing() -> None:
    assert best_disjoint([]) == []
    assert best_disjoint([[], [Choice(-1.0, 1, 0)]]) == [None, None]


def test_the_greatest_wish_yields_to_a_greater_sum() -> None:
    first = [Choice(10.0, 0b01, 0), Choice(9.0, 0b10, 1)]
    second = [Choice(8.0, 0b01, 0)]
    assert best_disjoint([first, second]) == [1, 0]
