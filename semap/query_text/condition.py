"""A condition on one side becomes CQL2 in its JSON form.

What is asked for is CQL2 that is true exactly where the SQL is true: so NOT goes down to the leaves, each of
which is written in two ways, as it holds and as it fails, and what SQL makes of null needs no more care.

An attribute is JSON, and ->> makes a text of it. As a text it is compared by = and IN as PostgreSQL does it:
'2' is the text and the number. Three differences remain. LIKE asks texts only. A number counts by its value,
so that 2.0 is '2'. What is cast has to be of that kind in JSON; a text is not, where plain SQL may cast it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from semap.cql2 import Kinds, check, parse
from semap.errors import InvalidInput
from semap.query_text.reasons import DEEPEST
from semap.query_text.refusal import Refusal
from semap.query_text.tree import Call, Cast, Constant, Expression, Function, Property
from semap.query_text.views import View

Cql2: TypeAlias = Mapping[str, object]

KINDS: Mapping[str, Kinds] = {
    "track": {"name": "text", "source": "text", "attributes": "any"},
    "instance": {"name": "text", "alias": "text", "concept": "text", "storey": "text", "attributes": "any"},
}
"""What conditions may ask of either kind of side."""

HINTS = {
    "track": "Use name, source or attributes, or write: semap.is_a(t.concept, 'Person').",
    "instance": "Use name, concept, storey or attributes.",
}

OPPOSITES = {"=": "<>", "<>": "=", "<": ">=", "<=": ">", ">": "<=", ">=": "<"}
TURNED = {"=": "=", "<>": "<>", "<": ">", "<=": ">=", ">": "<", ">=": "<="}
NUMBER = re.compile(r"-?(0|[1-9]\d*)(\.\d+)?", re.ASCII)
INDEX = re.compile(r"\s*[+-]?\d+", re.ASCII)
NUMBERS = ("float", "numeric", "integer", "bigint", "smallint")


@dataclass(frozen=True)
class Asked:
    """What a comparison is about.

    property   as CQL2 names it
    form       column: one that holds texts; text: an attribute as a text; json: as it is; the others as cast
    collated   ordered by code points
    written    as the text has it, for messages
    """

    property: str
    form: Literal["column", "text", "json", "number", "boolean"]
    written: str
    collated: bool = False


def together(conditions: Sequence[Cql2]) -> Cql2 | None:
    """All of these; None of none."""
    if not conditions:
        return None
    return conditions[0] if len(conditions) == 1 else _call("and", *conditions)


def require_readable(condition: Cql2, kind: str, at: int) -> None:
    """raises Refusal where CQL2 has a limit that SQL has not"""
    try:
        check(parse(condition), KINDS[kind])
    except InvalidInput as error:
        raise Refusal("large condition", at, what=str(error)) from error


def condition(expression: Expression, view: View, *, negated: bool = False) -> Cql2:
    """CQL2 that is true where a resolved expression of one side is true, or false.

    raises  Refusal
    """
    match expression:
        case Call(op="and" | "or" as op, args=args):
            turned = {"and": "or", "or": "and"}[op] if negated else op
            return _call(turned, *(condition(each, view, negated=negated) for each in args))
        case Call(op="not", args=(inner,)):
            return condition(inner, view, negated=not negated)
        case Call(op="is null", args=(inner,)):
            asked = _asked(inner, view)
            if asked.form == "json":  # the null of JSON is not that of SQL
                raise Refusal("attribute", inner.at)
            missing = _call("isNull", _property(asked))
            return _call("not", missing) if negated else missing
        case Call(op="in", args=(inner, *items)):
            return _listed(_asked(inner, view), items, inner.at, negated)
        case Call(op="between", args=(inner, low, high), at=at):
            bounds = (Call(">=", (inner, low), at), Call("<=", (inner, high), at))
            return condition(Call("and", bounds, at), view, negated=negated)
        case Call(op="like" | "ilike" as op, args=(inner, pattern)):
            found = _like(op, _asked(inner, view), pattern)
            return _call("not", found) if negated else found
        case Call(op=op, args=(left, right)) if op in TURNED:
            return _comparison(op, left, right, view, negated)
        case Call(op="@>", args=(Property(name="attributes"), document)):
            return _containment(document, negated)
        case Function(name="semap.is_a", args=(Property(name="concept"), Constant(value=str(name)))):
            is_a = _call("isA", name)
            return _call("not", is_a) if negated else is_a
        case Cast(type="boolean"):
            return _call("=", _property(_asked(expression, view)), not negated)
    raise _refused(expression)


def _refused(expression: Expression) -> Refusal:
    at = expression.at
    match expression:
        case Function(name=name):
            return Refusal(
                "function", at, what=name, hint="Compare a column with a value: r.name = 'Kitchen'."
            )
        case Call(op="@>"):
            return Refusal("attribute value", at)
        case Call(op="?" | "?|" | "?&" as op):
            return Refusal("operator", at, what=op, hint="Write: r.attributes->>'floor' is not null.")
        case Call(op="~" | "~*" | "!~" | "!~*" as op):
            return Refusal("operator", at, what=op, hint="Write: name like 'Room%'.")
        case Call(op=op):
            return Refusal("operator", at, what=op, hint="Compare a column with a value: r.name = 'Kitchen'.")
        case Constant():
            return Refusal("no column", at)
    return Refusal("expression", at, what="this")


def _asked(expression: Expression, view: View) -> Asked:
    match expression:
        case Property(name=name, at=at):
            return _column(name, at, view)
        case Call(op="collate", args=(inner,)) | Cast(type="text", inner=inner):
            asked = _asked(inner, view)
            if asked.form == "json" or asked.form in ("number", "boolean"):
                raise Refusal("attribute", expression.at)
            collated = asked.collated or isinstance(expression, Call)
            return Asked(asked.property, asked.form, asked.written, collated)
        case Call(op="->>" | "->" as op):
            return _attribute(expression, "text" if op == "->>" else "json")
        case Cast(type=type_, inner=Call(op="->>" | "->" as op) as inner):
            at = inner.at
            asked = _attribute(inner, "text")
            if type_ == "boolean":
                return Asked(asked.property, "boolean", asked.written)
            if type_ in NUMBERS and (op == "->>" or type_ in ("float", "numeric")):
                return Asked(asked.property, "number", asked.written)
            raise Refusal("type", at, what=type_, hint="Write: (r.attributes->>'area')::float > 10.")
    raise _refused(expression)


def _column(name: str, at: int, view: View) -> Asked:
    match view.columns[name]:
        case "text":
            return Asked(name, "column", name)
        case "uid":
            raise Refusal("uid alone", at)
        case "id":
            raise Refusal("id", at)
        case "map":
            raise Refusal("map", at, first="t", second="r")
        case "moving":
            raise Refusal("moving", at, what=name)
        case "shape":
            raise Refusal("shape condition", at, what=name)
        case "attributes":
            raise Refusal("attribute", at)
    raise Refusal("unkept column", at, what=name, hint=HINTS[view.kind])


def _attribute(expression: Expression, form: Literal["text", "json"]) -> Asked:
    keys: list[str] = []
    part = expression
    while isinstance(part, Call) and part.op in ("->", "->>"):
        part, key = part.args
        if not isinstance(key, Constant) or not isinstance(key.value, str):
            raise Refusal("attribute", key.at)
        if key.value == "" or "." in key.value or INDEX.fullmatch(key.value):
            raise Refusal("attribute name", key.at, what=f"'{key.value}'")
        keys.insert(0, key.value)
    if not isinstance(part, Property) or part.name != "attributes":
        raise Refusal("attribute", part.at)
    return Asked(".".join(("attributes", *keys)), form, f"attributes->>'{keys[-1]}'")


def _comparison(op: str, left: Expression, right: Expression, view: View, negated: bool) -> Cql2:
    right_value = right.args[0] if isinstance(right, Call) and right.op == "collate" else right
    if isinstance(left, Constant) and not isinstance(right_value, Constant):
        return _comparison(TURNED[op], right, left, view, negated)
    asked = _asked(left, view)
    if not isinstance(right_value, Constant):
        return _of_two_columns(op, asked, _asked(right, view), right.at, negated)
    if right_value is not right:
        asked = Asked(asked.property, asked.form, asked.written, True)
    return _compared(op, asked, right_value, negated)


def _of_two_columns(op: str, left: Asked, right: Asked, at: int, negated: bool) -> Cql2:
    if left.form != "column" or right.form != "column":
        raise Refusal("not a text", at, what=left.written)
    if op not in ("=", "<>") and not (left.collated or right.collated):
        raise Refusal("collation", at)
    return _call(OPPOSITES[op] if negated else op, _property(left), _property(right))


def _compared(op: str, asked: Asked, constant: Constant, negated: bool) -> Cql2:
    value, at = constant.value, constant.at
    if value is None:
        raise Refusal("null", at)
    wanted = OPPOSITES[op] if negated else op
    match asked.form:
        case "number":
            if isinstance(value, bool | str):
                raise Refusal("not a number", at, what=asked.written)
            return _call(wanted, _property(asked), value)
        case "boolean":
            if not isinstance(value, bool) or op not in ("=", "<>"):
                raise Refusal("not a boolean", at, what=asked.written)
            return _call(wanted, _property(asked), value)
        case "json":
            raise Refusal("attribute", at)
    if not isinstance(value, str):
        raise Refusal("uncast" if asked.form == "text" else "not a text", at, what=asked.written)
    if op not in ("=", "<>"):
        if asked.form == "text":
            raise Refusal("attribute order", at)
        if not asked.collated:
            raise Refusal("collation", at)
    if asked.form == "column":
        return _call(wanted, _property(asked), value)
    return _attribute_is(asked, value, at, equal=wanted == "=")


def _attribute_is(asked: Asked, text: str, at: int, *, equal: bool) -> Cql2:
    """What ->> makes of an attribute is a text, or is there and another one."""
    values = _json_of(text, at)
    if equal:
        return _any([_call("=", _property(asked), value) for value in values])
    unlike = [
        _call(
            "or", _call("isNull", _call("=", _property(asked), value)), _call("<>", _property(asked), value)
        )
        for value in values
    ]
    return _call("and", _call("not", _call("isNull", _property(asked))), *unlike)


def _json_of(text: str, at: int) -> list[str | float | bool]:
    """The values that ->> makes this text of."""
    if text in ("true", "false"):
        return [text, text == "true"]
    if NUMBER.fullmatch(text):
        return [text, float(text) if "." in text else int(text)]
    if text[:1] in ("{", "["):
        raise Refusal("json text", at)
    return [text]


def _listed(asked: Asked, items: Sequence[Expression], at: int, negated: bool) -> Cql2:
    constants = []
    for each in items:
        if not isinstance(each, Constant):
            raise Refusal("not a text", each.at, what=asked.written)
        constants.append(each)
    found = [_compared("=", asked, each, negated) for each in constants]
    if asked.form == "column":
        is_in = _call("in", _property(asked), [each.value for each in constants])
        return _call("not", is_in) if negated else is_in
    return (together(found) if negated else None) or _any(found)


def _like(op: str, asked: Asked, pattern: Expression) -> Cql2:
    if asked.form not in ("column", "text"):
        raise Refusal("not a text", pattern.at, what=asked.written)
    text = pattern.value if isinstance(pattern, Constant) else None
    if not isinstance(text, str) or (len(text) - len(text.rstrip("\\"))) % 2:
        raise Refusal("pattern", pattern.at)
    if op == "ilike":
        return _call("like", _call("casei", _property(asked)), _call("casei", text))
    return _call("like", _property(asked), text)


def _containment(document: Expression, negated: bool) -> Cql2:
    """attributes @> an object: each of its values is there."""
    text = document.value if isinstance(document, Constant) else None
    try:
        wanted = json.loads(text, parse_constant=_refuse_constant) if isinstance(text, str) else None
    except RecursionError as error:
        raise Refusal("too deep", document.at) from error
    except ValueError:
        wanted = None
    if not isinstance(wanted, dict) or not wanted:
        raise Refusal("attribute value", document.at)
    leaves = list(_leaves(wanted, "attributes", document.at))
    if not negated:
        found = together([_call("=", {"property": name}, value) for name, value in leaves])
        assert found is not None  # noqa: S101  (an object with a value)
        return found
    missing = [
        _call(
            "or",
            _call("isNull", _call("=", {"property": name}, value)),
            _call("<>", {"property": name}, value),
        )
        for name, value in leaves
    ]
    return _any(missing)


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is not JSON")


def _is_no_text(value: object) -> bool:
    """Whether PostgreSQL keeps no such text: with a character of number 0, or half a one."""
    return isinstance(value, str) and re.search("[\0\ud800-\udfff]", value) is not None


def _leaves(document: Mapping[str, object], under: str, at: int, depth: int = 1) -> list[tuple[str, object]]:
    found: list[tuple[str, object]] = []
    if depth > DEEPEST:
        raise Refusal("too deep", at)
    for key, value in document.items():
        if key == "" or "." in key or INDEX.fullmatch(key):
            raise Refusal("attribute name", at, what=f"'{key}'")
        match value:
            case dict() if value:
                found += _leaves(value, f"{under}.{key}", at, depth + 1)
            case bool() | int() | float() | str() if not _is_no_text(value):
                found.append((f"{under}.{key}", value))
            case _:
                raise Refusal("attribute value", at)
    return found


def _any(conditions: Sequence[Cql2]) -> Cql2:
    return conditions[0] if len(conditions) == 1 else _call("or", *conditions)


def _property(asked: Asked) -> Cql2:
    return {"property": asked.property}


def _call(op: str, *args: object) -> Cql2:
    return {"op": op, "args": list(args)}
