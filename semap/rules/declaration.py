"""What a rule says.

The first form of a rule names a continuous query and the events for both edges of its relations:

    name: room_visits
    input: track_in_room
    emit: {began: entered, ended: left}
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from semap.errors import InvalidInput

NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]{0,99}\Z")
CLAUSES = ("name", "input", "emit")
EDGES = ("began", "ended")


@dataclass(frozen=True)
class Declaration:
    """One declaration gives the events of both edges; an edge without a name gives none."""

    name: str
    input: str
    began: str | None
    ended: str | None

    def as_json(self) -> dict[str, object]:
        """What is stored of it beside its name."""
        emit = {edge: getattr(self, edge) for edge in EDGES if getattr(self, edge) is not None}
        return {"input": self.input, "emit": emit}


def parse_declaration(document: object, name: str | None = None) -> Declaration:
    """Read a declaration from parsed YAML or JSON; `name` stands in for a missing clause `name`.

    raises InvalidInput naming the clause
    """
    if not isinstance(document, Mapping):
        raise InvalidInput("a rule is a mapping of clauses", f"Its clauses are {', '.join(CLAUSES)}.")
    for clause in document:
        if clause not in CLAUSES:
            raise InvalidInput(
                "there is no such clause", f"The clauses are {', '.join(CLAUSES)}.", str(clause)
            )
    emit = document.get("emit")
    if not isinstance(emit, Mapping) or not emit:
        raise InvalidInput(
            "names of events for began, ended or both are needed",
            "For example: emit: {began: entered, ended: left}",
            "emit",
        )
    for edge in emit:
        if edge not in EDGES:
            raise InvalidInput("there is no such edge", "The edges are began and ended.", f"emit.{edge}")
    return Declaration(
        name=_name(document.get("name", name), "name"),
        input=_name(document.get("input"), "input"),
        began=_name(emit["began"], "emit.began") if "began" in emit else None,
        ended=_name(emit["ended"], "emit.ended") if "ended" in emit else None,
    )


def _name(value: object, where: str) -> str:
    if not isinstance(value, str) or not NAME.match(value):
        raise InvalidInput(
            "a name is needed", "Use up to 100 letters, digits, _, - and . beginning with a letter.", where
        )
    return value
