"""How large the numbers of a continuous query may be: as its table and the service have it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import get_args

from semap.errors import InvalidInput
from semap.model.continuous_query import Declaration, Direction

LONGEST_NAME = 200
FARTHEST_M = 1e4
FASTEST_MPS = 1e4
MOST = 100
WIDEST_M = 100.0
LONGEST_S = 86_400.0


def require_within_bounds(declaration: Declaration) -> None:
    """raises InvalidInput, also for what is no number"""
    name = declaration.name
    if not name.strip() or len(name) > LONGEST_NAME or "\0" in name:
        raise InvalidInput(
            f"a query has a name of at most {LONGEST_NAME} characters", "Give it another one.", "name"
        )
    if declaration.direction not in (None, *get_args(Direction)):
        raise InvalidInput(
            f"there is no direction {declaration.direction}",
            f"Say {' or '.join(get_args(Direction))}.",
            "direction",
        )
    for what, value, lowest, highest, may_be_lowest in _bounded(declaration):
        if value is None:
            continue
        if not (lowest < value <= highest or (may_be_lowest and value == lowest)):
            beginning = "from" if may_be_lowest else "above"
            end = "below 1" if 0.5 < highest < 1 else f"up to {highest:.5g}"
            raise InvalidInput(f"{what} of {value:g}", f"Give a number {beginning} {lowest:g} and {end}.")


def _bounded(asked: Declaration) -> Iterator[tuple[str, float | None, float, float, bool]]:
    """What each number is, its bounds, and whether the lower one is allowed itself."""
    yield "a distance [m]", asked.distance_m, 0, FARTHEST_M, False
    yield "a count", asked.count, 1, MOST, True
    yield "an angle [rad]", asked.angle_rad, 0, math.pi, False
    yield "a speed [m/s]", asked.speed_mps, 0, FASTEST_MPS, False
    edges = asked.debounce
    yield "a margin to enter [m]", edges.enter_margin_m, 0, WIDEST_M, True
    yield "a margin to leave [m]", edges.leave_margin_m, 0, WIDEST_M, True
    yield "a time to confirm entering [s]", edges.enter_confirm_s, 0, LONGEST_S, True
    yield "a time to confirm leaving [s]", edges.leave_confirm_s, 0, LONGEST_S, True
    if asked.certainty is not None:
        yield "a probability to enter", asked.certainty.enter, 0.5, math.nextafter(1, 0), True
        yield "a probability to leave", asked.certainty.leave, 0, 0.5, False
        yield "a widest deviation [m]", asked.certainty.widest_std_m, 0, WIDEST_M, False
    if asked.between_samples is not None:
        yield "a longest gap [s]", asked.between_samples.longest_gap_s, 0, LONGEST_S, False
        yield "a highest speed [m/s]", asked.between_samples.fastest_mps, 0, FASTEST_MPS, False
