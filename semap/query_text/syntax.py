"""A text becomes a tree: PostgreSQL's own parser reads it, and much that cannot be kept is refused here.

The parser gives what PostgreSQL's grammar makes of the text, as JSON named as in parsenodes.h.
This module and `expressions` are the only ones that know them.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from typing import Any

from pglast.parser import ParseError, parse_sql_json

from semap.query_text.expressions import Reader
from semap.query_text.reasons import DEEPEST, LONGEST
from semap.query_text.refusal import Refusal
from semap.query_text.tree import Constant, Expression, Output, Range, Select, Subquery, Table

Node = Mapping[str, Any]

SCHEMAS = ("semap_query",)

CLAUSES = {
    "withClause": "with",
    "valuesLists": "values",
    "intoClause": "into",
    "distinctClause": "distinct",
    "groupClause": "group",
    "havingClause": "group",
    "windowClause": "window",
    "limitOffset": "offset",
    "lockingClause": "locking",
}
"""What a SELECT may not have, and the reason."""

RANGES = {
    "RangeFunction": "a function",
    "RangeTableSample": "a sample",
    "RangeTableFunc": "XMLTABLE",
    "JsonTable": "JSON_TABLE",
}

DEEPEST_TREE = 8 * DEEPEST
"""Levels of the parser's JSON, of which each level of an expression takes four at most."""

PARTS = re.compile(r'"location":(?P<place>\d+)|"(?:[^"\\]|\\.)*+"|(?P<bracket>[][{}])')

STATEMENTS = {
    "InsertStmt": "an INSERT",
    "UpdateStmt": "an UPDATE",
    "DeleteStmt": "a DELETE",
    "MergeStmt": "a MERGE",
    "ExplainStmt": "an EXPLAIN",
    "CopyStmt": "a COPY",
    "DoStmt": "a DO",
}


def read(text: str, hint: Callable[[str], str | None]) -> Select:
    """The only statement of a text.

    hint    the view that is meant by a word of SQL's own, if it is one
    raises  Refusal
    """
    statements = _parsed(text, hint)
    if not statements:
        raise Refusal("empty", 0)
    reader = _SelectReader(Reader(text))
    if len(statements) > 1:
        raise Refusal("several", reader.place(statements[1].get("stmt_location", 0)))
    ((kind, statement),) = statements[0]["stmt"].items()
    if kind != "SelectStmt":
        raise Refusal("no select", 0, what=STATEMENTS.get(kind, "another statement"))
    return reader.select(statement)


def _parsed(text: str, hint: Callable[[str], str | None]) -> list[Node]:
    if len(text) > LONGEST:
        raise Refusal("too long", None)
    if "\0" in text:
        raise Refusal("bytes", text.index("\0"), what="a character of number 0")
    alone = re.search("[\ud800-\udfff]", text)
    if alone is not None:
        raise Refusal("bytes", alone.start(), what="half a character")
    try:
        tree = parse_sql_json(text)
        _require_shallow(tree, text)
        parsed = json.loads(tree)
    except ParseError as error:
        raise _syntax(text, error, hint) from error
    except ValueError as error:  # bytes that an escape makes and that are no UTF-8, say
        raise Refusal("bytes", None, what="an escape that makes no character") from error
    found: list[Node] = parsed.get("stmts", [])
    return found


def _require_shallow(tree: str, text: str) -> None:
    """Refuse a tree that is deeper than any that is understood: what JSON may be depends on the Python."""
    depth, deepest, place = 0, 0, None
    for found in PARTS.finditer(tree):
        if found["place"] is not None:  # which follows the parts of what is there
            place = int(found["place"]) if depth > DEEPEST_TREE else place
        elif found["bracket"] is not None:
            depth += 1 if found["bracket"] in "{[" else -1
            deepest = max(depth, deepest)
            if place is not None and depth == DEEPEST_TREE:
                break
    if deepest > DEEPEST_TREE:
        raise Refusal("too deep", Reader(text).place(place))


def _syntax(text: str, error: ParseError, hint: Callable[[str], str | None]) -> Refusal:
    message = str(error.args[0])
    at = error.args[1] if len(error.args) > 1 else None
    if "memory exhausted" in message or "stack depth" in message:
        return Refusal("too deep", at)
    word = re.match(r"\w+", text[at:]) if at is not None else None
    view = hint(word.group().lower()) if word is not None else None
    if view is not None:
        return Refusal("quoted", at, what=message, view=view)
    return Refusal("syntax", at, what=message)


