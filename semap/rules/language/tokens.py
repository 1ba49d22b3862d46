"""The words and signs of a pattern or formula, read one after the other."""

from __future__ import annotations

import re
from dataclasses import dataclass

from semap.cql2.text import place_in
from semap.errors import InvalidInput

TOKEN = re.compile(
    r"\s+ | (?P<number>\d+(?:\.\d*)?|\.\d+) | (?P<word>[A-Za-z_][A-Za-z0-9_]*)"
    r" | (?P<sign>\{-|-\}|[?*+{}|(),\[\]^$])",
    re.VERBOSE | re.ASCII,
)
LONGEST = 4_000
DEEPEST = 40


@dataclass(frozen=True)
class Token:
    """kind: number, word, sign or end; `start` counts characters of the text."""

    kind: str
    text: str
    start: int


class Tokens:
    """A text and how far it has been read; mutable.

    place   of the text, for messages
    remedy  of every message, unless it has its own
    raises  InvalidInput with the line and character
    """

    def __init__(self, source: object, place: str, remedy: str) -> None:
        self.place = place
        self.remedy = remedy
        if not isinstance(source, str):
            raise InvalidInput("a text is needed", remedy, place)
        if len(source) > LONGEST:
            raise InvalidInput(f"more than {LONGEST} characters", "Ask for less.", place)
        self.source = source
        self.all = self._split()
        self.at = 0
        self.depth = 0

    def _split(self) -> list[Token]:
        found: list[Token] = []
        start = 0
        while start < len(self.source):
            match = TOKEN.match(self.source, start)
            if match is None:
                raise self._refused_at(start, f"{self.source[start]!r} means nothing here", self.remedy)
            if match.lastgroup is not None:
                found.append(Token(match.lastgroup, match[0], start))
            start = match.end()
        return [*found, Token("end", "", len(self.source))]

    @property
    def next(self) -> Token:
        return self.all[self.at]

    def take(self) -> Token:
        token = self.next
        self.at += token.kind != "end"
        return token

    def takes(self, word: str) -> bool:
        """Take a word or sign if it comes next."""
        found = self.next.text == word
        self.at += found
        return found

    def need(self, word: str) -> None:
        """Take a word or sign that has to come next."""
        if not self.takes(word):
            raise self.refused(f"{word} is missing")

    def end(self) -> None:
        """Nothing may be left."""
        if self.next.kind != "end":
            raise self.refused(f"{self.next.text!r} is left over")

    def deeper(self) -> None:
        self.depth += 1
        if self.depth > DEEPEST:
            raise self.refused(f"more than {DEEPEST} levels", "Ask for less.")

    def less_deep(self) -> None:
        self.depth -= 1

    def refused(self, message: str, remedy: str = "", token: Token | None = None) -> InvalidInput:
        """The error that something is wrong at a token, which is the next unless another is given."""
        return self._refused_at((token or self.next).start, message, remedy or self.remedy)

    def where(self, token: Token) -> str:
        """The place of a token, as the reader of the file counts."""
        return place_in(self.source, token.start, self.place)

    def _refused_at(self, start: int, message: str, remedy: str) -> InvalidInput:
        return InvalidInput(message, remedy, self.where(Token("", "", start)))
