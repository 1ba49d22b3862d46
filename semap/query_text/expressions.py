"""What stands in WHERE, ON, SELECT and ORDER BY becomes values; what is none of a few forms is refused."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from semap.query_text.reasons import DEEPEST
from semap.query_text.refusal import Refusal
from semap.query_text.tree import Call, Cast, Column, Constant, Expression, Function

Node = Mapping[str, Any]

LOGIC = {"AND_EXPR": "and", "OR_EXPR": "or", "NOT_EXPR": "not"}
LIKES = {"~~": "like", "~~*": "ilike", "!~~": "like", "!~~*": "ilike"}
OWN_SCHEMAS = {"public", "semap_query"}
TYPES = {
    "float8": "float", "numeric": "numeric", "int4": "integer", "int8": "bigint", "int2": "smallint",
    "text": "text", "varchar": "text", "uuid": "uuid", "bool": "boolean", "jsonb": "jsonb", "float4": "real",
}  # fmt: skip

REFUSED = {
    "SubLink": ("subquery", ""),
    "ParamRef": ("parameter", ""),
    "SQLValueFunction": ("time", "this"),
    "CaseExpr": ("expression", "CASE"),
    "CoalesceExpr": ("expression", "COALESCE"),
    "MinMaxExpr": ("expression", "GREATEST or LEAST"),
    "RowExpr": ("expression", "a row"),
    "A_ArrayExpr": ("expression", "ARRAY"),
    "A_Indirection": ("expression", "a part of a value"),
    "BooleanTest": ("expression", "IS TRUE"),
    "GroupingFunc": ("aggregate", "GROUPING"),
    "SetToDefault": ("expression", "DEFAULT"),
}
"""What an expression may not be made of: the reason, and how it is called."""

REFUSED_KINDS = {
    "AEXPR_OP_ANY": "ANY",
    "AEXPR_OP_ALL": "ALL",
    "AEXPR_DISTINCT": "IS DISTINCT FROM",
    "AEXPR_NOT_DISTINCT": "IS NOT DISTINCT FROM",
    "AEXPR_NULLIF": "NULLIF",
    "AEXPR_SIMILAR": "SIMILAR TO",
    "AEXPR_BETWEEN_SYM": "BETWEEN SYMMETRIC",
    "AEXPR_NOT_BETWEEN_SYM": "NOT BETWEEN SYMMETRIC",
}
AGGREGATES = {
    "count", "sum", "avg", "min", "max", "array_agg", "string_agg", "json_agg", "jsonb_agg",
    "json_object_agg", "jsonb_object_agg", "bool_and", "bool_or", "every", "bit_and", "bit_or", "stddev",
    "variance", "corr", "mode", "percentile_cont", "percentile_disc", "st_union", "st_collect", "st_extent",
    "st_3dextent", "st_makeline", "st_memunion", "st_polygonize",
}  # fmt: skip
WINDOWS = {
    "row_number",
    "rank",
    "dense_rank",
    "lag",
    "lead",
    "first_value",
    "last_value",
    "nth_value",
    "ntile",
}
CLOCKS = {
    "now", "clock_timestamp", "statement_timestamp", "transaction_timestamp", "timeofday", "age", "timezone",
}  # fmt: skip
VOLATILE = {
    "random", "gen_random_uuid", "nextval", "currval", "setval", "pg_sleep", "txid_current",
    "uuid_generate_v4", "pg_backend_pid", "set_config",
}  # fmt: skip


class Reader:
    """Makes expressions of nodes of one text."""

    def __init__(self, text: str) -> None:
        self._bytes = text.encode()
        self._depth = 0

    def place(self, location: int | None) -> int | None:
        """The character at which a byte is; None where the parser does not say."""
        if location is None or location < 0:
            return None
        return len(self._bytes[:location].decode(errors="ignore"))

    def expression(self, node: Node) -> Expression:
        """raises Refusal"""
        ((kind, item),) = node.items()
        at = self.place(item.get("location")) or 0
        if kind in REFUSED:
            reason, what = REFUSED[kind]
            raise Refusal(reason, at, what=what)
        self._depth += 1
        if self._depth > DEEPEST:
            raise Refusal("too deep", at)
        try:
            return self._made(kind, item, at)
        finally:
            self._depth -= 1

    def _made(self, kind: str, item: Node, at: int) -> Expression:
        match kind:
            case "ColumnRef":
                return self._column(item, at)
            case "A_Const":
                return self._constant(item, at)
            case "BoolExpr":
                return Call(LOGIC[item["boolop"]], self._all(item["args"]), at)
            case "NullTest":
                test = Call("is null", (self.expression(item["arg"]),), at)
                return Call("not", (test,), at) if item["nulltesttype"] == "IS_NOT_NULL" else test
            case "A_Expr":
                return self._operator(item, at)
            case "FuncCall":
                return self._function(item, at)
            case "TypeCast":
                return self._cast(item, at)
            case "CollateClause":
                return self._collate(item, at)
        raise Refusal("expression", at, what="this")

    def _all(self, nodes: list[Node]) -> tuple[Expression, ...]:
        return tuple(map(self.expression, nodes))

    def _column(self, item: Node, at: int) -> Column:
        names = ["*" if "A_Star" in field else field["String"]["sval"] for field in item["fields"]]
        if len(names) > 2:
            raise Refusal(
                "no table", at, what=".".join(names[:-1]), hint="views by the names that FROM gives them"
            )
        return Column(names[0] if len(names) == 2 else None, names[-1], at)

    def _constant(self, item: Node, at: int) -> Constant:
        if item.get("isnull"):
            return Constant(None, at)
        if "sval" in item:
            return Constant(str(item["sval"].get("sval", "")), at)
        if "boolval" in item:
            return Constant(bool(item["boolval"].get("boolval", False)), at)
        if "ival" in item:
            self._require_plain(at, item)
            return Constant(int(item["ival"].get("ival", 0)), at)
        if "fval" in item:
            self._require_plain(at, item)
            number = float(item["fval"]["fval"])
            if not math.isfinite(number):
                raise Refusal("number", at, what="this", range="not so large")
            return Constant(number, at)
        raise Refusal("expression", at, what="a string of bits")

    def _require_plain(self, at: int, item: Node) -> None:
        """Numbers such as 1_000 and 0xFF are of a later PostgreSQL than the one that semap runs on."""
        written = self._bytes[item.get("location", 0) :][:100]
        if re.match(rb"[-+\s]*(0[xXoObB]|\d+_|\d*\.\d+_)", written):
            raise Refusal("new number", at)

    def _operator(self, item: Node, at: int) -> Expression:
        kind, symbol = item["kind"], item["name"][-1]["String"]["sval"]
        if kind in REFUSED_KINDS:
            raise Refusal("expression", at, what=REFUSED_KINDS[kind])
        right = item["rexpr"]
        if "lexpr" not in item:
            return self._sign(symbol, self.expression(right), at)
        left = self.expression(item["lexpr"])
        made: Expression
        match kind:
            case "AEXPR_IN":
                made = Call("in", (left, *self._all(right["List"]["items"])), at)
                return Call("not", (made,), at) if symbol == "<>" else made
            case "AEXPR_BETWEEN" | "AEXPR_NOT_BETWEEN":
                made = Call("between", (left, *self._all(right["List"]["items"])), at)
                return Call("not", (made,), at) if kind == "AEXPR_NOT_BETWEEN" else made
            case "AEXPR_LIKE" | "AEXPR_ILIKE":
                if "FuncCall" in right:
                    raise Refusal("escape", at)
                made = Call(LIKES[symbol], (left, self.expression(right)), at)
                return Call("not", (made,), at) if symbol.startswith("!") else made
        return Call("<>" if symbol == "!=" else symbol, (left, self.expression(right)), at)

    def _sign(self, symbol: str, inner: Expression, at: int) -> Expression:
        number = inner.inner if isinstance(inner, Cast) else inner
        if (
            not isinstance(number, Constant)
            or isinstance(number.value, bool | str | None)
            or symbol not in "+-"
        ):
            raise Refusal("operator", at, what=symbol, hint="Compare a column with a value.")
        return Constant(-number.value if symbol == "-" else number.value, at)

    def _function(self, item: Node, at: int) -> Expression:
        *schemas, name = (each["String"]["sval"] for each in item["funcname"])
        if "over" in item or name in WINDOWS:
            raise Refusal("window", at)
        if name in CLOCKS:
            raise Refusal("time", at, what=name)
        if name in VOLATILE:
            raise Refusal("volatile", at, what=name)
        special = {"agg_star", "agg_distinct", "agg_filter", "agg_order", "agg_within_group"} & item.keys()
        if special or name in AGGREGATES:
            raise Refusal("aggregate", at, what=name)
        if "func_variadic" in item:
            raise Refusal("expression", at, what="VARIADIC")
        args = item.get("args", [])
        if any("NamedArgExpr" in each for each in args):
            raise Refusal("expression", at, what="an argument by its name")
        if schemas and not (set(schemas) <= OWN_SCHEMAS or (schemas, name) == (["semap"], "is_a")):
            raise Refusal("function", at, what=".".join((*schemas, name)), hint="Leave the schema out.")
        return Function(".".join((*schemas, name)) if schemas == ["semap"] else name, self._all(args), at)

    def _cast(self, item: Node, at: int) -> Expression:
        named = item["typeName"]
        name = named["names"][-1]["String"]["sval"]
        inner = self.expression(item["arg"])
        if name not in TYPES or named.get("arrayBounds") or named.get("typmods") or len(named["names"]) > 2:
            hint = "Compare columns as they are, or attributes ::float, ::integer, ::numeric or ::boolean."
            raise Refusal("type", inner.at, what=name, hint=hint)
        type_ = TYPES[name]
        if isinstance(inner, Constant):
            return self._cast_constant(inner, type_)
        return Cast(type_, inner, at)

    def _cast_constant(self, inner: Constant, type_: str) -> Expression:
        is_number = isinstance(inner.value, int | float) and not isinstance(inner.value, bool)
        if (type_ == "text" and isinstance(inner.value, str)) or (
            type_ == "boolean" and isinstance(inner.value, bool)
        ):
            return inner
        if is_number and (
            type_ in ("float", "numeric") or (isinstance(inner.value, int) and type_ in ("integer", "bigint"))
        ):
            return inner
        if isinstance(inner.value, str) and type_ in ("uuid", "jsonb"):
            return inner
        raise Refusal("type", inner.at, what=type_, hint="Write the value as it is: 'text', 2.5, true.")

    def _collate(self, item: Node, at: int) -> Expression:
        if [each["String"]["sval"] for each in item["collname"]][-1] != "C":
            raise Refusal("collation", at)
        return Call("collate", (self.expression(item["arg"]),), at)
