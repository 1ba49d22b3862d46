"""A rule as SQL writes it: a query with one MATCH_RECOGNIZE clause (SQL:2016), read to the clauses of a rule.

sqlglot parses the query, but for SUBSET and WITHIN, which are taken out first. Names without quotes are the
same in upper and lower case; a column is a property.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from semap.errors import InvalidInput

if TYPE_CHECKING:
    from sqlglot import exp

SQL = re.compile(r"\s*(--[^\n]*\n\s*)*select\b", re.IGNORECASE)
QUOTED = re.compile(r"'(?:''|[^'])*'|\"[^\"]*\"|--[^\n]*")
SUBSET = re.compile(r"\bsubset\s+((?:\w+\s*=\s*\([\w\s,]+\)\s*,?\s*)+)(?=\bdefine\b|\)\s*|$)", re.IGNORECASE)
MEMBER = re.compile(r"(\w+)\s*=\s*\(([\w\s,]+)\)")
WITHIN = re.compile(r"\bwithin\s+interval\s+'([\d.]+)'\s+(\w+?)s?\b", re.IGNORECASE)
UNITS = {"second": "s", "minute": "min", "hour": "h", "day": "d"}
REMEDY = (
    "Write: SELECT * FROM track_in_room MATCH_RECOGNIZE (PARTITION BY room ORDER BY stamp MEASURES ..."
    " PATTERN (A B) DEFINE A AS type = 'began') AS name_of_the_rule"
)
INFIX = {
    "EQ": "=", "NEQ": "<>", "LT": "<", "LTE": "<=", "GT": ">", "GTE": ">=", "Add": "+", "Sub": "-",
    "Mul": "*", "Div": "/", "Mod": "%", "And": "and", "Or": "or", "Like": "like", "DPipe": "||",
}  # fmt: skip
FUNCTIONS = {
    "First": "first", "Last": "last", "Sum": "sum", "Avg": "avg", "Min": "min", "Max": "max", "Abs": "abs",
    "Lower": "lower", "Upper": "upper", "Length": "length", "Floor": "floor", "Ceil": "ceil",
    "Round": "round",
}  # fmt: skip


def is_sql(text: str) -> bool:
    """Whether a rule is written in SQL."""
    return SQL.match(text) is not None


def read_sql(text: str) -> dict[str, object]:
    """The clauses of the rule that a query is.

    raises  InvalidInput for what is no such query, or says what no rule does
    """
    try:
        import sqlglot  # noqa: PLC0415  (an extra)
    except ImportError as error:
        raise InvalidInput(
            "sqlglot reads rules in SQL, and is not installed", "Install the extra: semap[sql]."
        ) from error
    bare, subset, within = _taken_out(text)
    try:
        query = sqlglot.parse_one(bare, dialect="trino")
    except sqlglot.errors.SqlglotError as error:
        message = re.sub(r"\x1b\[\d*m", "", str(error)).split("\n")[0]
        raise InvalidInput(f"it is no SQL: {message}", REMEDY) from error
    return _Query(query, subset, within).clauses()


def _taken_out(text: str) -> tuple[str, Mapping[str, list[str]], str | None]:
    """The text without SUBSET and WITHIN, which are given beside it."""
    # as long as the text, so that places stay: nothing is found within quotes and comments
    blank = QUOTED.sub(lambda found: found[0] if found[0][:2] != "--" else " " * len(found[0]), text)
    masked = QUOTED.sub(lambda found: "'" + "x" * (len(found[0]) - 2) + "'", blank)
    subset: dict[str, list[str]] = {}
    found = SUBSET.search(masked)
    if found:
        for name, members in MEMBER.findall(found[1]):
            subset[name] = [member.strip() for member in members.split(",")]
        blank = blank[: found.start()] + " " * len(found[0]) + blank[found.end() :]
    within = WITHIN.search(blank)
    if within is None:
        return blank, subset, None
    unit = UNITS.get(within[2].lower())
    if unit is None:
        raise InvalidInput(f"an interval of {within[2]}", f"Count {', '.join(UNITS)}s.", "within")
    blank = blank[: within.start()] + " " * len(within[0]) + blank[within.end() :]
    return blank, subset, f"{within[1]} {unit}"


class _Query:
    """One query."""

    def __init__(self, query: Any, subset: Mapping[str, list[str]], within: str | None) -> None:
        from sqlglot import exp  # noqa: PLC0415

        self.exp = exp
        self.query = query
        found = [*query.find_all(exp.MatchRecognize)]
        if len(found) != 1 or not isinstance(query, exp.Select):
            raise InvalidInput("one MATCH_RECOGNIZE clause is needed", REMEDY)
        self.match: Any = found[0]
        self.within = within
        self.pattern = re.sub(r"\bpermute\b", "permute", self._text("pattern"), flags=re.IGNORECASE)
        words = [*re.findall(r"\w+", self.pattern), *subset]
        self.labels: dict[str, str] = {word.upper(): word for word in words}
        self.subset = {self.label(name): [*map(self.label, members)] for name, members in subset.items()}

    def clauses(self) -> dict[str, object]:
        exp = self.exp
        name = self.match.alias or "rule"
        rows = self._text("rows").upper()
        each_row = rows.startswith("ALL ROWS")
        events = {"match": name}
        if "OMIT EMPTY" not in rows:
            events["empty"] = name
        if "WITH UNMATCHED" in rows:
            events["unmatched"] = f"{name}_unmatched"
        source = self.query.args.get("from_") or self.query.args.get("from")
        if source is None or self.query.args.get("where") or self.query.args.get("joins"):
            raise InvalidInput("a rule reads one input; what it keeps of it stands within FROM", REMEDY)
        table, where = self._source(source.this)
        keys = [self.expression(each) for each in self.match.args.get("partition_by") or ()]
        order = self.match.args.get("order")
        by = [each.sql().lower() for each in order.expressions] if order else ["stamp"]
        if by not in (["stamp"], ["stamp nulls last"], ["stamp asc"]):
            raise InvalidInput(f"rows in the order of {', '.join(by)}", "Write ORDER BY stamp.", "order by")
        found: dict[str, object] = {
            "name": name,
            "input": table,
            "where": where,
            "partition_by": keys[0] if len(keys) == 1 else keys or None,
            "pattern": self.pattern,
            "subset": self.subset or None,
            "define": {
                self.label(each.alias): self.expression(each.this)
                for each in self.match.args.get("define") or ()
            }
            or None,
            "measures": {
                each.this.alias: self._measure(each) for each in self.match.args.get("measures") or ()
            }
            or None,
            "rows_per_match": "all" if each_row else None,
            "within": self.within,
            "after_match": self._after(),
            "emit": events,
        }
        if not all(isinstance(each, exp.Star) for each in self.query.expressions):
            raise InvalidInput("columns that are chosen", "Write SELECT *, and MEASURES for what is told.")
        return {clause: value for clause, value in found.items() if value is not None}

    def label(self, name: str) -> str:
        """A variable as the pattern writes it."""
        return str(self.labels.get(name.upper(), name))

    def _text(self, part: str) -> str:
        found = self.match.args.get(part)
        return str(found.this).strip() if found is not None else ""

    def _source(self, source: Any) -> tuple[object, str | None]:
        exp = self.exp
        if isinstance(source, exp.Table):
            return source.name, None
        inner = source.this if isinstance(source, exp.Subquery) else None
        held = inner.args.get("from_") or inner.args.get("from") if isinstance(inner, exp.Select) else None
        if inner is None or held is None or not isinstance(held.this, exp.Table):
            raise InvalidInput("an input that is neither a name nor a selection of one", REMEDY, "from")
        where = inner.args.get("where")
        return held.this.name, self.expression(where.this) if where is not None else None

    def _measure(self, measure: Any) -> str:
        expression = measure.this.this
        text = self.expression(expression)
        if measure.args.get("window_frame") != "FINAL":
            return text
        if not isinstance(expression, self.exp.Func):
            raise InvalidInput(
                "FINAL of more than one function", "Give each a measure of its own.", measure.this.alias
            )
        return f"final({text})"

    def _after(self) -> str | None:
        words = self._text("after").split()[2:]
        said = " ".join(words).lower()
        if not words or said in ("skip past last row", "skip to next row"):
            return said or None
        return " ".join((*map(str.lower, words[:-1]), self.label(words[-1]), "or fail"))

    def expression(self, part: Any) -> str:
        """As a rule writes it."""
        exp = self.exp
        kind = type(part).__name__
        if kind in INFIX:
            return f"({self.expression(part.this)} {INFIX[kind]} {self.expression(part.expression)})"
        if kind in FUNCTIONS:
            held = [
                part.this,
                *[each for each in (part.args.get("expression"), part.args.get("decimals")) if each],
            ]
            return f"{FUNCTIONS[kind]}({', '.join(map(self.expression, held))})"
        said: Mapping[type, Callable[[], str]] = {
            exp.Column: lambda: self._column(part),
            exp.Paren: lambda: self.expression(part.this),
            exp.Not: lambda: f"not ({self.expression(part.this)})",
            exp.Neg: lambda: f"(-{self.expression(part.this)})",
            exp.Is: lambda: f"({self.expression(part.this)} is null)",
            exp.Null: lambda: "null",
            exp.Boolean: lambda: str(part.this).lower(),
            exp.Literal: lambda: "'" + part.this.replace("'", "''") + "'" if part.is_string else part.this,
            exp.Between: lambda: (
                f"({self.expression(part.this)} between {self.expression(part.args['low'])}"
                f" and {self.expression(part.args['high'])})"
            ),
            exp.In: lambda: (
                f"({self.expression(part.this)} in ({', '.join(map(self.expression, part.expressions))}))"
            ),
            exp.Count: lambda: self._counted(part),
            exp.ArrayAgg: lambda: self._aggregated("array", "distinct", part.this),
            exp.Cast: lambda: f"TIMESTAMP({self.expression(part.this)})",
            exp.Anonymous: lambda: (
                f"{part.name.lower()}({', '.join(map(self.expression, part.expressions))})"
            ),
        }
        if type(part) not in said:
            raise InvalidInput(
                f"a rule has no words for {part.sql()}", "Leave it out, or write the rule in YAML."
            )
        return said[type(part)]()

    def _column(self, column: exp.Column) -> str:
        identifier: Any = column.this
        if not column.table and column.name.upper() in self.labels and not identifier.quoted:
            return self.label(column.name)
        name = column.name if identifier.quoted else column.name.lower()
        parts = [each.name for each in column.parts[:-1]]
        if parts and parts[0].upper() in self.labels:
            parts[0] = self.label(parts[0])
        return ".".join((*parts, name))

    def _counted(self, call: exp.Count) -> str:
        if isinstance(call.this, self.exp.Star):
            return "count()"
        if isinstance(call.this, self.exp.Column) and isinstance(call.this.this, self.exp.Star):
            return f"count({self.label(call.this.table)})"
        return self._aggregated("count", "count_distinct", call.this)

    def _aggregated(self, plain: str, distinct: str, of: Any) -> str:
        if isinstance(of, self.exp.Distinct):
            return f"{distinct}({self.expression(of.expressions[0])})"
        return f"{plain}({self.expression(of)})"
