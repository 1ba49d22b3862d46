"""A rule of row patterns as the query that SQL writes for it, of which `sql_text` reads the same rule."""

from __future__ import annotations

import re

from semap.cql2 import Array, Call, Expression, Instant, Literal, Property
from semap.errors import InvalidInput
from semap.rules.condition_text import LOGIC, write_call, write_value
from semap.rules.declaration import Declaration, RowPattern
from semap.rules.language.pattern_text import write as write_pattern
from semap.rules.naming import Label
from semap.rules.pattern import Absent, Alternation, Node, Permutation, Repeat, Sequence, nodes_in

SKIPS = {"past last": "PAST LAST ROW", "to next": "TO NEXT ROW", "to first": "TO FIRST", "to last": "TO LAST"}
YAML = "Show it as YAML."
UNIT_US = (("DAY", 86_400_000_000), ("HOUR", 3_600_000_000), ("MINUTE", 60_000_000), ("SECOND", 1_000_000))


def write_sql(declaration: Declaration) -> str:
    """The query.

    raises  InvalidInput for a rule that says what SQL has no clause for
    """
    body = declaration.body
    if not isinstance(body, RowPattern):
        raise _unsaid("a rule that is no row pattern")
    _require_sayable(declaration, body.node)
    where = f" WHERE {_sql(declaration.where)}" if declaration.where is not None else ""
    name = declaration.inputs[0].name
    source = f"(SELECT * FROM {name}{where})" if where else name  # noqa: S608  (it is for people to read)
    lines = [" ".join(("SELECT * FROM", source, "MATCH_RECOGNIZE ("))]
    if declaration.partition_by:
        lines.append(f"  PARTITION BY {', '.join(declaration.partition_by)}")
    lines.append("  ORDER BY stamp")
    if declaration.measures:
        said = [f"{_measured(each)} AS {name}" for name, each in declaration.measures.items()]
        lines.append(f"  MEASURES {', '.join(said)}")
    lines.append(f"  {_rows(declaration)}")
    lines.append(f"  AFTER MATCH SKIP {_skip(declaration)}")
    lines.append(f"  PATTERN ({write_pattern(body.node)})")
    if declaration.within.match_us is not None:
        lines.append(f"  {_within(declaration.within.match_us)}")
    if declaration.subsets:
        said = [f"{name} = ({', '.join(sorted(each))})" for name, each in declaration.subsets.items()]
        lines.append(f"  SUBSET {', '.join(said)}")
    if declaration.define:
        said = [f"{name} AS {_sql(each)}" for name, each in declaration.define.items()]
        lines.append("  DEFINE " + ",\n    ".join(said))
    return "\n".join((*lines, f") AS {declaration.emit['match']}"))


def _unsaid(what: str) -> InvalidInput:
    return InvalidInput(f"SQL has no clause for {what}", YAML)


def _require_sayable(declaration: Declaration, node: Node) -> None:
    after, within = declaration.after_match, declaration.within
    only_names = all(
        item.actor_within_m is None and item.kind in (None, "query") for item in declaration.inputs
    )
    if len(declaration.inputs) != 1 or not only_names:
        raise _unsaid("inputs of several kinds, or with actors")
    if after.skip not in SKIPS:
        raise _unsaid("all matches of a start")
    if after.variables and not after.strict:
        raise _unsaid("a skip that goes on where there is no row to skip to; `or fail` is SQL's")
    if within.step_us is not None or within.variables:
        raise _unsaid("windows of steps and variables")
    if declaration.confidence is not None or declaration.about is not None or "timeout" in declaration.emit:
        raise _unsaid("confidence, about and time-outs")
    for each in nodes_in(node):
        joints = [element.joint for element in each.elements[1:]] if isinstance(each, Sequence) else []
        if isinstance(each, Repeat | Permutation):
            joints.append(each.joint)
        if isinstance(each, Absent) or set(joints) - {"next"} or (isinstance(each, Repeat) and each.until):
            raise _unsaid("rows between those of a match, absence and until")
        assert not isinstance(each, Alternation) or each.options  # noqa: S101


def _rows(declaration: Declaration) -> str:
    unmatched = "unmatched" in declaration.emit
    if not declaration.each_row:
        if unmatched:
            raise _unsaid("rows in no match beside one row for each match")
        return "ONE ROW PER MATCH"
    if unmatched:
        return "ALL ROWS PER MATCH WITH UNMATCHED ROWS"
    return f"ALL ROWS PER MATCH {'SHOW' if 'empty' in declaration.emit else 'OMIT'} EMPTY MATCHES"


def _skip(declaration: Declaration) -> str:
    after = declaration.after_match
    if not after.variables:
        return SKIPS[after.skip]
    names = {frozenset(each): name for name, each in declaration.subsets.items()}
    name = min(after.variables) if len(after.variables) == 1 else names[after.variables]
    return f"{SKIPS[after.skip]} {name}"


def _within(within_us: int) -> str:
    unit, unit_us = next((each for each in UNIT_US if within_us % each[1] == 0), UNIT_US[-1])
    number = within_us / unit_us
    return f"WITHIN INTERVAL '{int(number) if number.is_integer() else f'{number:.6f}'}' {unit}"


def _measured(measure: Expression) -> str:
    match measure:
        case Call(op="final", args=(inner,)):
            return f"FINAL {_sql(inner)}"
    return _sql(measure)


def _sql(expression: Expression) -> str:
    match expression:
        case Instant(stamp=stamp):
            return f"TIMESTAMP '{stamp.isoformat().replace('+00:00', 'Z')}'"
        case Literal(value=value):
            return write_value(value)
        case Property(name=name):
            return name
        case Array(items=items):
            return f"({', '.join(map(_sql, items))})"
        case Call(op="final"):
            raise _unsaid("final within a measure")
        case Call(op="count", args=(Literal(value=Label() as label), Property(name="stamp"))):
            return f"COUNT({f'{label}.*' if label else '*'})"
        case Call(op="count_distinct" | "array" | "distinct" as op):
            said = write_call(expression, _sql)
            inner = re.sub(r"\A\w+\((.*)\)\Z", r"\1", said, flags=re.DOTALL)
            function, distinct = {
                "count_distinct": ("COUNT", "DISTINCT "),
                "array": ("ARRAY_AGG", ""),
                "distinct": ("ARRAY_AGG", "DISTINCT "),
            }[op]
            return f"{function}({distinct}{inner})"
        case Call(op="not", args=(inner,)):
            return f"NOT ({_sql(inner)})"
        case Call(op=op) if op in LOGIC:
            return f"({write_call(expression, _sql)})"
        case Call():
            text = write_call(expression, _sql)
            return text if re.match(r"\w+\(", text) else f"({text})"
    raise _unsaid("shapes and intervals in conditions")