class _SelectReader:
    """Makes a SELECT of its node."""

    def __init__(self, expressions: Reader) -> None:
        self.expressions = expressions
        self.place = expressions.place
        self.depth = 0

    def select(self, node: Node) -> Select:
        at = self._first_place(node)
        if node.get("op") != "SETOP_NONE":
            raise Refusal("set", at)
        for clause, reason in CLAUSES.items():
            if node.get(clause):
                raise Refusal(reason, at, what="WINDOW")
        if node.get("limitOption") == "LIMIT_OPTION_WITH_TIES":
            raise Refusal("ties", at)
        conditions: list[Expression] = []
        ranges = tuple(each for item in node.get("fromClause", ()) for each in self.ranges(item, conditions))
        if "whereClause" in node:
            conditions.append(self.expressions.expression(node["whereClause"]))
        return Select(
            tuple(self._output(item["ResTarget"]) for item in node.get("targetList", ())),
            ranges,
            tuple(conditions),
            self._order(node.get("sortClause", ()), at),
            self._limit(node),
            at or 0,
        )

    def ranges(self, node: Node, conditions: list[Expression]) -> list[Range]:
        """What an item of FROM names; conditions of joins are added to those there are."""
        ((kind, item),) = node.items()
        match kind:
            case "RangeVar":
                return [self._table(item)]
            case "RangeSubselect":
                return [self._subquery(item)]
            case "JoinExpr":
                return self._join(item, conditions)
        raise Refusal("range", self._first_place(item), what=RANGES.get(kind, "this"))

    def _table(self, item: Node) -> Table:
        at = self.place(item.get("location"))
        schema = item.get("schemaname")
        if schema not in (None, *SCHEMAS) or "catalogname" in item:
            raise Refusal("schema", at, what=schema)
        return Table(item["relname"], self._alias(item, at) or item["relname"], at or 0)

    def _subquery(self, item: Node) -> Subquery:
        ((kind, inner),) = item["subquery"].items()
        at = self._first_place(inner)
        self.depth += 1
        if kind != "SelectStmt" or self.depth > 1:
            raise Refusal("inner subquery", at)
        select = self.select(inner)
        self.depth -= 1
        return Subquery(select, self._alias(item, at) or "", bool(item.get("lateral")), at or 0)

    def _join(self, item: Node, conditions: list[Expression]) -> list[Range]:
        found = [each for side in ("larg", "rarg") for each in self.ranges(item[side], conditions)]
        at = found[-1].at
        if item.get("jointype") != "JOIN_INNER":
            raise Refusal("outer join", at)
        if item.get("isNatural") or item.get("usingClause"):
            raise Refusal("using", at)
        if "alias" in item:
            raise Refusal("renamed", at)
        if "quals" in item:
            conditions.append(self.expressions.expression(item["quals"]))
        return found

    def _alias(self, item: Node, at: int | None) -> str | None:
        alias = item.get("alias")
        if alias is None:
            return None
        if "colnames" in alias:
            raise Refusal("renamed", at)
        name: str = alias["aliasname"]
        return name

    def _output(self, item: Node) -> Output:
        at = self.place(item.get("location"))
        if "indirection" in item:
            raise Refusal("computed", at)
        return Output(self.expressions.expression(item["val"]), item.get("name"), at or 0)

    def _order(self, clause: list[Node] | tuple[Node, ...], at: int | None) -> Expression | None:
        if not clause:
            return None
        by = [item["SortBy"] for item in clause]
        if len(by) > 1 or by[0].get("useOp"):
            raise Refusal("order by", at)
        expression = self.expressions.expression(by[0]["node"])
        if by[0].get("sortby_dir") == "SORTBY_DESC":
            raise Refusal("farthest", expression.at)
        return expression

    def _limit(self, node: Node) -> Constant | None:
        if "limitCount" not in node:
            return None
        count = self.expressions.expression(node["limitCount"])
        if not isinstance(count, Constant):
            raise Refusal("limit count", count.at)
        return None if count.value is None else count

    def _first_place(self, node: object) -> int | None:
        """Where something begins that has no place of its own: at the first of its parts that has one."""
        waiting = [node]
        found: list[int] = []
        while waiting:
            match waiting.pop():
                case dict() as inner:
                    if isinstance(inner.get("location"), int) and inner["location"] >= 0:
                        found.append(inner["location"])
                    waiting.extend(inner.values())
                case list() as items:
                    waiting.extend(items)
        return self.place(min(found)) if found else None
