"""A case of the corpus: a pattern, the rows of one key, and what matches. How they are written: README.md."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from semap.rules.bound import NO_VARIABLE
from semap.rules.declaration import Declaration, RowPattern
from semap.rules.language.reading import parse_declaration
from semap.rules.pattern import Node
from semap.rules.program import Match
from semap.rules.row import RANKS, Row

CORPUS = Path(__file__).parent / "corpus"
SECOND_US = 1_000_000
ROW = re.compile(r"(?P<type>[a-z]+)(?::(?P<occupants>-?[\d.]+))?(?:@(?P<stamp_s>[\d.]+))?")
BOUND = re.compile(r"(?P<variable>[A-Za-z_]+?)(?P<number>\d+)")
CLAUSES = ("pattern", "subset", "define", "measures", "rows_per_match", "within", "after_match")
ABOUT = ("title", "source", "rows", "matches", "timeouts", "unmatched", "values", "flink")
EMPTY = re.compile(r"\(\)(?P<number>\d+)")

Pairs = tuple[tuple[int, str], ...]
"""The rows of a match, counted from 1, each with its variable."""


@dataclass(frozen=True)
class Found:
    """A match or a partial match that timed out, and when, if that is said."""

    pairs: Pairs
    stamp_us: int | None = None


@dataclass(frozen=True)
class Differing:
    """What Flink finds instead, or that it refuses (None), and why."""

    pairs: tuple[Pairs, ...] | None
    because: str


@dataclass(frozen=True)
class Case:
    """Expected matches are all there are; what may be None likewise, where it is asked for.

    unmatched  rows that are in no match
    values     of the measures, for each match
    """

    name: str
    title: str
    source: str
    declaration: Declaration
    rows: tuple[Row, ...]
    matches: tuple[Found, ...]
    timeouts: tuple[Found, ...] | None = None
    flink: Mapping[str, Differing] = field(default_factory=dict)
    unmatched: tuple[int, ...] | None = None
    values: tuple[tuple[object, ...], ...] | None = None

    @property
    def pattern(self) -> Node:
        assert isinstance(self.declaration.body, RowPattern)
        return self.declaration.body.node


def read_rows(text: str) -> tuple[Row, ...]:
    """`a b:7 c@2.5`: types, the occupants after a colon, the stamp [s] after @ (else a second after the former)."""
    rows: list[Row] = []
    for number, word in enumerate(text.split(), start=1):
        parts = ROW.fullmatch(word)
        assert parts, f"{word} is no row"
        before_us = rows[-1].stamp_us if rows else -SECOND_US
        stamp_us = round(float(parts["stamp_s"]) * SECOND_US) if parts["stamp_s"] else before_us + SECOND_US
        values: dict[str, object] = {"type": parts["type"], "stamp": stamp_us}
        if parts["occupants"]:
            values["occupants"] = float(parts["occupants"])
        rows.append(Row(stamp_us, RANKS["relation"], f"{number:04}", "relation", values))
    return tuple(rows)


def pairs_of(match: Match) -> Pairs:
    return tuple((int(row.uid), variable) for variable, row in match.rows)


def read_pairs(text: str) -> Pairs:
    """`A1 B3`: row 1 is bound to A, row 3 to B; `()3`: at row 3 stands a match that binds none."""
    empty = EMPTY.fullmatch(text.strip())
    if empty:
        return ((int(empty["number"]), NO_VARIABLE),)
    found = [BOUND.fullmatch(word) for word in text.split()]
    assert all(found), f"{text} names no rows"
    return tuple((int(part["number"]), part["variable"]) for part in found if part)


def _read_found(text: str) -> Found:
    pairs, _, stamp_s = str(text).partition("@")
    return Found(read_pairs(pairs), round(float(stamp_s) * SECOND_US) if stamp_s else None)


def declare(document: Mapping[str, Any], timeouts: bool = False, unmatched: bool = False) -> Declaration:
    """The rule of these clauses; a variable X of one letter stands for rows of type x if it says nothing else."""
    emit = {"match": "found", "empty": "found"}
    emit |= {"timeout": "timed_out"} if timeouts else {}
    emit |= {"unmatched": "unmatched"} if unmatched else {}
    letters = set(re.findall(r"\b[A-Z]\b", document["pattern"]))
    define = {name: f"type = '{name.lower()}'" for name in sorted(letters)} | (document.get("define") or {})
    define = {name: text for name, text in define.items() if text is not None}
    clauses = {name: document[name] for name in CLAUSES if name in document and name != "define"}
    if define:
        clauses["define"] = define
    return parse_declaration({"input": "moves", **clauses, "emit": emit}, "case")


def _read_case(name: str, document: Mapping[str, Any]) -> Case:
    unknown = document.keys() - {*CLAUSES, *ABOUT}
    assert not unknown, f"{name}: {unknown}"
    timeouts, unmatched, values = (document.get(name) for name in ("timeouts", "unmatched", "values"))
    flink = {
        family: Differing(
            None if said.get("matches") is None else tuple(read_pairs(text) for text in said["matches"]),
            said["because"],
        )
        for families, said in (document.get("flink") or {}).items()
        for family in (("sql", "cep") if families == "both" else (families,))
    }
    return Case(
        name=name,
        title=document["title"],
        source=document["source"],
        declaration=declare(document, timeouts is not None, unmatched is not None),
        rows=read_rows(document["rows"]),
        matches=tuple(map(_read_found, document["matches"])),
        timeouts=None if timeouts is None else tuple(map(_read_found, timeouts)),
        flink=flink,
        unmatched=None if unmatched is None else tuple(unmatched),
        values=None if values is None else tuple(map(tuple, values)),
    )


def read_corpus() -> tuple[Case, ...]:
    """All cases. What a file says beside its cases holds for each of them that does not say it itself."""
    cases = []
    for path in sorted(CORPUS.glob("*.yaml")):
        shared = yaml.safe_load(path.read_text())
        shared.pop("reasons", None)
        documents = [
            {**shared, **document, **stream}
            for document in shared.pop("cases")
            for stream in document.pop("streams", [{}])
        ]
        cases += [
            _read_case(f"{path.stem}-{n:03}", document) for n, document in enumerate(documents, start=1)
        ]
    return tuple(cases)
