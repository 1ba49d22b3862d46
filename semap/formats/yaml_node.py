"""YAML as values that know where they stand, so that every complaint names file, line and column.

Scalars are resolved as YAML 1.2's core schema does: `no` and `12:30` are texts, 1e3 is a number. No tag
makes an object, and what an alias repeats is limited, so that a small file cannot become a large one.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias
from uuid import UUID

import yaml

from semap.errors import InvalidInput

MAX_BYTES = 64 * 1024**2
MAX_DEPTH = 64
MAX_REPEATED = 100_000
"""How many values aliases may repeat."""

TAG = "tag:yaml.org,2002:"
RESOLVED = {
    "null": (re.compile(r"(?:~|null|Null|NULL|)\Z"), ["~", "n", "N", ""]),
    "bool": (re.compile(r"(?:true|True|TRUE|false|False|FALSE)\Z"), list("tTfF")),
    "int": (re.compile(r"[-+]?[0-9]+\Z"), list("-+0123456789")),
    "float": (
        re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?\Z|[-+]?\.inf\Z|\.nan\Z"),
        list("-+.0123456789"),
    ),
}

Scalar: TypeAlias = str | int | float | bool | None


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Knows only null, bool, int, float and text."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012


for _name, (_pattern, _first) in RESOLVED.items():
    _Loader.add_implicit_resolver(TAG + _name, _pattern, _first)


@dataclass(frozen=True, eq=False)
class Node:
    """A value of a YAML file and its place.

    value   a scalar, a tuple of nodes, or nodes by key
    source  a scalar as it is written
    where   file:line:column, both from 1
    keys    of a mapping, where each key is
    """

    value: Scalar | tuple[Node, ...] | Mapping[str, Node]
    source: str
    where: str
    keys: Mapping[str, str] = field(default_factory=dict)

    def wrong(self, message: str, remedy: str) -> InvalidInput:
        """The error that something is wrong at this place."""
        return InvalidInput(message, remedy, self.where)

    @cached_property
    def is_missing(self) -> bool:
        """Whether nothing, or null, is written here."""
        return self.value is None

    def mapping(self) -> Mapping[str, Node]:
        """Nodes by key, in the order of the file; nothing is an empty mapping."""
        if self.is_missing:
            return {}
        if not isinstance(self.value, Mapping):
            raise self.wrong("a mapping is needed here", "Write `key: value` pairs, indented below.")
        return self.value

    def fields(self, allowed: Iterable[str]) -> Mapping[str, Node]:
        """Nodes by key; those that are null are left out.

        raises  InvalidInput for a key that is not allowed
        """
        names = sorted(allowed)
        for key in self.mapping():
            if key not in names:
                near = difflib.get_close_matches(key, names, 1)
                remedy = f"Did you mean `{near[0]}`?" if near else f"The keys here are {', '.join(names)}."
                raise InvalidInput(f"there is no key {key!r} here", remedy, self.keys[key])
        return {key: node for key, node in self.mapping().items() if not node.is_missing}

    def sequence(self, least: int = 0, most: int | None = None) -> tuple[Node, ...]:
        """The nodes of a list.

        raises  InvalidInput if it is none, or has fewer or more of them
        """
        if not isinstance(self.value, tuple):
            raise self.wrong("a list is needed here", "Write [a, b, ...].")
        if len(self.value) < least or (most is not None and len(self.value) > most):
            wanted = (
                str(least) if least == most else f"{least} or more" if most is None else f"{least} to {most}"
            )
            raise self.wrong(f"a list of {len(self.value)}; {wanted} are needed", f"Give {wanted}.")
        return self.value

    def text(self) -> str:
        """A text that is not empty; a number or a word such as `no` counts as it is written."""
        if isinstance(self.value, tuple | Mapping) or self.is_missing or not self.source:
            raise self.wrong("a text is needed here", "Write a word, or a text in quotes.")
        return self.source

    def texts(self) -> tuple[str, ...]:
        """The texts of a list."""
        return tuple(node.text() for node in self.sequence())

    def number(self) -> float:
        """A finite number."""
        if isinstance(self.value, bool) or not isinstance(self.value, int | float):
            raise self.wrong(f"{self.source or 'this'} is not a number", "Write a number, such as 2.5.")
        try:
            number = float(self.value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self.wrong(f"{self.source} is not finite", "Write a finite number.")
        return number

    def positive(self) -> float:
        """A finite number above zero."""
        number = self.number()
        if number <= 0:
            raise self.wrong(f"{self.source} is not above zero", "Write a number greater than zero.")
        return number

    def numbers(self, least: int, most: int) -> tuple[float, ...]:
        """The finite numbers of a list."""
        return tuple(node.number() for node in self.sequence(least, most))

    def whole(self) -> int:
        """A whole number."""
        if isinstance(self.value, bool) or not isinstance(self.value, int):
            raise self.wrong(f"{self.source or 'this'} is not a whole number", "Write a number, such as 2.")
        return self.value

    def truth(self) -> bool:
        """true or false."""
        if not isinstance(self.value, bool):
            raise self.wrong(f"{self.source or 'this'} is neither true nor false", "Write true or false.")
        return self.value

    def one_of(self, words: Iterable[str]) -> str:
        """One of some words."""
        if self.text() not in words:
            raise self.wrong(f"{self.source!r} is not known here", f"Write one of {', '.join(words)}.")
        return self.source

    def uid(self) -> UUID:
        """A UUID."""
        try:
            return UUID(self.text())
        except ValueError as error:
            raise self.wrong(f"{self.source!r} is not a UUID", "Leave it out, and one is made.") from error

    def json(self) -> Any:
        """The value as JSON has it.

        raises  InvalidInput for a number that is not finite, or a text with the character NUL
        """
        if isinstance(self.value, Mapping):
            return {key: node.json() for key, node in self.value.items()}
        if isinstance(self.value, tuple):
            return [node.json() for node in self.value]
        if isinstance(self.value, float) and not math.isfinite(self.value):
            raise self.wrong(f"{self.source} is not finite", "Write a finite number, or a text in quotes.")
        return self.value


def parse_yaml(data: bytes, name: str) -> Node:
    """The one document of a YAML file in UTF-8.

    name    names the file in errors
    raises  InvalidInput if it is no YAML, is too large, repeats a key, or makes objects
    """
    if len(data) > MAX_BYTES:
        raise InvalidInput(
            f"{len(data)} bytes of YAML", f"Keep it below {MAX_BYTES}; meshes lie beside it.", name
        )
    try:
        text = data.decode("utf-8-sig")
        _refuse_depth(text, name)
        root = yaml.compose(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        where = name if error.problem_mark is None else _where(name, error.problem_mark)
        raise InvalidInput(
            f"not YAML: {error.problem or error.context}", "Mind the indentation, colons and quotes.", where
        ) from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InvalidInput(f"not YAML: {error}", "Give a YAML file in UTF-8.", name) from error
    if root is None:
        raise InvalidInput("the file says nothing", "Write at least `map: NAME`.", name)
    return _Reading(name).node(root, 0)[0]


def _refuse_depth(text: str, name: str) -> None:
    """The composer calls itself for each level, in C, where a stack that is full ends the process."""
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > MAX_DEPTH:
            raise InvalidInput("it is nested too deeply", "Write it out.", _where(name, event.start_mark))


def _where(name: str, mark: Any) -> str:
    return f"{name}:{mark.line + 1}:{mark.column + 1}"


class _Reading:
    """Makes nodes of one file; an alias gives the node that is there already, and its weight is counted."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.known: dict[int, tuple[Node, int]] = {}
        self.open: set[int] = set()
        self.repeated = 0

    def node(self, raw: Any, depth: int) -> tuple[Node, int]:
        """A node and how many values it has, itself included."""
        where = _where(self.name, raw.start_mark)
        if id(raw) in self.known:
            self.repeated += self.known[id(raw)][1]
            if self.repeated > MAX_REPEATED:
                raise InvalidInput("aliases repeat too much", "Write it out, or use a blueprint.", where)
            return self.known[id(raw)]
        if id(raw) in self.open or depth > MAX_DEPTH:
            raise InvalidInput("it is nested too deeply, or contains itself", "Write it out.", where)
        self.open.add(id(raw))
        if isinstance(raw, yaml.MappingNode):
            made = self._mapping(raw, where, depth)
        elif isinstance(raw, yaml.SequenceNode):
            self._refuse_tag(raw, "seq", where)
            parts = [self.node(part, depth + 1) for part in raw.value]
            made = Node(tuple(part for part, _ in parts), "", where), 1 + sum(count for _, count in parts)
        else:
            made = Node(self._scalar(raw, where), raw.value, where), 1
        self.open.remove(id(raw))
        self.known[id(raw)] = made
        return made

    def _mapping(self, raw: Any, where: str, depth: int) -> tuple[Node, int]:
        self._refuse_tag(raw, "map", where)
        parts: dict[str, Node] = {}
        keys: dict[str, str] = {}
        weight = 1
        for key, value in raw.value:
            at = _where(self.name, key.start_mark)
            if not isinstance(key, yaml.ScalarNode):
                raise InvalidInput("a key that is not a word", "Write `word: value`.", at)
            if key.value in parts:
                raise InvalidInput(
                    f"the key {key.value!r} is there twice (before: {keys[key.value]})",
                    "Remove one, or give it another name.",
                    at,
                )
            keys[key.value] = at
            parts[key.value], count = self.node(value, depth + 1)
            weight += count
        return Node(parts, "", where, keys), weight

    def _scalar(self, raw: Any, where: str) -> Scalar:
        kind, text = raw.tag.removeprefix(TAG), raw.value
        if kind == "str":
            if "\0" in text:
                raise InvalidInput("a text with the character NUL", "Remove it.", where)
            return str(text)
        if kind == "null":
            return None
        try:
            if kind == "bool" and RESOLVED["bool"][0].match(text):
                return str(text).lower() == "true"
            if kind == "int":
                return int(text)
            if kind == "float":
                return float(text.replace(".inf", "inf").replace(".nan", "nan"))
        except ValueError as error:
            raise InvalidInput(f"{text[:40]!r} is no {kind}", "Put texts in quotes.", where) from error
        raise InvalidInput(f"the tag {raw.tag} is not known", "Write plain values, without tags.", where)

    def _refuse_tag(self, raw: Any, kind: str, where: str) -> None:
        if raw.tag != TAG + kind:
            raise InvalidInput(f"the tag {raw.tag} is not known", "Write plain values, without tags.", where)
