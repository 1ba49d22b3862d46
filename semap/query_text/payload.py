"""What is selected becomes the payload of each row of the result."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from semap.query_text.refusal import Refusal
from semap.query_text.relation import Relation
from semap.query_text.scope import Scope, Source
from semap.query_text.tree import Column, Output, Property


@dataclass(frozen=True)
class _Selected:
    """One column of the result; `named` says that AS gave it its name."""

    name: str
    named: bool
    side: int
    column: str
    at: int


def payload_of(outputs: Sequence[Output], scope: Scope, relation: Relation) -> Mapping[str, str]:
    """The property of a side by the name of its column; empty for * alone: all there are.

    Columns of one name get that of their view before it, room_name and track_name; where both sides are of
    one view, that which FROM gives them. What has a name from AS keeps it.

    raises  Refusal
    """
    if not outputs:
        raise Refusal("no columns", 0)
    if [output.expression for output in outputs] == [Column(None, "*")]:
        return {}
    selected = [each for output in outputs for each in _columns(output, scope)]
    counted = Counter(each.name for each in selected)
    payload: dict[str, str] = {}
    for each in selected:
        name = each.name
        if counted[name] > 1 and not each.named:
            name = f"{_prefix(scope.sources, each.side)}_{name}"
        if name in payload:
            raise Refusal("same name", each.at, what=name)
        payload[name] = f"{'subject' if each.side == relation.subject else 'object'}.{each.column}"
    return payload


def _prefix(sources: Sequence[Source], side: int) -> str:
    first, second = sources
    return sources[side].alias if first.view == second.view else sources[side].view.name


def _columns(output: Output, scope: Scope) -> list[_Selected]:
    column = output.expression
    if not isinstance(column, Column):
        raise Refusal("computed", column.at)
    if column.name == "*":
        sources = scope.sources if column.table is None else (scope.source(column.table, column.at),)
        return [
            _Selected(name, False, each.side, of, output.at)
            for each in sources
            for name, of in each.columns.items()
        ]
    found = scope.column(column)
    if not isinstance(found, Property):
        raise Refusal("whole row", column.at, what=column.name)
    return [
        _Selected(output.alias or column.name, output.alias is not None, found.side, found.name, output.at)
    ]
