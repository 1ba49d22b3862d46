"""Which side of the relation a name in the text means, and which column of it."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from semap.query_text.refusal import Refusal
from semap.query_text.tree import Call, Cast, Column, Constant, Expression, Function, Property, Row
from semap.query_text.views import View


@dataclass(frozen=True)
class Source:
    """A side as FROM names it.

    columns  what it offers, by name: the column of the view that it is
    """

    side: int
    alias: str
    view: View
    columns: Mapping[str, str]


def whole(side: int, alias: str, view: View) -> Source:
    return Source(side, alias, view, {name: name for name in view.columns})


@dataclass(frozen=True)
class Scope:
    """The names that an expression may use; those of a subquery hide those around it."""

    sources: tuple[Source, ...]
    outer: Scope | None = None

    def resolved(self, expression: Expression) -> Expression:
        """The expression, each of its names being a property or a row.

        raises  Refusal
        """
        match expression:
            case Column():
                return self.column(expression)
            case Call(args=args) | Function(args=args):
                return replace(expression, args=tuple(map(self.resolved, args)))
            case Cast(inner=inner):
                return replace(expression, inner=self.resolved(inner))
        return expression

    def column(self, column: Column) -> Property | Row:
        """raises Refusal unless one source offers it"""
        if column.name == "*":
            raise Refusal("expression", column.at, what="*")
        if column.table is not None:
            return _property(self.source(column.table, column.at), column)
        offering = [each for each in self.sources if column.name in each.columns]
        if len(offering) > 1:
            first, second = (each.alias for each in offering)
            raise Refusal("ambiguous", column.at, what=column.name, first=first, second=second)
        if offering:
            return _property(offering[0], column)
        for each in self.sources:
            if each.alias == column.name:
                return Row(each.side, column.at)
        if self.outer is not None:
            return self.outer.column(column)
        raise self._unknown(column)

    def source(self, alias: str, at: int) -> Source:
        """raises Refusal where nothing is called so"""
        for each in self.sources:
            if each.alias == alias:
                return each
        if self.outer is not None:
            return self.outer.source(alias, at)
        raise Refusal("no table", at, what=alias, hint=", ".join(each.alias for each in self.sources))

    def _unknown(self, column: Column) -> Refusal:
        offered = [name for each in self.sources for name in each.columns]
        return Refusal("column", column.at, what=column.name, hint=near(column.name, offered))


def _property(source: Source, column: Column) -> Property:
    if column.name in source.columns:
        return Property(source.side, source.columns[column.name], column.at)
    if column.name in source.view.columns:
        raise Refusal("not selected", column.at, what=column.name)
    hint = near(column.name, source.view.columns)
    raise Refusal("column", column.at, what=f"{source.view.name}.{column.name}", hint=hint)


def near(name: str, known: Iterable[str]) -> str:
    """What may have been meant, and what there is."""
    names = list(dict.fromkeys(known))
    meant = difflib.get_close_matches(name, names, n=1)
    return (f"Did you mean {meant[0]}? " if meant else "") + f"There are {', '.join(names)}."


def sides_of(expression: Expression) -> set[int]:
    """Which sides a resolved expression speaks of."""
    match expression:
        case Property(side=side) | Row(side=side):
            return {side}
        case Call(args=args) | Function(args=args):
            return {side for each in args for side in sides_of(each)}
        case Cast(inner=inner):
            return sides_of(inner)
        case Constant() | Column():
            return set()
