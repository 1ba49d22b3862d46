"""A rule's clauses in the form in which they are stored: JSON that the database takes, not too much of it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from semap.errors import InvalidInput
from semap.rules.language.source_text import DEEPEST, LONGEST

LONGEST_KEY = 1_000
MOST_VALUES = 5_000
LARGEST = 1e300
NO_CHARACTER = re.compile("[\0\ud800-\udfff]")


def stored_form(document: Mapping[str, object]) -> dict[str, object]:
    """The same in dictionaries, lists, texts, numbers, true, false and null.

    raises  InvalidInput with the path of what is too much, or what JSON or the database has no form for
    """
    return _Form().mapping(document, "", 0)


class _Form:
    """Counts what there is, in all."""

    def __init__(self) -> None:
        self.values = 0
        self.characters = 0

    def mapping(self, value: Mapping[Any, object], where: str, depth: int) -> dict[str, object]:
        found = {}
        for key, each in value.items():
            if not isinstance(key, str):
                raise InvalidInput(f"the key {key!r} is no text", "Put it in quotes.", where)
            if len(key) > LONGEST_KEY:
                raise InvalidInput(f"a key of more than {LONGEST_KEY} characters", "Shorten it.", where)
            inner = f"{where}.{key}" if where else key
            found[self.text(key, where)] = self.value(each, inner, depth + 1)
        return found

    def value(self, value: object, where: str, depth: int) -> object:
        self.values += 1
        if depth > DEEPEST:
            raise InvalidInput("it is nested too deeply", "No clause is so deep.", where)
        if self.values > MOST_VALUES:
            raise InvalidInput(f"more than {MOST_VALUES} values", "Make several rules of it.", where)
        match value:
            case None | bool():
                return value
            case str():
                return self.text(value, where)
            case int() | float():
                if not math.isfinite(value) if isinstance(value, float) else abs(value) > LARGEST:
                    raise InvalidInput("a number that is not finite, or too large", "Write another.", where)
                return value
            case Mapping():
                return self.mapping(value, where, depth)
            case bytes() | bytearray():
                pass
            case Sequence():
                return [self.value(each, f"{where}[{n}]", depth + 1) for n, each in enumerate(value)]
        raise InvalidInput(
            f"a value of the kind {type(value).__name__}", "Write it as a text or number.", where
        )

    def text(self, text: str, where: str) -> str:
        self.characters += len(text)
        if self.characters > LONGEST:
            raise InvalidInput(f"more than {LONGEST} characters", "Make several rules of it.", where)
        if NO_CHARACTER.search(text):
            raise InvalidInput(
                "a character that no text may hold", "Leave out NUL and lone surrogates.", where
            )
        return text
