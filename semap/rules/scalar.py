"""Functions of values that conditions and measures may use beside CQL2's operators; of null they are null."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from semap.cql2 import Function, Functions, Kind
from semap.cql2.value import lower

NUMBER: tuple[Kind, ...] = ("number",)
TEXT: tuple[Kind, ...] = ("text",)


def _of_known(function: Callable[..., Any]) -> Callable[..., Any]:
    return lambda *given: None if None in given else function(*given)


def _rounded(number: float) -> float:
    """Halves away from zero, as SQL rounds."""
    return math.copysign(math.floor(abs(number) + 0.5), number)


OF_NUMBERS: Mapping[str, Callable[[float], float]] = {
    "abs": abs,
    "floor": math.floor,
    "ceil": math.ceil,
    "round": _rounded,
}
FUNCTIONS: Functions = {
    **dict.fromkeys(OF_NUMBERS, Function((NUMBER,), "number")),
    **dict.fromkeys(("lower", "upper"), Function((TEXT,), "text")),
    "length": Function((TEXT,), "number"),
    "||": Function((TEXT, TEXT), "text"),
}
CALLED: Mapping[str, Callable[..., Any]] = {
    **{name: _of_known(function) for name, function in OF_NUMBERS.items()},
    "lower": lower,
    "upper": _of_known(str.upper),
    "length": _of_known(len),
    "||": _of_known(lambda a, b: a + b),
}
"""What each of them does; `_NAME` is what code calls it (`||` is no name)."""

CODE_NAMES: Mapping[str, str] = {name: f"scalar_{number}" for number, name in enumerate(CALLED)}
