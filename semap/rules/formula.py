"""Formulas of metric temporal logic as values. Bounds, both included, are microseconds from now, or back."""

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


@dataclass(frozen=True)
class Once:
    """At some moment of the window, which lies in the past."""

    inner: Formula
    from_us: int = 0
    to_us: int | None = None


@dataclass(frozen=True)
class Historically:
    """At every moment of the window, which lies in the past."""

    inner: Formula
    from_us: int = 0
    to_us: int | None = None


@dataclass(frozen=True)
class Since:
    """`right` at some moment of the past window, and `left` at every moment after it until now."""

    left: Formula
    right: Formula
    from_us: int = 0
    to_us: int | None = None


@dataclass(frozen=True)
class Previous:
    """At the last moment before now at which a row came, if that lies in the past window."""

    inner: Formula
    from_us: int = 0
    to_us: int | None = None


@dataclass(frozen=True)
class Exists:
    """Some interval of the variable lasts now, with which `inner` is true: atoms in it may ask of that."""

    name: str
    inner: Formula


Future: TypeAlias = Always | Eventually | Until
Past: TypeAlias = Once | Historically | Since | Previous
Formula: TypeAlias = Atom | Constant | Not | And | Or | Exists | Future | Past
