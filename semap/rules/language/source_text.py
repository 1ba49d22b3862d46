"""The text of a rule, YAML or JSON, and where each of its clauses stands.

Only what a rule needs of YAML is read: mappings, lists and scalars as YAML 1.2's core schema has them (`on`
and `12:30` are texts). Tags, anchors and keys that are there twice are refused, and so is what is too deep.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import yaml

from semap.errors import InvalidInput

LONGEST = 200_000
DEEPEST = 12
CONSTANTS: Mapping[str, bool | None] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
WHOLE = re.compile(r"[-+]?[0-9]{1,18}\Z")
NUMBER = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]{1,3})?\Z")
IN_TEXT = re.compile(r"(?P<path>.*), line (?P<line>\d+), character (?P<character>\d+)\Z", re.DOTALL)
LINE_AND_COLUMN = re.compile(r"\bline (\d+), column (\d+)")
NEWLINE = "\n"
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


@dataclass(frozen=True)
class Place:
    """Where a value stands, from 0.

    style  of a scalar: its quote, | or >, or nothing; of a mapping or list None
    text   what a scalar says
    """

    line: int
    column: int
    style: str | None = None
    text: str = ""


@dataclass(frozen=True)
class SourceText:
    """What a text says, and the place of each of its values by path, such as define.E or input[0]."""

    text: str
    document: object
    places: Mapping[str, Place]

    def placed(self, error: InvalidInput) -> InvalidInput:
        """The error with the line and column at which it is in the text."""
        message = str(error).removeprefix(f"{error.where}: ")
        return InvalidInput(message, error.remedy, self._where(error.where))

    def _where(self, where: str) -> str:
        """A path, or the path of a text with the line and character in it, as line and column."""
        inside = IN_TEXT.match(where)
        path = inside["path"] if inside else where
        place = self.places.get(_known(path, self.places))
        if place is None:
            return where
        found = f"{path}, " if path else ""
        if inside is None:
            return f"{found}line {place.line + 1}, column {place.column + 1}"
        line, character = int(inside["line"]) - 1, int(inside["character"]) - 1
        at = self._exact(place, line, character)
        if at is not None:
            before = self.text[:at]
            return f"{found}line {before.count(NEWLINE) + 1}, column {len(before) - before.rfind(NEWLINE)}"
        within = f"line {line + 1}, character {character + 1} of the text"
        return f"{found}line {place.line + 1}, column {place.column + 1}: {within}"

    def _exact(self, place: Place, line: int, character: int) -> int | None:
        """Where in the text a character of a scalar is; None if escapes hide it.

        White space may be folded, so that the two agree in all but that.
        """
        said = place.text.split("\n")
        offset = sum(len(each) + 1 for each in said[:line]) + character
        at = self._start_of(place.line) + place.column + (place.style in ("'", '"'))
        if place.style in ("|", ">"):
            at = self._start_of(place.line + 1)
        found = at
        for sign in place.text[: offset + 1]:
            found = at
            if sign.isspace():
                continue
            while self.text[at : at + 1].isspace():
                at += 1
            written = _escaped(sign, place.style)
            if not self.text.startswith(written, at):
                return None
            found, at = at, at + len(written)
        return found if offset < len(place.text) else at

    def _start_of(self, line: int) -> int:
        return sum(len(each) + 1 for each in self.text.split("\n")[:line])


def read_source(text: str) -> SourceText:
    """The document that a text says.

    raises  InvalidInput with the line and column if it is no YAML, or more of YAML than a rule needs
    """
    if len(text) > LONGEST:
        raise InvalidInput(f"a rule of more than {LONGEST} characters", "Make several rules of it.")
    reading = _Reading(text)
    try:
        document = reading.document()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = "" if mark is None else _line_and_column(mark)
        raise InvalidInput(
            f"not YAML: {error.problem or error.context}", "Mind the indentation, colons and quotes.", where
        ) from error
    except yaml.YAMLError as error:
        raise InvalidInput(f"not YAML: {error}", "Give YAML or JSON in UTF-8.") from error
    except UnicodeEncodeError as error:
        raise InvalidInput(
            "a lone surrogate, which is no character", "Give YAML or JSON in UTF-8."
        ) from error
    return SourceText(text, document, reading.places)


def line_and_column(error: InvalidInput) -> tuple[int, int] | None:
    """Where in the text a placed error is, from 1; None if it is about the whole."""
    found = LINE_AND_COLUMN.search(error.where)
    return None if found is None else (int(found[1]), int(found[2]))


def is_text(scalar: str) -> bool:
    """Whether a scalar without quotes is read as a text, not as a number, truth value or null."""
    return scalar not in CONSTANTS and not WHOLE.match(scalar) and not NUMBER.match(scalar)


@dataclass
class _Reading:
    """Makes the document of the parser's events, one after the other."""

    text: str
    places: dict[str, Place] = field(default_factory=dict)

    def document(self) -> object:
        self.events: Iterator[Any] = yaml.parse(self.text, Loader=LOADER)
        found: list[object] = []
        for event in self.events:
            if isinstance(event, yaml.DocumentStartEvent):
                if found:
                    raise InvalidInput(
                        "more than one document", "Give each rule a file.", _line_and_column(event.start_mark)
                    )
                found.append(self._value(next(self.events), "", 0))
        if not found:
            raise InvalidInput("the text is empty", "Write at least input and emit.")
        return found[0]

    def _value(self, event: Any, path: str, depth: int) -> object:
        mark = event.start_mark
        if isinstance(event, yaml.AliasEvent) or event.anchor or event.tag:
            raise InvalidInput(
                "an anchor, alias or tag of YAML",
                "Write plain values, each where it belongs.",
                _line_and_column(mark),
            )
        if depth > DEEPEST:
            raise InvalidInput("it is nested too deeply", "No clause is so deep.", _line_and_column(mark))
        if isinstance(event, yaml.ScalarEvent):
            self.places[path] = Place(mark.line, mark.column, event.style or "", event.value)
            return _resolved(event)
        self.places.setdefault(path, Place(mark.line, mark.column))
        if isinstance(event, yaml.SequenceStartEvent):
            return self._list(path, depth)
        return self._mapping(path, depth)

    def _list(self, path: str, depth: int) -> list[object]:
        found: list[object] = []
        while not isinstance(event := next(self.events), yaml.SequenceEndEvent):
            found.append(self._value(event, f"{path}[{len(found)}]", depth + 1))
        return found

    def _mapping(self, path: str, depth: int) -> dict[str, object]:
        found: dict[str, object] = {}
        while not isinstance(key := next(self.events), yaml.MappingEndEvent):
            mark = key.start_mark
            if not isinstance(key, yaml.ScalarEvent):
                raise InvalidInput("a key that is no word", "Write `word: value`.", _line_and_column(mark))
            inner = f"{path}.{key.value}" if path else key.value
            if key.value in found:
                raise InvalidInput(
                    f"{key.value} is there twice", "Leave one out.", f"{inner}, {_line_and_column(mark)}"
                )
            event = next(self.events)
            if not isinstance(event, yaml.ScalarEvent):
                # a mapping or list is found by its key
                self.places[inner] = Place(mark.line, mark.column)
            found[key.value] = self._value(event, inner, depth + 1)
        return found


def _resolved(event: Any) -> object:
    """A plain scalar is what it looks like; one in quotes or a block is a text."""
    text: str = event.value
    if event.style:
        return text
    if text in CONSTANTS:
        return CONSTANTS[text]
    if WHOLE.match(text):
        return int(text)
    return float(text) if NUMBER.match(text) else text


def _known(path: str, places: Mapping[str, Place]) -> str:
    """The path itself, or the nearest one around it that has a place."""
    while path and path not in places:
        path = re.sub(r"(\.[^.\[]*|\[\d+\]|^[^.\[]+)\Z", "", path) if re.search(r"[.\[]", path) else ""
    return path


def _escaped(text: str, style: str | None) -> str:
    """A text as it stands between quotes of this style."""
    if style == "'":
        return text.replace("'", "''")
    return text.replace("\\", "\\\\").replace('"', '\\"') if style == '"' else text


def _line_and_column(mark: Any) -> str:
    return f"line {mark.line + 1}, column {mark.column + 1}"
