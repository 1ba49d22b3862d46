"""YAML as values that know where they stand, so that every complaint names file, line and column.

Scalars are resolved as YAML 1.2's core schema does: `no` and `12:30` are texts, 1e3 is a number. No tag
makes an object, and what an alias repeats is limited, so that a small file cannot become a large one.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, TypeAlias
from uuid import UUID

import yaml

from semap.errors import InvalidInput
from semap.formats.refusals import LISTED_AT_MOST, Refusals
from semap.formats.source import utf8

MAX_BYTES = 64 * 1024**2
LARGE_BYTES = 1024**2
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

NO_MAPPING = ("a mapping is needed here", "Write `key: value` pairs, indented below.")
ANY_KEY = "*"

Shape: TypeAlias = dict[str, "Shape | Callable[[Node], object] | None"]
"""A mapping of these keys, or of any; their values have shapes themselves, or are read so, which may raise
InvalidInput. None: whatever there is."""

Scalar: TypeAlias = str | int | float | bool | None


BY_FIRST = {
    first: [(name, pattern) for name, (pattern, firsts) in RESOLVED.items() if first in firsts]
    for first in {each for _, firsts in RESOLVED.values() for each in firsts}
}
"""Kinds of plain scalars, by their first character."""


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Knows only null, bool, int, float and text."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012


for _name, (_pattern, _first) in RESOLVED.items():
    _Loader.add_implicit_resolver(TAG + _name, _pattern, _first)

NUMBERS = re.compile(r"(?<=: )\[[-+.0-9eE, \[\]]*\](?=[,}\s])")
"""Lists of numbers, most of what a large file says."""
WORD = "\ue000"
"""Begins what stands for such a list."""


@dataclass(eq=False, slots=True)
class Node:
    """A value of a YAML file and its place. A large file has millions: nothing is made that nobody asks for.

    value   a scalar, a tuple of nodes, or nodes by key
    source  a scalar as it is written
    file    its name
    mark    where it begins in the file
    keys    of a mapping, where each key begins
    """

    value: Scalar | tuple[Node, ...] | Mapping[str, Node]
    source: str
    file: str
    mark: Any
    keys: Mapping[str, Any] | None = None

    @property
    def where(self) -> str:
        """file:line:column, both from 1"""
        return _where(self.file, self.mark)

    def where_of(self, offset: int) -> str:
        """file:line:column of a character of what is written here on one line"""
        return f"{self.file}:{self.mark.line + 1}:{self.mark.column + 1 + offset}"

    def wrong(self, message: str, remedy: str) -> InvalidInput:
        """The error that something is wrong at this place."""
        return InvalidInput(message, remedy, self.where)

    @property
    def is_missing(self) -> bool:
        """Whether nothing, or null, is written here."""
        return self.value is None

    def mapping(self) -> Mapping[str, Node]:
        """Nodes by key, in the order of the file; nothing is an empty mapping."""
        if self.is_missing:
            return {}
        if not isinstance(self.value, Mapping):
            raise self.wrong(*NO_MAPPING)
        return self.value

    def fields(self, allowed: Iterable[str]) -> Mapping[str, Node]:
        """Nodes by key; those that are null are left out.

        raises  InvalidInput for a key that is not allowed
        """
        names = sorted(allowed)
        for key in self.mapping():
            if key not in names:
                raise _unknown(key, names, _where(self.file, (self.keys or {})[key]))
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


@dataclass(frozen=True)
class UnreadLists:
    """The lists of numbers of a large file of which the rest was read: each is a word of its length there."""

    name: str
    file: str

    def text(self, node: Node) -> str | None:
        """A list as it is written; None where the node is no such word."""
        if not node.source.startswith(WORD):
            return None
        return self.file[node.mark.index : node.mark.index + len(node.source)]

    def read(self, node: Node) -> Node:
        """The list that a word stands for, or the node itself.

        raises  InvalidInput as `parse_yaml` does
        """
        text = self.text(node)
        if text is None:
            return node
        above = "\n" * node.mark.line + " " * node.mark.column  # so that errors name its place
        return _Reading(self.name, above + text).document(None, {})


def parse_yaml(
    data: bytes,
    name: str,
    shape: Shape | None = None,
    needed: Mapping[str, str] = MappingProxyType({}),
    early: Callable[[Node, UnreadLists], None] | None = None,
) -> Node:
    """The one document of a YAML file in UTF-8.

    name    names the file in errors
    shape   what the document is known to be: a large file that is something else is refused where it begins
    needed  keys that the document must have, and the remedy where one is missing
    early   is asked of a large file before its lists of numbers are read, and may raise InvalidInput
    raises  InvalidInput if it is no YAML, is too large, repeats a key, makes objects, or has another shape;
            it lists the first 20 places of keys and values that are wrong
    """
    if len(data) > MAX_BYTES:
        raise InvalidInput(
            f"{len(data)} bytes of YAML", f"Keep it below {MAX_BYTES}; meshes lie beside it.", name
        )
    try:
        text = utf8(data, name)
        if len(data) >= LARGE_BYTES:
            _refuse_large(text, name, shape, needed, early)
        return _Reading(name, text).document(shape, needed)
    except yaml.MarkedYAMLError as error:
        where = name if error.problem_mark is None else _where(name, error.problem_mark)
        raise InvalidInput(
            f"not YAML: {error.problem or error.context}", "Mind the indentation, colons and quotes.", where
        ) from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InvalidInput(f"not YAML: {error}", "Give a YAML file in UTF-8.", name) from error


def _refuse_large(
    text: str,
    name: str,
    shape: Shape | None,
    needed: Mapping[str, str],
    early: Callable[[Node, UnreadLists], None] | None,
) -> None:
    """Refuse most wrong files in a third of the time that reading takes.

    raises  as `parse_yaml` and `early` do; what lists of numbers say is left to these
    """
    if hasattr(_Loader, "raw_parse"):
        _Loader(text).raw_parse()  # in C alone
    if shape is not None and WORD not in text:
        # A list as one word of the same length: every other thing keeps its place.
        words = NUMBERS.sub(_as_word, text)
        root = _Reading(name, words).document(shape, needed)
        if early is not None:
            early(root, UnreadLists(name, text))


def _as_word(found: re.Match[str]) -> str:
    """What stands for a list; a list that says something else as well stays as it is."""
    numbers = found[0]
    return WORD.ljust(len(numbers), "_") if numbers.count("[") == numbers.count("]") else numbers


def _where(name: str, mark: Any) -> str:
    return f"{name}:{mark.line + 1}:{mark.column + 1}"


def _unknown(key: str, names: Sequence[str], where: str) -> InvalidInput:
    near = difflib.get_close_matches(key, names, 1)
    remedy = f"Did you mean `{near[0]}`?" if near else f"The keys here are {', '.join(names)}."
    return InvalidInput(f"there is no key {key!r} here", remedy, where)


class _Reading:
    """Makes nodes from the events of one file, as they come. Wrong keys and values are told together.

    An alias gives the node that is there already, and its weight (how many values it has) is counted.
    """

    def __init__(self, name: str, text: str) -> None:
        self.name = name
        self.text = text
        self.loader = _Loader(text)
        self.known: dict[str, tuple[Node, int] | None] = {}
        self.repeated = 0
        self.refusals = Refusals()
        self.refused = 0

    def document(self, shape: Shape | None, needed: Mapping[str, str]) -> Node:
        try:
            root = self._document(shape)
            for key, remedy in needed.items():
                if key not in root.mapping():
                    self.refusals.add(-1, root.wrong(f"`{key}` is missing", remedy))
            return root
        except InvalidInput as error:
            if self.refused < LISTED_AT_MOST:
                self.refusals.add(len(self.text), error)
            raise
        finally:
            # Rather than what comes behind them, such as a syntax that is wrong.
            self.refusals.raise_if_any(
                "places" if self.refused < LISTED_AT_MOST else "places at least", self.name
            )

    def _document(self, shape: Shape | None) -> Node:
        self._next()  # the beginning of the stream
        if isinstance(self._next(), yaml.StreamEndEvent):
            raise InvalidInput("the file says nothing", "Write at least `map: NAME`.", self.name)
        root, _ = self._node(self._next(), 0, shape)
        self._next()  # the end of the document
        if not isinstance(event := self._next(), yaml.StreamEndEvent):
            raise InvalidInput("a second document", "Give one.", self._at(event))
        return root

    def _next(self) -> Any:
        return self.loader.get_event()

    def _at(self, event: Any) -> str:
        return _where(self.name, event.start_mark)

    def _node(
        self, event: Any, depth: int, shape: Shape | Callable[[Node], object] | None
    ) -> tuple[Node, int]:
        """A node and how many values it has, itself included."""
        kind = type(event)
        if kind is yaml.AliasEvent:
            return self._repeated(event)
        if depth > MAX_DEPTH:
            raise InvalidInput("it is nested too deeply", "Write it out.", self._at(event))
        if event.anchor is not None:
            self.known[event.anchor] = None
        if kind is yaml.ScalarEvent:
            made = Node(self._scalar(event), event.value, self.name, event.start_mark), 1
        elif kind is yaml.MappingStartEvent:
            made = self._mapping(event, depth, shape if isinstance(shape, dict) else None)
        elif not isinstance(shape, dict):
            made = self._sequence(event, depth)
        else:
            raise InvalidInput(*NO_MAPPING, self._at(event))
        if event.anchor is not None:
            self.known[event.anchor] = made
        if shape is not None and kind is not yaml.MappingStartEvent and made[0].value is not None:
            self._check(made[0], shape)
        return made

    def _check(self, node: Node, shape: Shape | Callable[[Node], object]) -> None:
        try:
            node.mapping() if isinstance(shape, dict) else shape(node)
        except InvalidInput as error:
            if isinstance(shape, dict) or WORD not in node.source:
                self._refuse(node.mark, error)

    def _refuse(self, mark: Any, error: InvalidInput) -> None:
        """Go on after an error, unless there are many: then it is another kind of file."""
        self.refusals.add(mark.index, error)
        self.refused += 1
        if self.refused == LISTED_AT_MOST:
            raise error

    def _repeated(self, event: Any) -> tuple[Node, int]:
        if event.anchor not in self.known:
            raise InvalidInput(
                f"there is no anchor &{event.anchor} before", "Define it first.", self._at(event)
            )
        found = self.known[event.anchor]
        if found is None:
            raise InvalidInput(
                "it is nested too deeply, or contains itself", "Write it out.", self._at(event)
            )
        self.repeated += found[1]
        if self.repeated > MAX_REPEATED:
            raise InvalidInput(
                "aliases repeat too much", "Write it out, or use a blueprint.", self._at(event)
            )
        return found

    def _sequence(self, start: Any, depth: int) -> tuple[Node, int]:
        self._refuse_tag(start, "seq")
        parts: list[Node] = []
        weight = 1
        while type(event := self._next()) is not yaml.SequenceEndEvent:
            part, count = self._node(event, depth + 1, None)
            parts.append(part)
            weight += count
        return Node(tuple(parts), "", self.name, start.start_mark), weight

    def _mapping(self, start: Any, depth: int, shape: Shape | None) -> tuple[Node, int]:
        self._refuse_tag(start, "map")
        parts: dict[str, Node] = {}
        keys: dict[str, Any] = {}
        weight = 1
        while type(event := self._next()) is not yaml.MappingEndEvent:
            if type(event) is not yaml.ScalarEvent:
                raise InvalidInput("a key that is not a word", "Write `word: value`.", self._at(event))
            key = event.value
            mark: Any = event.start_mark
            if key in parts and WORD not in key:
                before = _where(self.name, keys[key])
                message = f"the key {key!r} is there twice (before: {before})"
                error = InvalidInput(message, "Remove one, or give it another name.", self._at(event))
                self._refuse(mark, error)
            if shape is not None and key not in shape and ANY_KEY not in shape:
                self._refuse(mark, _unknown(key, sorted(shape), self._at(event)))
            within = None if shape is None else shape.get(key, shape.get(ANY_KEY))
            keys[key] = mark
            parts[key], count = self._node(self._next(), depth + 1, within)
            weight += count
        return Node(parts, "", self.name, start.start_mark, keys), weight

    def _scalar(self, event: Any) -> Scalar:
        text = event.value
        tag = event.tag
        if tag is None and event.implicit[0]:
            kind = "str"
            for name, pattern in BY_FIRST.get(text[:1], ()):
                if pattern.match(text):
                    kind = name
                    break
        else:
            tag = tag or self.loader.resolve(yaml.ScalarNode, text, event.implicit)
            kind = tag.removeprefix(TAG)
        if kind == "str":
            if "\0" in text:
                raise InvalidInput("a text with the character NUL", "Remove it.", self._at(event))
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
            raise InvalidInput(
                f"{text[:40]!r} is no {kind}", "Put texts in quotes.", self._at(event)
            ) from error
        raise InvalidInput(
            f"the tag {tag} is not known", "Write plain values, without tags.", self._at(event)
        )

    def _refuse_tag(self, event: Any, kind: str) -> None:
        if event.tag not in (None, TAG + kind):
            raise InvalidInput(
                f"the tag {event.tag} is not known", "Write plain values, without tags.", self._at(event)
            )
