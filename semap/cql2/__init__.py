"""Filters in the OGC's Common Query Language (CQL2, OGC 21-065r2): read from text or JSON, and checked."""

from semap.cql2.check import Function, Functions, Kind, Kinds, check, check_parts, kind_of
from semap.cql2.expression import (
    Array,
    Call,
    Expression,
    Instant,
    Interval,
    Literal,
    Property,
    Shape,
    parts,
)
from semap.cql2.parse import parse

__all__ = [
    "Array",
    "Call",
    "Expression",
    "Function",
    "Functions",
    "Instant",
    "Interval",
    "Kind",
    "Kinds",
    "Literal",
    "Property",
    "Shape",
    "check",
    "check_parts",
    "kind_of",
    "parse",
    "parts",
]
