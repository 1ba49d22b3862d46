"""Waiting for what others do: nowhere else do tests let time pass, and none asks how much did.

A look is repeated until it finds what it is for, however busy the machine is; the limit is there to end a run that hangs.
"""

import time
from collections.abc import Callable
from random import Random
from threading import Event

PATIENCE_S = 120.0


def until(
    happens: Callable[[], object],
    otherwise: Callable[[], object] = lambda: "",
    patience_s: float = PATIENCE_S,
) -> None:
    """Look until it happens; `otherwise` says what was there instead, or raises."""
    deadline_s = time.monotonic() + patience_s
    while not happens():
        said = otherwise()
        assert time.monotonic() < deadline_s, said
        moment()


def moment() -> None:
    """Between two looks."""
    Event().wait(0.01)


def any_moment(dice: Random, least_s: float, most_s: float) -> None:
    """Until a moment that nobody foresees, at which something is killed: the only wait that has a length."""
    Event().wait(dice.uniform(least_s, most_s))
