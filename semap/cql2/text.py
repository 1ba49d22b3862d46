"""The text form of CQL2, read to what its JSON form says: operator precedence climbing over tokens.

From loose to tight: or, and, not, comparisons, + - ||, * / % div, ^, a sign. The time that it takes is in
proportion to the length of the text.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from shapely.geometry import mapping

from semap.errors import InvalidInput

STANDARD = (
    "See OGC 21-065r2 (CQL2): texts in single quotes, TIMESTAMP('2026-01-31T12:00:00Z'), BBOX(0,0,4,3)."
)

TOKEN = re.compile(
    r"""\s+
      | (?P<number>(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)
      | (?P<text>'(?:''|\\'|[^'])*')
      | (?P<quoted>"(?:""|[^"])*")
      | (?P<name>[^\W\d][\w.:]*)
      | (?P<sign><>|<=|>=|\|\||[=<>+\-*/%^(),])""",
    re.VERBOSE,
)
BINARY = {
    "or": 1,
    "and": 2,
    **dict.fromkeys(("=", "<>", "<", "<=", ">", ">="), 4),
    **dict.fromkeys(("+", "-", "||"), 5),
    **dict.fromkeys(("*", "/", "%", "div"), 6),
    "^": 7,
}
NOT, PREDICATE, SIGN = 3, 4, 8
PREDICATES = ("like", "between", "in", "is", "not")
WKT = (
    "point",
    "multipoint",
    "linestring",
    "multilinestring",
    "polygon",
    "multipolygon",
    "geometrycollection",
)
CONSTANTS: dict[str, bool | None] = {"true": True, "false": False, "null": None}
DEEPEST = 60
MOST_DIGITS = 400
"""Of a whole number; one of more is none that a float holds, and takes long to read."""


@dataclass(frozen=True)
class Token:
    """kind: number, text, quoted, name, sign or end; words: its text in lower case."""

    kind: str
    text: str
    start: int

    @property
    def word(self) -> str:
        return self.text.lower() if self.kind in ("name", "sign") else ""


def read_text(source: str, place: str) -> object:
    """What a text says, as CQL2 JSON.

    raises  InvalidInput with the line and character
    """
    reading = _Reading(source, place)
    found = reading.expression(0, 0)
    if reading.next.kind != "end":
        raise reading.refused("something is left over")
    return found


def place_of(source: str, place: str, part: str) -> str:
    """The line and character at which a part begins, or what it stands in.

    source  a text that can be read
    part    as messages call it, such as filter.args[1]
    """
    reading = _Reading(source, place)
    found: Any = reading.expression(0, 0)
    start = reading.start_of(found, 0)
    for step in re.findall(r"\d+", part.removeprefix(place)):
        if isinstance(found, dict):
            found = found.get("args") or found.get("interval") or []
        if not isinstance(found, list) or int(step) >= len(found):
            break
        found = found[int(step)]
        start = reading.start_of(found, start)
    return reading.place_at(start)


def place_in(source: str, start: int, place: str) -> str:
    """The line and character of a text's character, as the reader of the text counts."""
    line = source.count("\n", 0, start) + 1
    character = start - source.rfind("\n", 0, start)
    return f"{place}, line {line}, character {character}"


class _Reading:
    def __init__(self, source: str, place: str) -> None:
        self.source = source
        self.place = place
        self.tokens = self._tokens()
        self.at = 0
        self.starts: list[tuple[object, int]] = []

    def _tokens(self) -> list[Token]:
        found: list[Token] = []
        start = 0
        while start < len(self.source):
            match = TOKEN.match(self.source, start)
            if match is None:
                raise self._refused_at(start, "there is no such sign, or a quote is not closed")
            if match.lastgroup is not None:
                found.append(Token(match.lastgroup, match[0], start))
            start = match.end()
        return [*found, Token("end", "", len(self.source))]

    @property
    def next(self) -> Token:
        return self.tokens[self.at]

    def take(self, word: str = "") -> Token:
        token = self.next
        if word and token.word != word:
            raise self.refused(f"{word.upper()} is missing")
        self.at += token.kind != "end"
        return token

    def takes(self, word: str) -> bool:
        found = self.next.word == word
        self.at += found
        return found

    def refused(self, message: str) -> InvalidInput:
        return self._refused_at(self.next.start, message)

    def _refused_at(self, start: int, message: str) -> InvalidInput:
        return InvalidInput(f"it is no CQL2 text: {message}", STANDARD, self.place_at(start))

    def place_at(self, start: int) -> str:
        return place_in(self.source, start, self.place)

    def start_of(self, part: object, otherwise: int) -> int:
        """Where a part of what was read begins."""
        return next((start for known, start in self.starts if known is part), otherwise)

    def expression(self, tightness: int, depth: int) -> object:
        """What binds tighter than `tightness` from here on."""
        if depth > DEEPEST:
            raise self.refused(f"more than {DEEPEST} levels")
        start = self.next.start
        left = self.operand(depth)
        while True:
            if isinstance(left, dict | list):
                self.starts.append((left, start))
            word = self.next.word
            if word in PREDICATES and tightness < PREDICATE:
                left = self.predicate(left, depth)
            elif BINARY.get(word, 0) > tightness:
                self.take()
                right = self.expression(BINARY[word], depth + 1)
                left = _joined(word, left, right)
            else:
                return left

    def operand(self, depth: int) -> object:
        token = self.next
        if token.word == "not":
            self.take()
            return {"op": "not", "args": [self.expression(NOT - 1, depth + 1)]}
        if token.word in ("-", "+"):
            self.take()
            inner = self.expression(SIGN, depth + 1)
            if token.word == "+":
                return inner
            return -inner if isinstance(inner, int | float) else {"op": "*", "args": [-1, inner]}
        if token.word == "(":
            return self.parenthesis(depth)
        if token.kind == "name":
            return self.named(depth)
        self.take()
        if token.kind == "number":
            is_int = token.text.isdecimal() and len(token.text) <= MOST_DIGITS
            return int(token.text) if is_int else float(token.text)
        if token.kind == "text":
            return _unquoted(token)
        if token.kind == "quoted":
            return {"property": _unquoted(token)}
        self.at -= token.kind != "end"
        raise self.refused("a value is missing")

    def parenthesis(self, depth: int) -> object:
        """Something in parentheses, or a list."""
        self.take("(")
        if self.takes(")"):
            return []
        found = self.expression(0, depth + 1)
        if self.next.word != ",":
            self.take(")")
            return found
        return [found, *self.rest(depth)]

    def rest(self, depth: int) -> list[object]:
        found = []
        while self.takes(","):
            found.append(self.expression(0, depth + 1))
        self.take(")")
        return found

    def lists(self, depth: int) -> list[object]:
        """What functions of lists are given: there ('a') is a list of one."""
        found: list[object] = []
        while not found or self.takes(","):
            if self.takes("("):
                found.append([] if self.takes(")") else [self.expression(0, depth + 1), *self.rest(depth)])
            else:
                found.append(self.expression(0, depth + 1))
        self.take(")")
        return found

    def named(self, depth: int) -> object:
        """A constant, a shape, a function, or a property."""
        token = self.take()
        if token.word in CONSTANTS:
            return CONSTANTS[token.word]
        following = self.next.word
        if token.word in WKT and following in ("(", "z", "m", "zm", "empty"):
            return self.shape(token)
        if following != "(":
            return {"property": token.text}
        self.take()
        if token.word.startswith("a_"):
            return {"op": token.text, "args": self.lists(depth)}
        args = [] if self.takes(")") else [self.expression(0, depth + 1), *self.rest(depth)]
        match token.word, args:
            case ("timestamp" | "date", [str(value)]):
                return {token.word: value}
            case "interval", [_, _]:
                return {"interval": args}
            case "bbox", _:
                return {"bbox": args}
        return {"op": token.text, "args": args}

    def shape(self, first: Token) -> object:
        open_, start = 0, first.start
        while self.next.kind != "end":
            token = self.take()
            open_ += (token.word == "(") - (token.word == ")")
            if open_ == 0 and token.word in (")", "empty"):
                try:
                    with np.errstate(over="ignore"):  # what is not finite is refused where shapes are checked
                        read = shapely.from_wkt(self.source[start : token.start + len(token.text)])
                except shapely.errors.GEOSException as error:
                    raise self._refused_at(start, "the shape is no WKT") from error
                return mapping(read)
        raise self.refused("the shape does not end")

    def predicate(self, left: object, depth: int) -> object:
        """What like, between, in and is say of what stands before them."""
        is_not = self.takes("not")
        word = self.next.word
        if word not in PREDICATES or word == "not" or (is_not and word == "is"):
            raise self.refused("LIKE, BETWEEN or IN is missing")
        self.take()
        found: dict[str, object]
        if word == "is":
            is_not = self.takes("not")
            self.take("null")
            found = {"op": "isNull", "args": [left]}
        elif word == "between":
            low = self.expression(PREDICATE, depth + 1)
            self.take("and")
            found = {"op": "between", "args": [left, low, self.expression(PREDICATE, depth + 1)]}
        elif word == "in":
            self.take("(")
            items = [] if self.takes(")") else [self.expression(0, depth + 1), *self.rest(depth)]
            found = {"op": "in", "args": [left, items]}
        else:
            found = {"op": "like", "args": [left, self.expression(PREDICATE, depth + 1)]}
        return {"op": "not", "args": [found]} if is_not else found


def _joined(word: str, left: object, right: object) -> object:
    """`a and b and c` is one `and` of three."""
    match word, left:
        case ("and" | "or", {"op": op, "args": list(args)}) if op == word:
            return {"op": word, "args": [*args, right]}
    return {"op": word, "args": [left, right]}


def _unquoted(token: Token) -> str:
    inner = token.text[1:-1]
    return inner.replace("''", "'").replace("\\'", "'") if token.kind == "text" else inner.replace('""', '"')
