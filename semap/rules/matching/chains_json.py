"""Sets of chains as JSON: each row and each part that sets share once, by number."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias, cast

from semap.rules.matching.automaton import Automaton, Outlook
from semap.rules.matching.chains import Chains, Link, Union, joined
from semap.rules.matching.state_json import RowTable, dump_label, load_label
from semap.rules.row import Row
from semap.rules.row_json import load_row

Placed: TypeAlias = tuple[Sequence[Outlook], Chains]
"""Chains, and the outlooks of their runs."""


def dump_chains(placed: Iterable[Placed], made: Iterable[Chains], firsts: Sequence[Row]) -> object:
    """Of sets all of whose chains begin with one of these rows; their numbers are the places of these.

    made  all parts of the sets, each after those that it is made of
    """
    rows = RowTable()
    begun = [rows.number(row) for row in firsts]
    numbers: dict[int, int] = {}
    parts: list[list[object]] = []
    for each in made:
        numbers[id(each)] = len(parts)
        if isinstance(each, Union):
            parts.append([numbers[id(each.left)], numbers[id(each.right)]])
        else:
            before = each.newest if each.before is None else numbers[id(each.before)]
            parts.append([dump_label(each.variable), rows.number(each.row), each.before is None, before])
    places = [
        [[[choice.number for choice in outlook.choices] for outlook in outlooks], numbers[id(chains)]]
        for outlooks, chains in placed
    ]
    return {"rows": rows.rows, "firsts": begun, "parts": parts, "places": places}


def load_chains(document: object, automaton: Automaton) -> tuple[list[Placed], list[Chains], list[Row]]:
    """The sets, their parts and the rows that `dump_chains` wrote."""
    stored = cast(Mapping[str, Any], document)
    rows = [load_row(row) for row in stored["rows"]]
    parts: list[Chains] = []
    for fields in stored["parts"]:
        if len(fields) == 2:
            parts.append(joined(parts[fields[0]], parts[fields[1]]))
            continue
        label, row, is_first, before = fields
        link = (None, before) if is_first else (parts[before], parts[before].newest)
        parts.append(Link(load_label(label), rows[row], *link))
    loaded: list[Placed] = [
        ([automaton.outlook_of(numbers) for numbers in outlooks], parts[part])
        for outlooks, part in stored["places"]
    ]
    return loaded, parts, [rows[number] for number in stored["firsts"]]
