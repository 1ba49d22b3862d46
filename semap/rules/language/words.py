"""The names and reserved words of the rule language, and what was probably meant by one that is not known."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

from semap.errors import InvalidInput
from semap.rules.interval.allen import NAMES
from semap.rules.row import PROPERTIES

NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]{0,99}\Z")
"""Of rules, inputs and types of events."""

IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,99}\Z")

OF_PATTERNS = frozenset({"next", "followed", "by", "any", "not", "permute", "relaxed", "until"})
OF_FORMULAS = frozenset(
    {"not", "and", "or", "implies", "always", "eventually", "until", "true", "false", "inf"}
    | {"once", "historically", "since", "previous", "exists", "forall"}
)
OF_WINDOWS = frozenset({"match", "step"})
RESERVED = OF_PATTERNS | OF_FORMULAS | OF_WINDOWS | frozenset(PROPERTIES)
"""What no variable may be called. Relations of intervals are reserved too, in any case (`is_relation`)."""


def is_relation(word: str) -> bool:
    """Whether it is one of Allen's relations, or `intersects`."""
    return word.lower() in NAMES


def read_name(value: object, where: str) -> str:
    """The name of a rule, an input or an event.

    raises  InvalidInput with the place
    """
    if not isinstance(value, str) or not NAME.match(value):
        raise InvalidInput(
            "a name is needed", "Use up to 100 letters, digits, _, - and . beginning with a letter.", where
        )
    return value


def read_identifier(value: object, where: str) -> str:
    """The name of a variable or measure, which may stand in a condition before or after a dot.

    raises  InvalidInput with the place
    """
    if not isinstance(value, str) or not IDENTIFIER.match(value):
        raise InvalidInput(
            f"{value!r} is no name", "Use up to 100 letters, digits and _ beginning with a letter.", where
        )
    return value


def read_variable(given: object, where: str) -> str:
    """The name of a variable.

    raises  InvalidInput with the place, also for a word that is reserved
    """
    value = read_identifier(given, where)
    if value in RESERVED or is_relation(value):
        raise InvalidInput(
            f"the word {value} means something already",
            f"Call the variable something else, such as {value[0].upper()}1.",
            where,
        )
    return value


def unknown(message: str, word: str, known: Iterable[str], where: str) -> InvalidInput:
    """The error that a word is none of those known, with the one that was probably meant."""
    words = list(known)
    near = difflib.get_close_matches(word, words, n=1, cutoff=0.6)
    hint = f"Did you mean {near[0]}? " if near else ""
    return InvalidInput(message, f"{hint}Known here: {', '.join(words) or 'nothing'}.", where)
