"""Whatever is played with pairs, `semap doctor --verify` finds nothing wrong with them."""

from __future__ import annotations

import random

from hypothesis import given, note
from hypothesis import strategies as st
from pair_oracle import Question
from pair_town import Town
from test_pairs import QUICK, play, questions


@QUICK
@given(asked=questions(), seed=st.integers(0, 2**32))
def test_what_was_played_is_right(database: str, asked: Question, seed: int) -> None:
    note(f"{asked} {seed}")
    town = Town(database, asked)
    try:
        play(town, random.Random(seed), 25)
        assert town.differences() == []
    finally:
        town.close()
