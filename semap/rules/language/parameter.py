"""The values that a ready rule is filled with: what each means, and what it becomes in the text.

A room, a person or a door may be left open: an empty value is any of them, and no condition asks for one.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

from semap.errors import InvalidInput
from semap.rules.language.duration import read_duration, write_duration
from semap.rules.language.source_text import CONSTANTS
from semap.rules.language.words import read_name

Kind: TypeAlias = Literal[
    "query", "state", "name", "room", "person", "door", "duration", "count", "distance_m"
]
LONGEST_NAME = 200


@dataclass(frozen=True)
class Parameter:
    """A value of a template.

    kind       says what it takes, and what a form offers for it
    condition  of one that may be left open: what it asks of a row, with {} for its name
    variable   whose rows are asked; without one, all rows that the rule reads
    """

    name: str
    default: str
    meaning: str
    kind: Kind
    condition: str = ""
    variable: str = ""

    def read(self, value: object) -> str:
        """What stands in the text for a value; of one that may be left open, its condition.

        raises  InvalidInput with the name of the parameter
        """
        if not self.condition:
            return READ[self.kind](value, self.name)
        return "" if value == "" else self.condition.replace("{}", _literal(value, self.name))


def _name(value: object, where: str) -> str:
    """A name that YAML does not take for something else."""
    name = read_name(value, where)
    if name in CONSTANTS:
        raise InvalidInput(f"{name} is no name to YAML", "Choose another name.", where)
    return name


def _duration(value: object, where: str) -> str:
    return write_duration(read_duration(value, where))


def _count(value: object, where: str) -> str:
    text = str(value)
    if not text.isdecimal() or not 0 < len(text) <= 6:
        raise InvalidInput(f"{text!r} is no count", "Write a whole number, such as 4.", where)
    return str(int(text))


def _distance_m(value: object, where: str) -> str:
    text = str(value)
    if not text.replace(".", "", 1).isdecimal() or len(text) > 12 or float(text) <= 0:
        raise InvalidInput(f"{text!r} is no distance", "Write metres above zero, such as 1.5.", where)
    return repr(float(text))


def _literal(value: object, where: str) -> str:
    """A text as CQL2 writes it, within a text of YAML in double quotes."""
    if not isinstance(value, str) or not 0 < len(value) <= LONGEST_NAME:
        raise InvalidInput(
            "a name is needed", "Write it as it is on the map, or leave it empty for any.", where
        )
    quoted = "'" + value.replace("'", "''") + "'"
    return json.dumps(quoted, ensure_ascii=False)[1:-1]


READ: Mapping[Kind, Callable[[object, str], str]] = {
    "query": _name,
    "state": _name,
    "name": _name,
    "duration": _duration,
    "count": _count,
    "distance_m": _distance_m,
}
