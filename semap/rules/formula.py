"""Formulas of metric temporal logic as values. Bounds are microseconds from now, both included."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True)
class Atom:
    """True while some interval of the variable holds."""

    name: str


@dataclass(frozen=True)
class Constant:
    value: bool


@dataclass(frozen=True)
class Not:
    inner: Formula


@dataclass(frozen=True)
class And:
    parts: tuple[Formula, ...]


@dataclass(frozen=True)
class Or:
    parts: tuple[Formula, ...]


@dataclass(frozen=True)
class Always:
    """At every moment of the window; `to_us` None is for ever."""

    inner: Formula
    from_us: int = 0
    to_us: int | None = None


@dataclass(frozen=True)
class Eventually:
    """At some moment of the window."""

    inner: Formula
    from_us: int = 0
    to_us: int | None = None


@dataclass(frozen=True)
class Until:
    """`right` at some moment of the window, and `left` at every moment from now until just before it."""

    left: Formula
    right: Formula
    from_us: int = 0
    to_us: int | None = None


Formula: TypeAlias = Atom | Constant | Not | And | Or | Always | Eventually | Until
