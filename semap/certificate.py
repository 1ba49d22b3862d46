"""Checks a certificate: what a rule found of some rows, or that it found nothing and how far it came.

This one file is the whole checker. It imports nothing of semap, so that what it says is a second opinion: it
reads the rule's texts itself, and lays a pattern over rows in all ways, the preferred one first, as
docs/decisions/0006 says. It may be copied and run alone: `python certificate.py FILE`. Shapely is
needed where a condition asks of shapes.

A certificate that holds says: of these rows and no others of their keys, up to the stamp `known_us`, the rule
makes exactly these events in the span `from_us` to `until_us`; what else was under way in it came so far, and
ended so. That the rows are those that are stored, and that no other key had any, is for the database to say
(`semap rule verify --stored`).

Rows are lists as in semap.rules.row_json; instants are whole microseconds since 1970.
"""

from __future__ import annotations

import json
import math
import re
import sys
import unicodedata
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, date, datetime, timedelta
from decimal import Decimal
from functools import cached_property
from itertools import product
from typing import Any, NoReturn

VERSION = 1
STEPS_AT_MOST = 2_000_000
INF = math.inf
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


class Wrong(ValueError):
    """The certificate does not hold, or is none; the message says what of it."""


class Unable(Exception):
    """The certificate asks for more than this checker can work out."""


def wrong(message: str) -> NoReturn:
    raise Wrong(message)


# --- values ---

KINDS = {
    **dict.fromkeys(("stamp", "since", "confirmed"), "instant"),
    **dict.fromkeys(("attributes", "measures"), "any"),
    **dict.fromkeys(("position", "footprint"), "shape"),
    "neighbours": "array",
    **dict.fromkeys(
        ("duration_s", "track_id", "subject_id", "other_id", "instance_id", "room_id", "occupants", "x_m",
         "y_m", "door_id", "edge", "actor_id", "actor_likelihood", "actor_distance_m", "confidence"),
        "number",
    ),
    **dict.fromkeys(
        ("input", "type", "cause", "track", "subject", "other", "instance", "room", "room_uid", "concept",
         "direction", "door", "previous", "actor"),
        "text",
    ),
}  # fmt: skip
"""Of the properties of rows."""

BY_ID = {name: f"{name}_id" for name in ("track", "subject", "other", "instance", "room", "door")}
LARGEST = 1.7e308
STAMP = re.compile(r"\d{4}-\d\d-\d\d([Tt]\d\d:\d\d:\d\d(\.\d+)?([Zz]|[+-]\d\d:\d\d))?", re.ASCII)


def is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST


def instant_of(value: object) -> int | None:
    if not isinstance(value, str) or not STAMP.fullmatch(value):
        return None
    try:
        if len(value) == 10:
            found = datetime.combine(date.fromisoformat(value), datetime.min.time(), UTC)
        else:
            found = datetime.fromisoformat(value.upper())
    except ValueError:
        return None
    return (found - EPOCH) // timedelta(microseconds=1)


def as_kind(value: Any, kind: str) -> Any:
    """A value of JSON as one of a kind; None where it is of another."""
    match kind:
        case "number":
            return float(value) if is_number(value) else None
        case "text":
            return value if isinstance(value, str) else None
        case "boolean":
            return value if isinstance(value, bool) else None
        case "array":
            return value if isinstance(value, list | tuple) else None
        case "instant":
            return instant_of(value)
    return None


def at_path(value: Any, path: Sequence[str]) -> Any:
    for key in path:
        if isinstance(value, dict):
            value = value.get(key)
        elif isinstance(value, list) and re.fullmatch(r"\s*[+-]?\d+", key, re.ASCII):
            value = value[int(key)] if -len(value) <= int(key) < len(value) else None
        else:
            return None
    return value


def json_kind(value: object) -> str:
    if isinstance(value, bool):
        return "boolean"
    if isinstance(value, int | float):
        return "number"
    return type(value).__name__ if isinstance(value, str | dict) else "list"


def json_equal(a: Any, b: Any) -> bool:
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(json_equal(a[key], b[key]) for key in a)
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(map(json_equal, a, b))
    return (a is None) == (b is None) and json_kind(a) == json_kind(b) and bool(a == b)


def contains(a: Any, b: Any) -> bool:
    """JSON within JSON; of lists each item of b is in some item of a."""
    if isinstance(a, dict) and isinstance(b, dict):
        return all(key in a and contains(a[key], b[key]) for key in b)
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return all(any(contains(mine, each) for mine in a) for each in b)
    return json_equal(a, b)


def in_lower_case(text: str) -> str:
    return "".join(each.lower()[0] for each in text)


def like(text: str, pattern: str) -> bool:
    made, escaped = "", False
    for sign in pattern:
        if escaped or sign not in "%_\\":
            made, escaped = made + re.escape(sign), False
        elif sign == "\\":
            escaped = True
        else:
            made += ".*" if sign == "%" else "."
    return re.fullmatch(made, text, re.DOTALL) is not None


def written(stamp_us: int) -> str:
    stamp = EPOCH + timedelta(microseconds=stamp_us)
    return stamp.isoformat(timespec="microseconds").replace("+00:00", "Z")


# --- rows ---


@dataclass(frozen=True)
class Row:
    """One row of a stream, at a place in it."""

    place: int
    stamp_us: int
    rank: int
    uid: str
    source: str
    values: Mapping[str, Any]
    concepts: Sequence[str]

    @property
    def order(self) -> tuple[int, int, str]:
        return self.stamp_us, self.rank, self.uid


def read_row(place: int, found: Any) -> Row:
    try:
        stamp_us, rank, uid, source, values, concepts = found
    except (TypeError, ValueError):
        wrong(f"row {place} is none")
    right = type(stamp_us) is int and type(rank) is int and isinstance(uid, str) and isinstance(values, dict)
    if (
        not right
        or not isinstance(concepts, list)
        or source not in ("relation", "object_state", "map", "event")
    ):
        wrong(f"row {place} is none")
    for name, value in values.items():
        kind = KINDS.get(name)
        if kind is None:
            wrong(f"row {uid} has {name}, which is no property")
        if value is not None and kind not in ("any", "shape"):
            fits = type(value) is int if kind == "instant" else as_kind(value, kind) is not None
            if not fits:
                wrong(f"{name} of row {uid} is no {kind}")
    return Row(place, stamp_us, rank, uid, source, values, concepts)


# --- conditions: CQL2 text, read and asked ---

TOKEN = re.compile(
    r"""\s+ | (?P<number>(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?) | (?P<text>'(?:''|\\'|[^'])*')
      | (?P<quoted>"(?:""|[^"])*") | (?P<name>[^\W\d][\w.:]*)
      | (?P<sign>\{-|-\}|<>|<=|>=|\|\||[=<>+\-*/%^(),{}\[\]|?$])""",
    re.VERBOSE,
)
TIGHTNESS = {
    "or": 1, "and": 2, **dict.fromkeys(("=", "<>", "<", "<=", ">", ">="), 4),
    **dict.fromkeys(("+", "-", "||"), 5), **dict.fromkeys(("*", "/", "%", "div"), 6), "^": 7,
}  # fmt: skip
COMPARED = ("=", "<>", "<", "<=", ">", ">=")
SHAPES = {
    "point",
    "multipoint",
    "linestring",
    "multilinestring",
    "polygon",
    "multipolygon",
    "geometrycollection",
}
AGGREGATES = ("count", "sum", "avg", "min", "max", "array", "distinct", "count_distinct")
OF_ROWS = ("first", "last", *AGGREGATES)
SPANS: Mapping[str, tuple[str, ...]] = {
    "t_after": ("a0>b1",), "t_before": ("a1<b0",), "t_contains": ("a0<b0", "a1>b1"),
    "t_during": ("a0>b0", "a1<b1"),
    "t_disjoint": ("a0>b1", "a1<b0"), "t_equals": ("a0=b0", "a1=b1"), "t_finishedby": ("a0<b0", "a1=b1"),
    "t_finishes": ("a0>b0", "a1=b1"), "t_intersects": ("a0<=b1", "a1>=b0"), "t_meets": ("a1=b0",),
    "t_metby": ("a0=b1",), "t_overlappedby": ("a0>b0", "a0<b1", "a1>b1"),
    "t_overlaps": ("a0<b0", "a1>b0", "a1<b1"),
    "t_startedby": ("a0=b0", "a1>b1"), "t_starts": ("a0=b0", "a1<b1"),
}  # fmt: skip
TEXTS = ("lower", "upper", "casei", "accenti", "||", "classifier")
NUMBERS = ("abs", "floor", "ceil", "round", "length", "count", "count_distinct", "sum", "avg",
           "seconds_between", "match_number", "+", "-", "*", "/", "%", "div", "^")  # fmt: skip


@dataclass(frozen=True)
class Node:
    """op: property, value, instant, interval, shape, list, or a function or operator in lower case."""

    op: str
    args: tuple[Any, ...] = ()


class Reader:
    """Words and signs of a text, one after the other."""

    def __init__(self, text: object, what: str) -> None:
        if not isinstance(text, str):
            wrong(f"{what} is no text")
        self.text, self.what, self.at = text, what, 0
        self.tokens: list[tuple[str, str, int]] = []
        start = 0
        while start < len(text):
            found = TOKEN.match(text, start)
            if found is None:
                wrong(f"{what} cannot be read from {text[start : start + 20]!r} on")
            if found.lastgroup is not None:
                self.tokens.append((found.lastgroup, found[0], start))
            start = found.end()
        self.tokens.append(("end", "", len(text)))

    @property
    def kind(self) -> str:
        return self.tokens[self.at][0]

    @property
    def word(self) -> str:
        return self.tokens[self.at][1]

    @property
    def lower(self) -> str:
        return self.word.lower() if self.kind in ("name", "sign") else ""

    def take(self) -> str:
        word = self.word
        self.at += self.kind != "end"
        return word

    def takes(self, word: str) -> bool:
        found = self.word == word and self.kind != "end"
        self.at += found
        return found

    def takes_any_case(self, word: str) -> bool:
        found = self.lower == word
        self.at += found
        return found

    def need(self, word: str) -> None:
        if not self.takes_any_case(word):
            wrong(f"{self.what}: {word} is missing")

    def end(self) -> None:
        if self.kind != "end":
            wrong(f"{self.what}: {self.word} is left over")


def read_condition(text: object, what: str) -> Node:
    reader = Reader(text, what)
    found = expression(reader, 0)
    reader.end()
    return found


def expression(reader: Reader, tightness: int) -> Node:
    left = operand(reader)
    while True:
        word = reader.lower
        if word in ("like", "between", "in", "is", "not") and tightness < 4:
            left = predicate(reader, left)
        elif TIGHTNESS.get(word, 0) > tightness:
            reader.take()
            left = Node(word, (left, expression(reader, TIGHTNESS[word])))
        else:
            return left


def predicate(reader: Reader, left: Node) -> Node:
    is_not = reader.takes_any_case("not")
    word = reader.take().lower()
    if word == "is":
        is_not = reader.takes_any_case("not")
        reader.need("null")
        found = Node("isnull", (left,))
    elif word == "between":
        low = expression(reader, 4)
        reader.need("and")
        high = expression(reader, 4)
        found = Node("and", (Node(">=", (left, low)), Node("<=", (left, high))))
    elif word == "in":
        reader.need("(")
        found = Node("value", (False,))
        for each in listed(reader):
            found = Node("or", (found, Node("=", (left, each))))
    elif word == "like":
        found = Node("like", (left, expression(reader, 4)))
    else:
        wrong(f"{reader.what}: {word} means nothing there")
    return Node("not", (found,)) if is_not else found


def listed(reader: Reader) -> tuple[Node, ...]:
    """What stands up to the closing parenthesis."""
    found: list[Node] = []
    if reader.takes(")"):
        return ()
    while not found or reader.takes(","):
        found.append(expression(reader, 0))
    reader.need(")")
    return tuple(found)


def operand(reader: Reader) -> Node:
    kind, word = reader.kind, reader.word
    if reader.takes_any_case("not"):
        return Node("not", (expression(reader, 2),))
    if reader.takes("-"):
        inner = expression(reader, 8)
        if inner.op == "value" and is_number(inner.args[0]):
            return Node("value", (-inner.args[0],))
        return Node("*", (Node("value", (-1,)), inner))
    if reader.takes("+"):
        return expression(reader, 8)
    if reader.takes("("):
        found = listed(reader)
        return found[0] if len(found) == 1 else Node("list", found)
    reader.take()
    match kind:
        case "number":
            number = int(word) if word.isdecimal() else float(word)
            return Node("value", (int(number) if number == int(number) and abs(number) < 2**53 else number,))
        case "text":
            return Node("value", (word[1:-1].replace("''", "'").replace("\\'", "'"),))
        case "quoted":
            return Node("property", (word[1:-1].replace('""', '"'),))
        case "name":
            return named(reader, word)
    wrong(f"{reader.what}: a value is missing")


def named(reader: Reader, word: str) -> Node:
    name = word.lower()
    if name in ("true", "false", "null"):
        return Node("value", ({"true": True, "false": False, "null": None}[name],))
    if name in SHAPES and reader.lower in ("(", "z", "m", "zm", "empty"):
        return shape_literal(reader)
    if not reader.takes("("):
        return Node("property", (word,))
    if name.startswith("a_"):
        return Node(name, tuple(lists(reader)))
    args = listed(reader)
    match name, args:
        case (("timestamp" | "date"), (Node("value", (str(text),)),)):
            stamp_us = instant_of(text)
            return Node("instant", (stamp_us,)) if stamp_us is not None else wrong(f"{text} is no time")
        case "interval", (start, end):
            return Node("interval", (end_of(start), end_of(end)))
        case "bbox", _:
            half = len(args) // 2
            corners = [each.args[0] for each in (*args[:2], *args[half : half + 2])]
            return Node("shape", (shapely().box(*corners),))
        case "isa", (Node("value", (str(concept),)),):
            return Node("isa", (concept,))
    return Node(name, args)


def lists(reader: Reader) -> Iterator[Node]:
    first = True
    while first or reader.takes(","):
        first = False
        yield Node("list", listed(reader)) if reader.takes("(") else expression(reader, 0)
    reader.need(")")


def end_of(node: Node) -> Node | None:
    match node:
        case Node("value", ("..",)):
            return None
        case Node("value", (str(text),)):
            return Node("instant", (instant_of(text),))
    return node


def shapely() -> Any:
    import shapely as module  # noqa: PLC0415  (only conditions on shapes need it)

    return module


def shape_literal(reader: Reader) -> Node:
    start, depth = reader.tokens[reader.at - 1][2], 0
    while reader.kind != "end":
        place, word = reader.tokens[reader.at][2], reader.take()
        depth += (word == "(") - (word == ")")
        if depth == 0 and word.lower() in (")", "empty"):
            return Node(
                "shape", (shapely().force_2d(shapely().from_wkt(reader.text[start : place + len(word)])),)
            )
    wrong(f"{reader.what}: the shape does not end")


Chain = Sequence[tuple[str, Row]]
"""Rows bound, ascending, each with its variable."""


@dataclass(frozen=True)
class Asking:
    """What a condition is asked of: a row, with the rows bound up to it.

    whole   of a measure: all rows of the match, and the number of the match
    """

    stream: Stream
    row: Row
    chain: Chain = ()
    whole: Chain = ()
    number: int = 0

    def is_variable(self, name: str) -> bool:
        head, _, rest = name.partition(".")
        return head in self.stream.rule.labels and bool(rest or name not in KINDS)


def kind_of(node: Node, asking: Asking) -> str:
    """The kind of a value by how it is written, as CQL2 checks it."""
    match node.op:
        case "property":
            name = str(node.args[0])
            name = name.partition(".")[2] or "stamp" if asking.is_variable(name) else name
            kind = KINDS.get(name) or ("any" if KINDS.get(name.partition(".")[0]) == "any" else None)
            return kind or wrong(f"there is no property {name}")
        case "value":
            value = node.args[0]
            return "boolean" if isinstance(value, bool) else "text" if isinstance(value, str) else "number"
        case "instant" | "interval" | "shape":
            return node.op
        case "list" | "array" | "distinct":
            return "array"
        case "first" | "last" | "min" | "max" | "prev" | "next" | "final" | "running":
            return kind_of(node.args[0], asking)
    if node.op in TEXTS:
        return "text"
    return "number" if node.op in NUMBERS else "boolean"


def truth(node: Node, asking: Asking) -> bool | None:
    """True, False, or None for what is unknown."""
    match node.op:
        case "and" | "or":
            decides = node.op == "or"
            found = [truth(each, asking) for each in node.args]
            return decides if decides in found else None if None in found else not decides
        case "not":
            inner = truth(node.args[0], asking)
            return None if inner is None else not inner
        case "isnull":
            return value_of(node.args[0], asking) is None
        case "isa":
            return node.args[0] in asking.row.concepts
        case "like":
            pattern = folded(node.args[1])
            text = of_kind(node.args[0], asking, "text")
            return None if text is None else like(text, pattern)
    if node.op in COMPARED:
        return compared(node, asking)
    if node.op in SPANS:
        return spans_compared(node, asking)
    if node.op.startswith("s_"):
        return spatial(node, asking)
    if node.op.startswith("a_"):
        return arrays(node, asking)
    found = of_kind(node, asking, "boolean")
    return found if isinstance(found, bool) else None


def folded(node: Node) -> str:
    match node:
        case Node("value", (str(text),)):
            return text
        case Node("casei", (inner,)):
            return in_lower_case(folded(inner))
        case Node("accenti", (inner,)):
            return without_accents(folded(inner))
    wrong("a pattern of LIKE that is no text")


def without_accents(text: str) -> str:
    return re.sub("[\u0300-\u036f]", "", unicodedata.normalize("NFD", text))


def ordered(op: str, a: Any, b: Any) -> bool:
    match op:
        case "=":
            return bool(a == b)
        case "<>":
            return bool(a != b)
        case "<" | "<=":
            return bool(a < b or (op == "<=" and a == b))
    return bool(a > b or (op == ">=" and a == b))


def compared(node: Node, asking: Asking) -> bool | None:
    kinds = [kind_of(each, asking) for each in node.args]
    kind = next((each for each in kinds if each != "any"), "any")
    a, b = (of_kind(each, asking, kind) for each in node.args)
    if a is None or b is None:
        return None
    if kind != "any":
        return ordered(node.op, a, b)
    if node.op in ("=", "<>"):
        return json_equal(a, b) == (node.op == "=") if json_kind(a) == json_kind(b) else None
    if (is_number(a) and is_number(b)) or (isinstance(a, str) and isinstance(b, str)):
        return ordered(node.op, a, b)
    return None


def spans_compared(node: Node, asking: Asking) -> bool | None:
    ends: dict[str, Any] = {}
    for side, each in zip("ab", node.args, strict=True):
        pair = each.args if each.op == "interval" else (each, each)
        for place, (end, beyond) in enumerate(zip(pair, (-INF, INF), strict=True)):
            ends[f"{side}{place}"] = beyond if end is None else of_kind(end, asking, "instant")
    found: list[bool | None] = []
    for part in SPANS[node.op]:
        a, b = ends[part[:2]], ends[part[-2:]]
        found.append(None if a is None or b is None else ordered(part[2:-2], a, b))
    decides = node.op == "t_disjoint"
    return decides if decides in found else None if None in found else not decides


def spatial(node: Node, asking: Asking) -> bool | None:
    a, b = (of_kind(each, asking, "shape") for each in node.args)
    return None if a is None or b is None else bool(getattr(shapely(), node.op[2:])(a, b))


def arrays(node: Node, asking: Asking) -> bool | None:
    a, b = (of_kind(each, asking, "array") for each in node.args)
    if a is None or b is None:
        return None
    match node.op:
        case "a_contains":
            return contains(a, b)
        case "a_containedby":
            return contains(b, a)
        case "a_equals":
            return contains(a, b) and contains(b, a)
    return any(contains(b, [each]) for each in a)


def of_kind(node: Node, asking: Asking, kind: str) -> Any:
    found = value_of(node, asking)
    if found is None or kind == "any" or kind_of(node, asking) != "any":
        return found
    return as_kind(found, kind)


def value_of(node: Node, asking: Asking) -> Any:  # noqa: PLR0912  (a table of functions)
    match node.op:
        case "property":
            return property_of(str(node.args[0]), asking)
        case "value":
            value = node.args[0]
            return float(value) if isinstance(value, int) and abs(value) >= 2**53 else value
        case "instant" | "shape":
            return node.args[0]
        case "list":
            found = [(kind_of(each, asking), value_of(each, asking)) for each in node.args]
            return [written(each) if kind == "instant" and each is not None else each for kind, each in found]
        case "first" | "last":
            return navigated(node, asking)
        case "prev" | "next":
            return shifted(node, asking)
        case "classifier":
            variables = asking.stream.rule.members(str(node.args[0].args[0])) if node.args else None
            bound = [label for label, _ in asking.chain if variables is None or label in variables]
            return (bound[-1] or None) if bound else None
        case "match_number":
            return asking.number
        case "final":
            return value_of(node.args[0], replace(asking, row=asking.whole[-1][1], chain=asking.whole))
        case "running":
            return value_of(node.args[0], asking)
        case "seconds_between":
            a, b = (of_kind(each, asking, "instant") for each in node.args)
            return None if a is None or b is None else (b - a) / 1_000_000
    if node.op in AGGREGATES:
        return aggregated(node, asking)
    if node.op in NUMBERS or node.op in TEXTS:
        return scalar(node, asking)
    return truth(node, asking)


def scalar(node: Node, asking: Asking) -> Any:
    of = "text" if node.op in (*TEXTS, "length") else "number"
    args = [of_kind(each, asking, of) for each in node.args]
    if None in args:
        return None
    match node.op, args:
        case (("lower" | "casei"), (text,)):
            return in_lower_case(text)
        case "upper", (text,):
            return text.upper()
        case "accenti", (text,):
            return without_accents(text)
        case "||", (a, b):
            return a + b
        case "length", (text,):
            return len(text)
        case "abs", (a,):
            return abs(a)
        case (("floor" | "ceil"), (a,)):
            return getattr(math, node.op)(a)
        case "round", (a,):
            return math.copysign(math.floor(abs(a) + 0.5), a)
        case _, (a, b):
            return arithmetic(node.op, float(a), float(b))
    wrong(f"there is no function {node.op} of {len(args)} parts")


def arithmetic(op: str, a: float, b: float) -> float | None:
    try:
        match op:
            case "+":
                found = a + b
            case "-":
                found = a - b
            case "*":
                found = a * b
            case "/":
                found = a / b
            case "div":
                found = float(math.trunc(a / b))
            case "%":
                found = a - b * math.trunc(a / b)
            case _:
                found = INF if a < 0 and b != math.trunc(b) else float(a**b)
    except (ZeroDivisionError, OverflowError):
        return None
    return found if math.isfinite(found) else None


def property_of(name: str, asking: Asking) -> Any:
    if asking.is_variable(name):
        head, _, rest = name.partition(".")
        rows = bound_to(head, asking)
        return at_row(rest, rows[-1]) if rows else None
    return at_row(name, asking.row)


def at_row(name: str, row: Row) -> Any:
    if name in KINDS:
        value = row.values.get(name)
        if value is not None and KINDS[name] == "shape":
            return shapely().from_wkb(value)
        return value
    head, *path = name.split(".")
    if KINDS.get(head) != "any":
        wrong(f"there is no property {name}")
    return at_path(row.values.get(head), path)


def bound_to(name: str, asking: Asking) -> list[Row]:
    """The rows bound to a variable or a subset; all, where none is named."""
    members = asking.stream.rule.members(name) if name else None
    return [row for label, row in asking.chain if label and (members is None or label in members)]


def label_in(node: Node, asking: Asking) -> str:
    """The one variable that is asked of; empty where it is none."""
    if node.op == "property":
        name = str(node.args[0])
        return name.partition(".")[0] if asking.is_variable(name) else ""
    return next(
        (found for each in node.args if isinstance(each, Node) and (found := label_in(each, asking))), ""
    )


def bare(node: Node, label: str) -> Node:
    """What is asked of each row of the variable."""
    if node.op == "property" and label:
        return Node("property", (str(node.args[0]).partition(".")[2] or "stamp",))
    if node.op == "classifier":
        return Node("classifier")
    return Node(node.op, tuple(bare(each, label) if isinstance(each, Node) else each for each in node.args))


def of_row(node: Node, row: Row, asking: Asking) -> Any:
    """Of a row that is bound already, with the rows bound up to it."""
    chain = [each for each in asking.chain if each[1].order <= row.order]
    return value_of(node, replace(asking, row=row, chain=chain))


def offset_of(node: Node, usual: int) -> int:
    return int(node.args[1].args[0]) if len(node.args) > 1 else usual


def navigated(node: Node, asking: Asking) -> Any:
    label = label_in(node.args[0], asking)
    rows = bound_to(label, asking)
    if node.op == "last":
        rows.reverse()
    at = offset_of(node, 0)
    return of_row(bare(node.args[0], label), rows[at], asking) if at < len(rows) else None


def shifted(node: Node, asking: Asking) -> Any:
    """Of the row so many away in the stream, if it is no farther than the window."""
    inner, by = node.args[0], offset_of(node, 1)
    row: Row | None = asking.row
    if inner.op in ("first", "last"):
        label = label_in(inner.args[0], asking)
        rows = bound_to(label, asking)[:: -1 if inner.op == "last" else 1]
        at = offset_of(inner, 0)
        row, inner = rows[at] if at < len(rows) else None, bare(inner.args[0], label)
    elif label := label_in(inner, asking):
        rows = bound_to(label, asking)
        row, inner = rows[-1] if rows else None, bare(inner, label)
    if row is None:
        return None
    rows = asking.stream.rows
    place = row.place + (by if node.op == "next" else -by)
    other = replace(row, uid="", values={}, concepts=())
    if 0 <= place < len(rows) and abs(rows[place].stamp_us - row.stamp_us) < asking.stream.rule.match_us:
        other = rows[place]
    if inner.op == "classifier":
        return next((label for label, bound in asking.chain if bound.uid == other.uid), None)
    return of_row(inner, other, asking)


def aggregated(node: Node, asking: Asking) -> Any:
    inner = node.args[0] if node.args else Node("property", ("stamp",))
    label = label_in(inner, asking)
    if inner.op == "classifier" and inner.args:
        label = str(inner.args[0].args[0])
    inner = bare(inner, label)
    found = [of_row(inner, row, asking) for row in bound_to(label, asking)]
    known = [value for value in found if value is not None]
    numbers = [float(value) for value in known if is_number(value)]
    match node.op:
        case "count":
            return len(known)
        case "sum" | "avg":
            total = math.fsum(numbers) if numbers else None
            return total if total is None or node.op == "sum" else total / len(numbers)
        case "min" | "max":
            of = [value for value in known if is_number(value)] or [
                value for value in known if isinstance(value, str)
            ]
            return (min(of) if node.op == "min" else max(of)) if of else None
        case "array":
            return found or None
    once: list[Any] = []
    for value in known:
        if not any(json_equal(value, other) for other in once):
            once.append(value)
    return len(once) if node.op == "count_distinct" else once or None


# --- patterns ---

PATTERN_WORDS = {"next", "followed", "by", "any", "not", "permute", "relaxed", "until"}


@dataclass(frozen=True)
class Part:
    """A part of a pattern: variable, absent, anchor, sequence, choice, permute or repeat."""

    what: str
    name: str = ""
    parts: tuple[Part, ...] = ()
    joints: tuple[str, ...] = ()
    least: int = 1
    most: int | None = 1
    greedy: bool = True
    excluded: bool = False


def read_pattern(text: object) -> Part:
    reader = Reader(text, "pattern")
    found = choice(reader)
    reader.end()
    return found


def choice(reader: Reader) -> Part:
    options = [sequence(reader)]
    while reader.takes("|"):
        options.append(sequence(reader))
    return options[0] if len(options) == 1 else Part("choice", parts=tuple(options))


def sequence(reader: Reader) -> Part:
    parts, joints = [element(reader)], ["next"]
    while reader.kind != "end" and reader.word not in ("|", ")", ",", "-}"):
        joint = "next"
        if reader.takes("not"):
            if not reader.takes("next"):
                reader.need("followed")
                reader.need("by")
                joint = "relaxed"
            parts.append(Part("absent", variable(reader)))
        else:
            if reader.takes("followed"):
                reader.need("by")
                joint = "any" if reader.takes("any") else "relaxed"
            else:
                reader.takes("next")
            parts.append(element(reader))
        joints.append(joint)
    return parts[0] if len(parts) == 1 else Part("sequence", parts=tuple(parts), joints=tuple(joints))


def element(reader: Reader) -> Part:
    inner = unquantified(reader)
    least, most = {"?": (0, 1), "*": (0, None), "+": (1, None)}.get(reader.word, (1, 1))
    if reader.takes("{"):
        least, most = counts(reader)
    elif (least, most) == (1, 1):
        return inner
    else:
        reader.take()
    greedy = not reader.takes("?")
    joint = between(reader)
    until = variable(reader) if reader.takes("until") else ""
    return Part("repeat", until, (inner,), (joint,), least, most, greedy)


def counts(reader: Reader) -> tuple[int, int | None]:
    least = int(reader.take()) if reader.kind == "number" else None
    most: int | None = least
    if reader.takes(","):
        most = int(reader.take()) if reader.kind == "number" else None
    elif least is None:
        wrong("pattern: a quantifier without a count")
    reader.need("}")
    return least or 0, most


def between(reader: Reader) -> str:
    return "relaxed" if reader.takes("relaxed") else "any" if reader.takes("any") else "next"


def unquantified(reader: Reader) -> Part:
    if reader.word in ("^", "$"):
        return Part("anchor", reader.take())
    if reader.takes("{-"):
        inner = choice(reader)
        reader.need("-}")
        return excluded(inner)
    if reader.takes("("):
        if reader.takes(")"):
            return Part("sequence")
        inner = choice(reader)
        reader.need(")")
        return inner
    if reader.takes("permute"):
        reader.need("(")
        parts = [choice(reader)]
        while reader.takes(","):
            parts.append(choice(reader))
        reader.need(")")
        return Part("permute", parts=tuple(parts), joints=(between(reader),))
    return Part("variable", variable(reader))


def excluded(part: Part) -> Part:
    return replace(part, excluded=part.what == "variable", parts=tuple(map(excluded, part.parts)))


def variable(reader: Reader) -> str:
    if reader.kind != "name" or reader.word in PATTERN_WORDS:
        wrong(f"{reader.what}: a variable is missing")
    return reader.take()


def names_in(part: Part) -> Iterator[tuple[str, str]]:
    """What kind of part each name is of."""
    if part.name and part.what != "anchor":
        yield part.what, part.name
    for each in part.parts:
        yield from names_in(each)


Absences = tuple[tuple[str, str | None], ...]
Way = tuple[object, ...]


@dataclass(frozen=True)
class Entry:
    """What was crossed since the last row: the joint there, before which part, and what is to be absent."""

    joint: str | None = None
    before: Way = ()
    absences: Absences = ()

    def crossing(self, joint: str, before: Way) -> Entry:
        return replace(self, joint=joint, before=before)


@dataclass(frozen=True)
class Step:
    """A row that may be bound next, by the way that leads to it; without a variable the pattern ends."""

    way: Way
    variable: str | None
    entry: Entry
    scopes: tuple[tuple[Way, str], ...] = ()
    excluded: bool = False
    onward: Callable[[], Iterator[Step]] | None = field(default=None, compare=False)


Onward = Callable[[Entry, bool], Iterator[Step]]
Scopes = tuple[tuple[Way, str], ...]


def ways(part: Part, way: Way, scopes: Scopes, entry: Entry, onward: Onward) -> Iterator[Step]:
    """The steps with which a part can begin, the preferred first; `onward` is what follows on it."""
    match part.what:
        case "variable":
            yield Step(way, part.name, entry, scopes, part.excluded, lambda: onward(Entry(), True))
        case "absent" | "anchor":
            joint = entry.joint if part.what == "absent" else None
            yield from onward(replace(entry, absences=(*entry.absences, (part.name, joint))), False)
        case "sequence":
            yield from in_order(part, 0, way, scopes, entry, False, onward)
        case "choice":
            for place, option in enumerate(part.parts):
                yield from ways(option, (*way, f"|{place}"), scopes, entry, onward)
        case "permute":
            left = tuple(range(len(part.parts)))
            yield from any_order(part, left, (*way, "permute"), scopes, entry, (False, False), onward)
        case "repeat":
            yield from rounds(part, 0, way, scopes, entry, (False, False), onward)


def in_order(
    part: Part, place: int, way: Way, scopes: Scopes, entry: Entry, bound: bool, onward: Onward
) -> Iterator[Step]:
    if place == len(part.parts):
        yield from onward(entry, bound)
        return
    there = (*way, place)
    if bound:
        entry = entry.crossing(part.joints[place], there)

    def then(left: Entry, more: bool) -> Iterator[Step]:
        return in_order(part, place + 1, way, scopes, left, bound or more, onward)

    yield from ways(part.parts[place], there, scopes, entry, then)


def any_order(
    part: Part,
    left: tuple[int, ...],
    way: Way,
    scopes: Scopes,
    entry: Entry,
    bound: tuple[bool, bool],
    onward: Onward,
) -> Iterator[Step]:
    """bound: whether the part before has bound a row, and whether any has."""
    if not left:
        yield from onward(entry, bound[1])
        return
    for place in left:
        there = (*way, f"&{place}")
        others = tuple(other for other in left if other != place)

        def then(
            after: Entry, more: bool, there: Way = there, others: tuple[int, ...] = others
        ) -> Iterator[Step]:
            return any_order(part, others, there, scopes, after, (more, bound[1] or more), onward)

        crossed = entry.crossing(part.joints[0], there) if bound[0] else entry
        yield from ways(part.parts[place], there, scopes, crossed, then)


def rounds(
    part: Part, done: int, way: Way, scopes: Scopes, entry: Entry, bound: tuple[bool, bool], onward: Onward
) -> Iterator[Step]:
    if done == part.most:
        yield from onward(entry, bound[1])
        return
    there = (*way, f"round {done}")
    inner = (*scopes, (way, part.name)) if part.name else scopes

    def then(after: Entry, more: bool) -> Iterator[Step]:
        if done >= part.least and not more:
            return onward(after, bound[1])
        return rounds(part, done + 1, way, scopes, after, (more, bound[1] or more), onward)

    if done >= part.least and not part.greedy:
        yield from onward(entry, bound[1])
    crossed = entry.crossing(part.joints[0], there) if bound[0] else entry
    yield from ways(part.parts[0], there, inner, crossed, then)
    if done >= part.least and part.greedy:
        yield from onward(entry, bound[1])


# --- a pattern laid over the rows of a key ---


@dataclass(frozen=True)
class Option:
    """A step that a run may take; of an end, `waits` are absences that are not sure yet, with their ends."""

    step: Step
    until_us: float
    waits: tuple[tuple[str, str | None, float], ...] = ()
    stamp_us: float = 0


@dataclass(frozen=True)
class Run:
    """A way to lay the beginning of the pattern over rows; `chain` is of places in the stream."""

    chain: tuple[tuple[str, int], ...]
    options: tuple[Option, ...]
    hidden: tuple[int, ...] = ()
    scopes: Scopes = ()

    @property
    def has_ended(self) -> bool:
        return bool(self.options) and self.options[0].step.variable is None and not self.options[0].waits


@dataclass(frozen=True)
class Ending:
    """A match, or a time-out; `told` is when it was certain."""

    start: int
    chain: tuple[tuple[str, int], ...]
    stamp_us: float
    hidden: tuple[int, ...] = ()
    told: tuple[float, int] = (0, 0)


@dataclass
class Attempt:
    """All that began with one row.

    matches   it came to these, the preferred first (without `no skip` at most one)
    furthest  the longest of its runs, and what could have come next
    ended     by the row at this place, or by the end of a window [us]; None: it is still open
    """

    start: int
    matches: list[Ending] = field(default_factory=list)
    timeout: Ending | None = None
    furthest: Run | None = None
    ended: tuple[str, float] | None = None
    open_runs: tuple[Run, ...] = ()


class Laying:
    """One pattern over one stream."""

    def __init__(self, stream: Stream, pattern: Part, rows: Sequence[Row], *, keeps_all: bool) -> None:
        self.stream, self.rule, self.rows = stream, stream.rule, rows
        self.pattern = pattern
        self.keeps_all = keeps_all
        self.reads_bound = any(map(asks_bound, stream.rule.define.values()))
        self.after: dict[Way, tuple[Step, ...]] = {}

    def attempt(self, start: int, known_us: int) -> Attempt:
        """All that comes of a start, by rows and time up to a stamp."""
        attempt = Attempt(start)
        runs = self.row_taken([Run((), self.options((), self.first_steps(), start))], start, start, attempt)
        for place in range(start + 1, len(self.rows)):
            runs = self.time_passed(
                runs, self.rows[place].stamp_us, (self.rows[place].stamp_us, place), attempt
            )
            if not runs or self.is_decided(runs):
                break
            runs = self.row_taken(runs, place, start, attempt)
            if not runs or self.is_decided(runs):
                break
        else:
            runs = self.time_passed(runs, known_us + 1, (known_us + 1, len(self.rows)), attempt)
        if runs and self.is_decided(runs):
            attempt.matches = [self.ending(runs[0], start, attempt)]
            runs = []
        attempt.open_runs = tuple(runs)
        return attempt

    def is_decided(self, runs: Sequence[Run]) -> bool:
        return not self.keeps_all and runs[0].has_ended

    def ending(self, run: Run, start: int, attempt: Attempt) -> Ending:
        return Ending(start, run.chain, run.options[0].stamp_us, run.hidden)

    def first_steps(self) -> tuple[Step, ...]:
        if () not in self.after:
            self.after[()] = self.distinct(ways(self.pattern, ("",), (), Entry(), ended))
        return self.after[()]

    def steps_after(self, step: Step) -> tuple[Step, ...]:
        if step.way not in self.after:
            assert step.onward is not None  # noqa: S101
            self.after[step.way] = self.distinct(step.onward())
        return self.after[step.way]

    def distinct(self, steps: Iterator[Step]) -> tuple[Step, ...]:
        kept: dict[Step, Step] = {}
        for each in steps:
            self.stream.spend()
            kept.setdefault(each, each)
        return tuple(kept.values())

    def options(
        self, chain: tuple[tuple[str, int], ...], steps: Iterable[Step], start: int
    ) -> tuple[Option, ...]:
        """What may come next, and until when."""
        found = []
        first_us = self.rows[start].stamp_us
        last_us = self.rows[chain[-1][1]].stamp_us if chain else first_us
        for step in steps:
            signs = {name for name, _ in step.entry.absences}
            if "^" in signs and (chain or start):
                continue
            if step.variable is None:
                waits = tuple(
                    (name, joint, self.absent_until_us(name, first_us, last_us))
                    for name, joint in step.entry.absences
                    if name != "^"
                )
                if waits and not chain:
                    continue
                stamp_us = max((until for name, _, until in waits if name != "$"), default=last_us)
                found.append(Option(step, INF, waits, stamp_us))
            elif chain or "$" not in signs:
                own_us = self.rule.windows.get(step.variable, INF)
                until_us = min(first_us + self.rule.match_us, last_us + min(self.rule.step_us, own_us))
                found.append(Option(step, until_us if chain else INF))
        return self.cut(found)

    def cut(self, found: Sequence[Option]) -> tuple[Option, ...]:
        """Without those that an end, which is sure, is preferred to."""
        sure = next(
            (n for n, each in enumerate(found) if each.step.variable is None and not each.waits), None
        )
        return tuple(found if sure is None or self.keeps_all else found[: sure + 1])

    def absent_until_us(self, name: str, first_us: int, last_us: int) -> float:
        own_us = self.rule.windows.get(name)
        return first_us + self.rule.match_us if own_us is None else last_us + own_us

    def holds(self, name: str, run: Run, row: Row) -> bool:
        """Whether a row satisfies the condition of a variable after the rows of a run."""
        self.stream.spend()
        if run.chain:
            last = self.rows[run.chain[-1][1]]
            if row.stamp_us - last.stamp_us >= self.rule.windows.get(name, INF):
                return False
        condition = self.rule.define.get(name)
        if condition is None:
            return True
        chain = [*((label, self.rows[place]) for label, place in run.chain), (name, row)]
        return truth(condition, Asking(self.stream, row, chain)) is True

    def can_bind(self, option: Option, run: Run, row: Row) -> bool:
        step = option.step
        assert step.variable is not None  # noqa: S101
        return (
            row.stamp_us < option.until_us
            and self.holds(step.variable, run, row)
            and not any(self.holds(name, run, row) for _, name in step.scopes)
            and not self.is_disturbed(step.entry.absences, run, row)
        )

    def is_disturbed(self, absences: Absences, run: Run, row: Row) -> bool:
        if not run.chain:
            return False
        is_next = row.place == run.chain[-1][1] + 1
        return any((joint != "next" or is_next) and self.holds(name, run, row) for name, joint in absences)

    def row_taken(self, runs: Sequence[Run], place: int, start: int, attempt: Attempt) -> list[Run]:
        """All runs after a row, the preferred first."""
        row = self.rows[place]
        found: list[Run] = []
        for run in runs:
            if run.has_ended and not self.keeps_all:
                found.append(run)
                break
            self.taken_by(run, row, start, found)
        runs = self.kept(found, start, (row.stamp_us, place), attempt)
        self.note(runs, attempt, ("row", place))
        return runs

    def taken_by(self, run: Run, row: Row, start: int, found: list[Run]) -> None:
        left: list[Option] = []
        can_bind = {option: self.can_bind(option, run, row) for option in run.options if option.step.variable}
        before = {option.step.entry.before for option, can in can_bind.items() if can}
        for option in run.options:
            step = option.step
            if step.variable is None:
                waits = [each for each in option.waits if not self.is_over(each, run, row)]
                if not any(self.is_disturbed(((name, joint),), run, row) for name, joint, _ in waits):
                    found.append(replace(run, options=(replace(option, waits=tuple(waits)),)))
                continue
            if can_bind[option]:
                chain = (*run.chain, (step.variable, row.place))
                hidden = (*run.hidden, row.place) if step.excluded else run.hidden
                found.append(
                    Run(chain, self.options(chain, self.steps_after(step), start), hidden, step.scopes)
                )
            if run.chain and not self.is_passed_over(option, run, row, before):
                left.append(option)
        if left:
            found.append(replace(run, options=tuple(left)))

    def is_passed_over(self, option: Option, run: Run, row: Row, before: set[Way]) -> bool:
        """Whether the step cannot be taken any more once this row is left out."""
        entry = option.step.entry
        if entry.joint == "next" or (entry.joint == "relaxed" and entry.before in before):
            return True
        staying = [name for scope in option.step.scopes if scope in run.scopes for name in (scope[1],)]
        return self.is_disturbed(entry.absences, run, row) or any(
            self.holds(name, run, row) for name in staying
        )

    @staticmethod
    def is_over(wait: tuple[str, str | None, float], run: Run, row: Row) -> bool:
        return row.stamp_us >= wait[2]

    def kept(self, runs: Sequence[Run], start: int, told: tuple[float, int], attempt: Attempt) -> list[Run]:
        """The runs that may come to something, without those that others are like and preferred to."""
        found: dict[object, Run] = {}
        for each in runs:
            self.stream.spend()
            run = each
            if not run.options:
                continue
            if self.keeps_all:
                options = []
                for option in run.options:
                    if option.step.variable is None and not option.waits:
                        end = Ending(start, run.chain, option.stamp_us, run.hidden, told)
                        if end.chain not in {each.chain for each in attempt.matches}:
                            attempt.matches.append(end)
                    else:
                        options.append(option)
                run = replace(run, options=tuple(options))
                if not run.options:
                    continue
            last = run.chain[-1][1] if run.chain else None
            key = run.chain if self.keeps_all or self.reads_bound else (len(run.chain), last)
            found.setdefault((key, run.options, run.scopes), run)
            if run.has_ended:
                break
        return list(found.values())

    def time_passed(
        self, runs: Sequence[Run], now_us: float, told: tuple[float, int], attempt: Attempt
    ) -> list[Run]:
        """The runs when no row comes any more with a stamp before now."""
        found: list[Run] = []
        for run in runs:
            options = []
            for option in run.options:
                waits = tuple(each for each in option.waits if each[2] > now_us)
                if option.step.variable is None:
                    options.append(replace(option, waits=waits))
                elif option.until_us > now_us:
                    options.append(option)
            found.append(replace(run, options=self.cut(options)))
        kept = self.kept(found, attempt.start, told, attempt)
        if runs and not kept and not attempt.matches:
            self.timed_out(runs, attempt)
        return kept

    def timed_out(self, runs: Sequence[Run], attempt: Attempt) -> None:
        best: tuple[float, int] | None = None
        for run in runs:
            ends = max(
                (each.until_us for each in run.options if each.step.variable is not None), default=-INF
            )
            if ends > -INF and (best is None or (ends, len(run.chain)) > best):
                best = ends, len(run.chain)
                attempt.timeout = Ending(attempt.start, run.chain, ends, run.hidden)
        if best is not None:
            attempt.ended = "time", best[0]

    def note(self, runs: Sequence[Run], attempt: Attempt, by: tuple[str, float]) -> None:
        """Take in how far the attempt has come."""
        attempt.ended = None if runs else by
        if runs:
            furthest = max(runs, key=lambda run: len(run.chain))
            if attempt.furthest is None or len(furthest.chain) >= len(attempt.furthest.chain):
                attempt.furthest = furthest


def ended(entry: Entry, bound: bool) -> Iterator[Step]:
    yield Step(("end",), None, replace(entry, joint=None, before=()))


def nodes_in(node: Node) -> Iterator[Node]:
    yield node
    for each in node.args:
        if isinstance(each, Node):
            yield from nodes_in(each)


def asks_bound(node: Node) -> bool:
    """Whether a condition may ask of rows bound; said too often rather than too seldom."""
    if node.op in (*OF_ROWS, "classifier"):
        return True
    if node.op == "property" and "." in str(node.args[0]):
        return KINDS.get(str(node.args[0]).partition(".")[0]) != "any"
    return any(asks_bound(each) for each in node.args if isinstance(each, Node))


def told_of(
    stream: Stream, pattern: Part, known_us: int
) -> tuple[list[Attempt], list[tuple[str, Ending, int]]]:
    """Every attempt by itself, and what the rule makes of them: (outcome, ending, number of the match)."""
    rule = stream.rule
    ready = [
        row
        for row in stream.rows
        if row.place + rule.ahead < len(stream.rows) or known_us + 1 - row.stamp_us >= rule.match_us
    ]
    known_us = min([known_us, *(row.stamp_us - 1 for row in stream.rows[len(ready) :][:1])])
    keeps_all = rule.skip in ("none", "clear")
    laying = Laying(stream, pattern, ready, keeps_all=keeps_all)
    attempts = [laying.attempt(start, known_us) for start in range(len(ready))]
    if rule.skip == "clear":
        ends = cleared(attempts)
    elif rule.skip == "none":
        ends = [each for attempt in attempts for each in attempt.matches or attempt_timeout(attempt)]
    else:
        ends = [
            each
            for attempt in in_succession(attempts, rule)
            for each in attempt.matches or attempt_timeout(attempt)
        ]
    found = []
    timeouts = {id(attempt.timeout) for attempt in attempts}
    number = 0
    for end in ends:
        is_match = id(end) not in timeouts
        number += is_match
        outcome = "timeout" if not is_match else "match" if end.chain else "empty"
        found.append((outcome, end, number))
    if "unmatched" in rule.emit:
        having = {place for outcome, end, _ in found if outcome == "match" for _, place in end.chain}
        having |= {end.start for outcome, end, _ in found if outcome == "empty"}
        sure = next((each.start for each in attempts if each.open_runs), len(ready))
        lone = [place for place in range(sure) if place not in having]
        found += [("unmatched", Ending(at, (("", at),), stream.rows[at].stamp_us), 0) for at in lone]
    if keeps_all:
        # how far one came is known of each by itself, with its one match
        alone = Laying(stream, pattern, ready, keeps_all=False)
        attempts = [alone.attempt(start, known_us) for start in range(len(ready))]
    return attempts, found


def attempt_timeout(attempt: Attempt) -> list[Ending]:
    return [] if attempt.timeout is None else [attempt.timeout]


def cleared(attempts: Sequence[Attempt]) -> list[Ending]:
    """All matches that are certain at one moment, then none that has begun by then."""
    found: list[Ending] = []
    begin, left = 0, [each for attempt in attempts for each in attempt.matches]
    while left := [each for each in left if each.start >= begin]:
        first = min(each.told for each in left)
        now = [each for each in left if each.told == first]
        found += now
        begin = first[1] + 1 if first[1] in {place for each in now for _, place in each.chain} else first[1]
    return found


def in_succession(attempts: Sequence[Attempt], rule: Rule) -> Iterator[Attempt]:
    """The attempts that count: those that no match skips, as far as that is certain."""
    begin = blocked = 0
    waits = False
    for attempt in attempts:
        if attempt.start < begin:
            continue
        if attempt.open_runs:
            waits = waits or rule.counts
            if rule.skip != "to next":
                blocked = max(blocked, could_skip(attempt, rule, len(attempts)))
        elif attempt.start < blocked or waits:
            continue
        else:
            if attempt.matches:
                begin = skipped_to(attempt.matches[0].chain, attempt.start, rule)
            yield attempt


def could_skip(attempt: Attempt, rule: Rule, everything: int) -> int:
    reach = 0
    for run in attempt.open_runs:
        bound = {label for label, _ in run.chain} & rule.skip_to
        is_known = (
            bool(bound)
            if rule.skip == "to first"
            else all(each.step.variable is None for each in run.options)
        )
        reach = max(reach, skipped_to(run.chain, attempt.start, rule) if is_known else everything)
    return reach


def skipped_to(chain: Sequence[tuple[str, int]], start: int, rule: Rule) -> int:
    """The place of the first row at which the next attempt may begin."""
    if not chain or rule.skip == "to next":
        return start + 1
    if rule.skip == "past last":
        return chain[-1][1] + 1
    places = [place for label, place in chain if label in rule.skip_to]
    target = (places[0] if rule.skip == "to first" else places[-1]) if places else start
    if rule.strict and target == start:
        wrong("after_match: a match has no row to skip to, which puts the rule out of force")
    return target if target > start else start + 1


# --- intervals ---

ALLEN: Mapping[str, Callable[[float, float, float, float], bool]] = {
    "before": lambda a, b, c, d: b < c,
    "meets": lambda a, b, c, d: b == c,
    "overlaps": lambda a, b, c, d: a < c < b < d,
    "finishedby": lambda a, b, c, d: a < c and b == d,
    "contains": lambda a, b, c, d: a < c and d < b,
    "starts": lambda a, b, c, d: a == c and b < d,
    "equals": lambda a, b, c, d: a == c and b == d,
    "startedby": lambda a, b, c, d: a == c and d < b,
    "during": lambda a, b, c, d: c < a and b < d,
    "finishes": lambda a, b, c, d: c < a and b == d,
    "overlappedby": lambda a, b, c, d: c < a < d < b,
    "metby": lambda a, b, c, d: a == d,
    "after": lambda a, b, c, d: d < a,
}
INTERSECTS = set(ALLEN) - {"before", "meets", "metby", "after"}


@dataclass(frozen=True)
class Lasting:
    """What holds from a row until before another; without one it is not known how long."""

    variable: str
    begin: Row
    end: Row | None


def subject_of(row: Row) -> tuple[Any, ...] | None:
    values = row.values
    if row.source == "object_state":
        return values.get("input"), None, values.get("instance_id"), None, None
    if row.source == "relation" and values.get("type") != "crossed":
        return tuple(
            values.get(name) for name in ("input", "track_id", "instance_id", "subject_id", "other_id")
        )
    return None


def begun(row: Row, names: Iterable[str], stream: Stream, asked: Row | None = None) -> list[str]:
    if row.source != "object_state" and not (row.source == "relation" and row.values.get("type") == "began"):
        return []
    return [name for name in names if satisfies(row, name, stream, asked)]


def satisfies(row: Row, name: str, stream: Stream, asked: Row | None = None) -> bool:
    """asked  the row at which a formula is asked, of which its atoms may ask"""
    condition = stream.rule.define.get(name)
    chain = [(name, row)]
    if asked is not None and stream.rule.when not in (None, name):
        chain.insert(0, (str(stream.rule.when), asked))
    return condition is None or truth(condition, Asking(stream, row, chain)) is True


def lasting(stream: Stream, names: Iterable[str]) -> list[Lasting]:
    found: list[Lasting] = []
    for row in stream.rows:
        for name in begun(row, names, stream):
            later = (other for other in stream.rows[row.place + 1 :] if subject_of(other) == subject_of(row))
            found.append(Lasting(name, row, next(later, None)))
    return [each for each in found if each.end is None or each.end.stamp_us > each.begin.stamp_us]


def pairs_in_relation(stream: Stream, known_us: int) -> Iterator[tuple[Chain, int]]:
    """Pairs of intervals, each with the moment at which their relation is certain and wanted."""
    left, wanted, right = stream.rule.relation
    held = lasting(stream, (left, right))
    for one, other in product(held, held):
        if (one.variable, other.variable) != (left, right) or one.begin.order == other.begin.order:
            continue
        rows = [(each, row) for each in (one, other) for row in (each.end, each.begin) if row is not None]
        for moment in sorted({row.stamp_us for _, row in rows}):
            if moment < max(one.begin.stamp_us, other.begin.stamp_us) or moment > known_us:
                continue
            if moment - min(one.begin.stamp_us, other.begin.stamp_us) >= stream.rule.match_us:
                break
            if possible(one, other, moment) <= wanted:
                chain = [
                    (row.order, row is each.begin, each.variable, row)
                    for each, row in rows
                    if row.stamp_us <= moment
                ]
                yield [(label, row) for _, _, label, row in sorted(chain, key=lambda each: each[:2])], moment
                break


def possible(one: Lasting, other: Lasting, moment: int) -> set[str]:
    """The relations that two begun intervals may turn out to have, by what is known at a moment."""
    later = (moment + 1, moment + 2)
    ends = [
        (each.end.stamp_us,) if each.end and each.end.stamp_us <= moment else later for each in (one, other)
    ]
    return {
        name
        for end, other_end in product(*ends)
        for name, holds in ALLEN.items()
        if holds(one.begin.stamp_us, end, other.begin.stamp_us, other_end)
    }


# --- formulas ---

FALSE, UNKNOWN, TRUE = 0, 1, 2
FORMULA_WORDS = {"not", "and", "or", "implies", "always", "eventually", "until", "true", "false", "inf",
                 "once", "historically", "since", "previous", "exists", "forall"}  # fmt: skip
LATER = "@later"
UNARY = ("always", "eventually", "once", "historically", "previous")


@dataclass(frozen=True)
class Formula:
    """op: atom, exists, constant, not, and, or, until, since or one of UNARY; bounds in microseconds."""

    op: str
    parts: tuple[Formula, ...] = ()
    name: str = ""
    value: int = FALSE
    least: float = 0
    most: float = INF


def read_formula(text: object) -> Formula:
    reader = Reader(text, "formula")
    found = implied(reader)
    reader.end()
    return found


def implied(reader: Reader) -> Formula:
    left = joined(reader, "or")
    if reader.takes("implies"):
        return Formula("or", (Formula("not", (left,)), implied(reader)))
    return left


def joined(reader: Reader, word: str) -> Formula:
    def part() -> Formula:
        return joined(reader, "and") if word == "or" else reaching(reader)

    parts = [part()]
    while reader.takes(word):
        parts.append(part())
    return parts[0] if len(parts) == 1 else Formula(word, tuple(parts))


def reaching(reader: Reader) -> Formula:
    left = prefixed(reader)
    for word in ("until", "since"):
        if reader.takes(word):
            least, most = bounds(reader)
            return Formula(word, (left, prefixed(reader)), least=least, most=most)
    return left


def prefixed(reader: Reader) -> Formula:
    if reader.takes("not"):
        return Formula("not", (prefixed(reader),))
    for word in UNARY:
        if reader.takes(word):
            least, most = bounds(reader)
            return Formula(word, (prefixed(reader),), least=least, most=most)
    if reader.takes("exists"):
        return Formula("exists", name=atom(reader.take()), parts=(prefixed(reader),))
    if reader.takes("forall"):
        name = atom(reader.take())
        return Formula("not", (Formula("exists", (Formula("not", (prefixed(reader),)),), name),))
    if reader.takes("("):
        found = implied(reader)
        reader.need(")")
        return found
    word = reader.take()
    if word in ("true", "false"):
        return Formula("constant", value=TRUE if word == "true" else FALSE)
    return Formula("atom", name=atom(word))


def atom(word: str) -> str:
    if word in FORMULA_WORDS or not re.fullmatch(r"[A-Za-z_]\w*", word):
        wrong("formula: a variable is missing")
    return word


def bounds(reader: Reader) -> tuple[float, float]:
    if not reader.takes("["):
        return 0, INF
    least = bound(reader)
    reader.need(",")
    most = INF if reader.takes("inf") else bound(reader)
    reader.need("]")
    return least, most


def bound(reader: Reader) -> int:
    number = reader.take()
    unit = reader.take() if reader.kind == "name" else "s"
    return duration_us(f"{number} {unit}", "formula")


Course = list[tuple[float, int]]
"""A value over time: from each of these moments on, up to the next; the first is before all rows."""


def at(course: Course, moment: float) -> int:
    return next(value for begin, value in reversed(course) if begin <= moment)


def within(course: Course, begin: float, end: float) -> list[int]:
    """The values from a moment to another, both included."""
    return [value for (start, value), (then, _) in zip(course, [*course[1:], (INF, 0)], strict=True)
            if start <= end and begin < then]  # fmt: skip


class Timeline:
    """A formula's value over time, where the atoms are known up to a moment and what is later is not."""

    def __init__(
        self, atoms: Mapping[str, Course], moments: Sequence[int], reach_us: float, known_us: float
    ) -> None:
        self.begin = (moments[0] if moments else 0) - reach_us - 10
        self.known_us = known_us
        self.moments = [each for each in moments if each <= known_us]
        self.atoms = {
            name: [
                (self.begin, FALSE),
                *(each for each in course if each[0] <= known_us),
                (known_us + 1, UNKNOWN),
            ]
            for name, course in atoms.items()
        }

    def course(self, formula: Formula) -> Course:
        parts = [self.course(part) for part in formula.parts]
        match formula.op:
            case "atom":
                return self.atoms[formula.name]
            case "constant":
                return [(self.begin, formula.value)]
            case "not":
                return [(begin, TRUE - value) for begin, value in parts[0]]
            case "and" | "or":
                junction = min if formula.op == "and" else max
                points = sorted({begin for part in parts for begin, _ in part})
                return [(point, junction(at(part, point) for part in parts)) for point in points]
        changes = {begin for part in parts for begin, _ in part}
        if formula.op == "previous":
            changes |= {*self.moments, self.known_us + 1, self.known_us + 2}
        signs = (1,) if formula.op in ("once", "historically", "since", "previous") else (-1,)
        near: set[float] = {
            change + sign * by + more
            for change in changes
            for sign in signs
            for by in (0, formula.least, formula.most)
            for more in (-1, 0, 1)
            if by < INF
        }
        moments = sorted({self.begin, *(each for each in near | changes if each > self.begin)})
        return [(point, self.value(formula, parts, point)) for point in moments]

    def value(self, formula: Formula, parts: Sequence[Course], moment: float) -> int:
        least, most = formula.least, formula.most
        match formula.op:
            case "eventually":
                return max(within(parts[0], moment + least, moment + most))
            case "always":
                return min(within(parts[0], moment + least, moment + most))
            case "once":
                return max(within([(-INF, parts[0][0][1]), *parts[0]], moment - most, moment - least))
            case "historically":
                return min(within([(-INF, parts[0][0][1]), *parts[0]], moment - most, moment - least))
            case "previous":
                return self.previous(parts[0], moment, least, most)
        left, right = parts
        found = FALSE
        if formula.op == "until":
            for when in [moment + least, *(b for b, _ in right if moment + least < b <= moment + most)]:
                held = within(left, moment, when - 1) if when > moment else []
                found = max(found, min([at(right, when), *held]))
            return found
        begin = max(moment - most, self.begin)
        if moment - least < begin:
            return found
        ends = [then - 1 for then, _ in right[1:]]
        for when in [moment - least, *(end for end in ends if begin <= end < moment - least)]:
            held = within(left, when + 1, moment) if when < moment else []
            found = max(found, min([at(right, when), *held]))
        return found

    def previous(self, part: Course, moment: float, least: float, most: float) -> int:
        if moment > self.known_us + 1:
            return UNKNOWN
        before = [each for each in self.moments if each < moment]
        return at(part, before[-1]) if before and least <= moment - before[-1] <= most else FALSE


def without_tautologies(formula: Formula) -> Formula:
    """With each part that is the same whatever its atoms are as that constant."""
    names = sorted(atoms_of(formula))
    if is_propositional(formula):
        if len(names) > 8:
            return formula
        found = {
            settled(formula, dict(zip(names, values, strict=True)))
            for values in product((FALSE, TRUE), repeat=len(names))
        }
        return Formula("constant", value=found.pop()) if len(found) == 1 else formula
    return replace(formula, parts=tuple(map(without_tautologies, formula.parts)))


def settled(formula: Formula, atoms: Mapping[str, int]) -> int:
    courses = {name: [(0.0, value)] for name, value in atoms.items()}
    return at(Timeline(courses, [0], 0, 0).course(formula), 0)


def is_propositional(formula: Formula) -> bool:
    return formula.op in ("atom", "constant", "not", "and", "or") and all(
        map(is_propositional, formula.parts)
    )


def has_previous(formula: Formula) -> bool:
    return formula.op == "previous" or any(map(has_previous, formula.parts))


def atoms_of(formula: Formula) -> set[str]:
    """The atoms, and the variables of quantifiers."""
    own = {formula.name} if formula.op in ("atom", "exists") else set()
    return own.union(*map(atoms_of, formula.parts))


def variables_of(formula: Formula) -> set[str]:
    own = {formula.name} if formula.op == "exists" else set()
    return own.union(*map(variables_of, formula.parts))


def reach_of(formula: Formula) -> float:
    own = sum(each for each in (formula.least, formula.most) if each < INF)
    return own + sum(map(reach_of, formula.parts))


def evaluations(stream: Stream, known_us: int) -> Iterator[tuple[Row, int, int, set[tuple[str, str]]]]:
    """Of each row at which the formula is asked the verdict, when it is certain, and what changed then."""
    rule = stream.rule
    assert rule.formula is not None  # noqa: S101
    formula = without_tautologies(rule.formula)
    names = sorted(atoms_of(rule.formula))
    moments = sorted({row.stamp_us for row in stream.rows})
    busy_until = -INF
    variables = variables_of(formula)
    is_relative = bool(variables) or any(asks_bound(rule.define[name]) for name in names)
    intervals = list(lasting_rows(stream)) if variables else []
    known = courses(stream, names, stream.rows[0]) if stream.rows and not is_relative else None
    for row in stream.rows:
        if row.stamp_us <= busy_until or not starts(row, names, stream):
            continue
        atoms, changes = known or courses(stream, names, row)
        chain = [(rule.when, row)] if rule.when is not None else []
        plain = written_out(formula, chain, (), intervals, stream, atoms) if variables else formula
        found = first_verdict(plain, atoms, moments, row.stamp_us, known_us, stream)
        if rule.when is None:
            busy_until = INF if found is None else found[0]
        if found is not None:
            yield row, found[1], found[0], changes.get(found[0], set())


def lasting_rows(stream: Stream) -> Iterator[tuple[Row, Course]]:
    """Each row that begins something, and when that lasts."""
    for row in stream.rows:
        if begun(row, ("",), stream):
            later = (other for other in stream.rows[row.place + 1 :] if subject_of(other) == subject_of(row))
            end = next(later, None)
            if end is None or end.stamp_us > row.stamp_us:
                yield row, [(row.stamp_us, TRUE), *([(end.stamp_us, FALSE)] if end is not None else ())]


def written_out(
    formula: Formula,
    chain: Chain,
    uids: tuple[str, ...],
    intervals: Sequence[tuple[Row, Course]],
    stream: Stream,
    atoms: dict[str, Course],
) -> Formula:
    """The formula without quantifiers: an atom for each, and for what is asked with each of its intervals.

    chain  the row at which it is asked, and the intervals of the quantifiers around it, which are `uids`
    """

    def fitting() -> list[tuple[Row, Course]]:
        condition = stream.rule.define[formula.name]
        stream.spend(len(intervals))
        return [
            (row, course)
            for row, course in intervals
            if truth(condition, Asking(stream, row, [*chain, (formula.name, row)])) is True
        ]

    if formula.op == "atom":
        if not uids or not asks_bound(stream.rule.define[formula.name]):
            return formula
        key = "@".join((formula.name, *uids))
        if key not in atoms:
            found = [course for _, course in fitting()]
            points = sorted({begin for course in found for begin, _ in course})
            atoms[key] = [
                (each, max(at([(-INF, FALSE), *course], each) for course in found)) for each in points
            ]
        return Formula("atom", name=key)
    if formula.op != "exists":
        parts = tuple(written_out(part, chain, uids, intervals, stream, atoms) for part in formula.parts)
        return replace(formula, parts=parts)
    # one that is not known yet may last at any moment that is not known yet
    atoms[LATER] = []
    ways = [Formula("atom", name=LATER)]
    for row, course in fitting():
        inside = (*uids, row.uid)
        key = "@".join(("", *inside))
        atoms[key] = course
        whole = written_out(formula.parts[0], [*chain, (formula.name, row)], inside, intervals, stream, atoms)
        ways.append(Formula("and", (Formula("atom", name=key), whole)))
    return Formula("or", tuple(ways))


def first_verdict(
    formula: Formula,
    atoms: Mapping[str, Course],
    moments: Sequence[int],
    at_us: int,
    known_us: int,
    stream: Stream,
) -> tuple[int, int] | None:
    """When the formula, asked at a moment, is first certain, and what it is; what is certain stays so."""
    reach_us = reach_of(formula)
    if not is_endless(formula):
        # beyond that nothing matters to it
        first, last = at_us - reach_us - 1, at_us + reach_us + 1
        moments = [each for each in moments if first <= each <= last]
        atoms = {name: cut(course, first, last) for name, course in atoms.items()}
    steps = sorted({at_us, known_us, *deciding(formula, atoms, moments, at_us, known_us)})

    def asked(place: int) -> int:
        stream.spend(len(moments) ** 2)
        return at(Timeline(atoms, moments, reach_us, steps[place]).course(formula), at_us)

    place = bisect_left(range(len(steps)), True, key=lambda each: asked(each) != UNKNOWN)
    return None if place == len(steps) else (steps[place], asked(place))


def is_endless(formula: Formula) -> bool:
    own = formula.most == INF and formula.op not in ("atom", "exists", "constant", "not", "and", "or")
    return own or any(map(is_endless, formula.parts))


def cut(course: Course, first: float, last: float) -> Course:
    """What a course is from a moment to another, as if it had been so before."""
    before = [value for begin, value in course if begin <= first][-1:]
    inside = [each for each in course if first < each[0] <= last]
    return [*((first, value) for value in before), *inside]


def deciding(
    formula: Formula, atoms: Mapping[str, Course], moments: Sequence[int], at_us: int, known_us: int
) -> set[int]:
    """The moments at which it may become certain: changes, and ends of windows that they or the row begin."""
    found = {at_us, *moments, *(int(begin) for course in atoms.values() for begin, _ in course)}
    for by in shifts(formula):
        found |= {int(each + by + more) for each in list(found) for more in (-1, 0, 1)}
        if len(found) > 50_000:
            raise Unable("the formula has too many windows within windows")
    return {each for each in found if at_us <= each <= known_us}


def shifts(formula: Formula) -> list[float]:
    own = [by for by in dict.fromkeys((formula.least, formula.most)) if 0 < by < INF]
    sign = -1 if formula.op in ("once", "historically", "since", "previous") else 1
    return [*(sign * by for by in own), *(by for part in formula.parts for by in shifts(part))]


def starts(row: Row, names: Sequence[str], stream: Stream) -> bool:
    when = stream.rule.when
    if when is None:
        return True
    return when in begun(row, [when], stream) if when in names else satisfies(row, when, stream)


def courses(
    stream: Stream, names: Sequence[str], asked: Row
) -> tuple[dict[str, Course], dict[int, set[tuple[str, str]]]]:
    """Of each atom when it is true; and at each moment what changed it: (atom, uid)."""
    holding: dict[object, list[str]] = {}
    atoms: dict[str, Course] = {name: [] for name in names}
    changes: dict[int, set[tuple[str, str]]] = {}
    counts_rows = stream.rule.formula is not None and has_previous(stream.rule.formula)
    variables = variables_of(stream.rule.formula) if stream.rule.formula is not None else set()
    for row in stream.rows:
        subject = subject_of(row)
        if counts_rows:
            changes.setdefault(row.stamp_us, set()).add(("", row.uid))
        if subject is None:
            continue
        before = {name for held in holding.values() for name in held}
        holding[subject] = begun(row, names, stream, asked)
        after = {name for held in holding.values() for name in held}
        for name in names:
            condition = stream.rule.define[name]
            if name in variables or (condition is not None and asks_bound(condition)):
                changes.setdefault(row.stamp_us, set()).add((name, row.uid))
        for name in before ^ after:
            atoms[name] = [*(each for each in atoms[name] if each[0] < row.stamp_us),
                           (row.stamp_us, TRUE if name in after else FALSE)]  # fmt: skip
            changes.setdefault(row.stamp_us, set()).add((name, row.uid))
    return atoms, changes


# --- rules ---

UNITS_US = {"us": 1, "ms": 1_000, "s": 1_000_000, "min": 60_000_000, "h": 3_600_000_000, "d": 86_400_000_000}
CLAUSES = {
    *(
        "name",
        "input",
        "where",
        "partition_by",
        "emit",
        "measures",
        "define",
        "pattern",
        "within",
        "after_match",
    ),
    *("subset", "rows_per_match", "about", "confidence", "formula", "when"),
}
SKIPS = {
    "no skip": "none",
    "no skip, clear": "clear",
    "skip to next row": "to next",
    "skip past last row": "past last",
}


def duration_us(value: object, what: str) -> int:
    text = f"{Decimal(str(value)):f}" if is_number(value) else str(value)
    found = re.fullmatch(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*([a-z]*)\s*", text)
    if found is None or (found[2] or "s") not in UNITS_US:
        wrong(f"{what}: {text!r} is no duration")
    exact = Decimal(found[1]) * UNITS_US[found[2] or "s"]
    return int(exact) if exact == int(exact) else wrong(f"{what}: parts of a microsecond")


@dataclass(frozen=True)
class Rule:
    """What the clauses of a rule say. Windows without a bound are infinite."""

    name: str
    inputs: frozenset[str]
    emit: Mapping[str, str]
    where: Node | None = None
    partition_by: tuple[str, ...] = ()
    define: Mapping[str, Node] = field(default_factory=dict)
    measures: Mapping[str, Node] = field(default_factory=dict)
    pattern: Part | None = None
    relation: tuple[str, frozenset[str], str] = ("", frozenset(), "")
    formula: Formula | None = None
    when: str | None = None
    match_us: float = INF
    step_us: float = INF
    windows: Mapping[str, int] = field(default_factory=dict)
    skip: str = "past last"
    skip_to: frozenset[str] = frozenset()
    strict: bool = False
    at_most: int = 1_000
    each_row: bool = False
    subsets: Mapping[str, frozenset[str]] = field(default_factory=dict)
    confidence: Mapping[str, Any] | None = None

    @cached_property
    def labels(self) -> frozenset[str]:
        bound = set(self.relation[::2]) - {""}
        if self.pattern is not None:
            bound |= {name for what, name in names_in(self.pattern) if what == "variable"}
        if self.formula is not None:
            bound |= atoms_of(self.formula) | ({self.when} if self.when else set())
        return frozenset(bound | self.subsets.keys())

    @cached_property
    def counts(self) -> bool:
        return any(each.op == "match_number" for node in self.measures.values() for each in nodes_in(node))

    @cached_property
    def ahead(self) -> int:
        """So many rows does a row wait for that a condition or measure asks of."""
        asked = [
            offset_of(each, 1)
            for node in (*self.define.values(), *self.measures.values())
            for each in nodes_in(node)
            if each.op == "next"
        ]
        return max(asked, default=0)

    def members(self, label: str) -> frozenset[str]:
        return self.subsets.get(label, frozenset({label}))


def mapping(value: object, what: str) -> dict[str, Any]:
    if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
        wrong(f"{what} is no mapping")
    return value


def read_rule(found: object) -> Rule:
    clauses = {name: value for name, value in mapping(found, "the rule").items() if value is not None}
    if unknown := clauses.keys() - CLAUSES:
        wrong(f"the rule has a clause {min(unknown)}, which is none")
    given = clauses.get("input")
    inputs = map(input_name, given if isinstance(given, list) else [given])
    emit = clauses.get("emit")
    emit = {"match": emit} if isinstance(emit, str) else mapping(emit, "emit")
    by = clauses.get("partition_by", [])
    rule = Rule(
        str(clauses.get("name")),
        frozenset(inputs),
        emit,
        where=read_condition(clauses["where"], "where") if "where" in clauses else None,
        partition_by=tuple([by] if isinstance(by, str) else by),
        define={
            name: read_condition(text, name)
            for name, text in mapping(clauses.get("define", {}), "define").items()
        },
        measures={
            name: read_condition(text, name)
            for name, text in mapping(clauses.get("measures", {}), "measures").items()
        },
        subsets={
            name: frozenset(each) for name, each in mapping(clauses.get("subset", {}), "subset").items()
        },
        each_row=" ".join(str(clauses.get("rows_per_match", "one")).split()).lower() == "all",
        confidence=clauses.get("confidence"),
        when=clauses.get("when"),
        **windows_of(clauses.get("within")),
    )
    if "pattern" in clauses and "formula" not in clauses:
        rule = with_pattern(rule, clauses["pattern"])
    elif "formula" in clauses and "pattern" not in clauses:
        rule = replace(rule, formula=read_formula(clauses["formula"]))
    rule = with_skip(rule, clauses.get("after_match"))
    names = rule.labels | ({name for _, name in names_in(rule.pattern)} if rule.pattern else set())
    if unknown := (rule.define.keys() | rule.windows.keys()) - names:
        wrong(f"the rule has no variable {min(unknown)}")
    return rule


def input_name(given: object) -> str:
    if isinstance(given, dict):
        return str(next((given[kind] for kind in ("query", "rule", "object_state") if kind in given), "map"))
    return str(given)


def windows_of(value: object) -> dict[str, Any]:
    if value is None:
        return {}
    if not isinstance(value, dict):
        return {"match_us": duration_us(value, "within")}
    found = {name: duration_us(each, "within") for name, each in value.items()}
    return {"match_us": found.pop("match", INF), "step_us": found.pop("step", INF), "windows": found}


def with_pattern(rule: Rule, text: object) -> Rule:
    reader = Reader(text, "pattern")
    words = [word for kind, word, _ in reader.tokens if kind == "name"]
    if not any(word.lower() in (*ALLEN, "intersects") for word in words):
        return replace(rule, pattern=read_pattern(text))
    left = reader.take()
    wanted: set[str] = set()
    while not wanted or reader.takes("|"):
        word = reader.take().lower()
        wanted |= (
            INTERSECTS
            if word == "intersects"
            else {word}
            if word in ALLEN
            else wrong(f"{word} is no relation")
        )
    found = replace(rule, relation=(left, frozenset(wanted), reader.take()))
    reader.end()
    return found


def with_skip(rule: Rule, value: object) -> Rule:
    if value is None:
        return rule
    words = str(value).split()
    if limit := re.search(r",\s*at\s+most\s+(\d+)$", " ".join(words).lower()):
        rule = replace(rule, at_most=int(limit[1]))
        words = " ".join(words)[: limit.start()].split()
    said = " ".join(words)
    if said.lower() in SKIPS:
        return replace(rule, skip=SKIPS[said.lower()])
    found = re.fullmatch(r"(?i:skip to)(?: (?i:(first|last)))? (\w+)( (?i:or fail))?", said)
    if found is None:
        wrong(f"after_match: {said} means nothing")
    end = "to first" if (found[1] or "").lower() == "first" else "to last"
    return replace(rule, skip=end, skip_to=rule.members(found[2]), strict=found[3] is not None)


# --- what a certificate claims ---


@dataclass
class Stream:
    """The rows of one key."""

    rule: Rule
    number: int
    key: tuple[Any, ...]
    rows: list[Row]
    spent: list[int]

    def spend(self, steps: int = 1) -> None:
        self.spent[0] += steps
        if self.spent[0] > STEPS_AT_MOST:
            raise Unable(f"it takes more than {STEPS_AT_MOST} steps to check")

    def own_stamp_us(self, row: Row) -> int:
        stamp = row.values.get("stamp")
        return stamp if type(stamp) is int else row.stamp_us


@dataclass(frozen=True)
class Claim:
    """What the certificate says of an event, or of an attempt, and from when to when that was."""

    said: Mapping[str, Any]
    first: tuple[int, int, str]
    begin_us: float
    end_us: float

    def meets(self, from_us: int, until_us: int) -> bool:
        return self.begin_us <= until_us and from_us <= self.end_us


def read_stream(rule: Rule, number: int, found: object, spent: list[int]) -> Stream:
    given = mapping(found, f"stream {number}")
    if (
        given.keys() != {"key", "rows"}
        or not isinstance(given["key"], list)
        or not isinstance(given["rows"], list)
    ):
        wrong(f"stream {number} has other members than key and rows")
    rows = [read_row(place, each) for place, each in enumerate(given["rows"])]
    stream = Stream(rule, number, tuple(given["key"]), rows, spent)
    for before, row in zip([None, *rows], rows, strict=False):
        if before is not None and before.order >= row.order:
            wrong(f"row {row.uid} does not come after {before.uid}")
        if row.values.get("input") not in rule.inputs:
            wrong(f"row {row.uid} is of no input of the rule")
        key = tuple(key_part(name, row) for name in rule.partition_by)
        if None in key or [*map(key_of, key)] != [*map(key_of, stream.key)]:
            wrong(f"row {row.uid} is of another key")
        if rule.where is not None and truth(rule.where, Asking(stream, row)) is not True:
            wrong(f"row {row.uid} does not satisfy where")
    return stream


def key_part(name: str, row: Row) -> Any:
    value = at_path(row.values, BY_ID.get(name, name).split("."))
    if isinstance(value, bool):
        return "true" if value else "false"
    return value if isinstance(value, int | float | str) else None


def key_of(value: Any) -> tuple[bool, Any]:
    return isinstance(value, str), value


def claims_of(stream: Stream, known_us: int) -> tuple[list[Claim], list[Claim]]:
    """All events that a rule makes of a stream, and what came to nothing."""
    rule = stream.rule
    if rule.pattern is not None:
        return of_pattern(stream, rule.pattern, known_us)
    if rule.relation[0]:
        events = [
            event(stream, "match", moment, chain) for chain, moment in pairs_in_relation(stream, known_us)
        ]
        return [each for each in events if each is not None], []
    if rule.formula is not None:
        return of_formula(stream, known_us)
    edges = [
        event(stream, str(row.values.get("type")), stream.own_stamp_us(row), [("", row)])
        for row in stream.rows
    ]
    return [each for each in edges if each is not None], []


def of_formula(stream: Stream, known_us: int) -> tuple[list[Claim], list[Claim]]:
    events, attempts = [], []
    for row, verdict, stamp_us, changes in evaluations(stream, known_us):
        outcome = "holds" if verdict == TRUE else "fails"
        by = [
            (name, each)
            for each in stream.rows
            for name, uid in changes
            if uid == each.uid and each.order > row.order
        ]
        made = event(stream, outcome, stamp_us, [(stream.rule.when or "", row)], by)
        if made is not None:
            events.append(made)
        else:
            said = {"stream": stream.number, "rows": [[stream.rule.when or "", row.uid]], "awaits": [],
                    "ended": {outcome: stamp_us}}  # fmt: skip
            attempts.append(Claim(said, row.order, row.stamp_us, stamp_us))
    return events, attempts


def of_pattern(stream: Stream, pattern: Part, known_us: int) -> tuple[list[Claim], list[Claim]]:
    rule, rows = stream.rule, stream.rows
    attempts, told = told_of(stream, pattern, known_us)
    events: list[Claim] = []
    settled: dict[int, str] = {}
    for outcome, end, number in told:
        chain = [(label, rows[place]) for label, place in end.chain] or [("", rows[end.start])]
        shown = [each for each in chain if each[1].place not in end.hidden] or chain[-1:]
        if outcome == "match" and rule.each_row:
            parts = [chain[: n + 1] for n, each in enumerate(chain) if each[1].place not in end.hidden]
            made = [
                event(stream, outcome, part[-1][1].stamp_us, part[-1:], (), part, chain, number)
                for part in parts
            ]
        else:
            made = [event(stream, outcome, int(end.stamp_us), shown, (), chain, chain, number)]
        events += [each for each in made if each is not None]
        if outcome != "unmatched":
            settled[end.start] = "told" if any(made) else "unsure" if rule.confidence else "unnamed"
    return events, [
        each for attempt in attempts if (each := nothing_of(stream, attempt, settled)) is not None
    ]


def nothing_of(stream: Stream, attempt: Attempt, settled: Mapping[int, str]) -> Claim | None:
    """The attempt that began with a row and came to nothing; None where there is none such."""
    first = stream.rows[attempt.start]
    outcome = settled.get(attempt.start)
    if outcome == "told":
        return None
    awaits: list[str] = []
    if attempt.matches:
        shown = list(attempt.matches[0].chain) or [("", attempt.start)]
        end_us: float = attempt.matches[0].stamp_us
        how: object = outcome or "skipped"
        if outcome is None and not attempt.matches[0].chain:
            return None
    elif attempt.furthest is None or not attempt.furthest.chain:
        return None
    else:
        shown = list(attempt.furthest.chain)
        awaits = sorted({each.step.variable for each in attempt.furthest.options if each.step.variable})
        end_us, how = INF, "open"
        if attempt.ended is not None:
            by, at_ = attempt.ended
            end_us = stream.rows[int(at_)].stamp_us if by == "row" else at_
            how = {"row": stream.rows[int(at_)].uid} if by == "row" else {"silence_us": int(at_)}
    said = {"stream": stream.number, "rows": [[label, stream.rows[place].uid] for label, place in shown],
            "awaits": awaits, "ended": how}  # fmt: skip
    return Claim(said, first.order, first.stamp_us, end_us)


def event(
    stream: Stream,
    outcome: str,
    stamp_us: int,
    shown: Chain,
    by: Chain = (),
    running: Chain = (),
    whole: Chain = (),
    number: int = 0,
) -> Claim | None:
    """What is said of an event; None where the rule names none, or is too unsure of it.

    by  rows of which one may be named as what decided it
    """
    rule = stream.rule
    if outcome not in rule.emit:
        return None
    running, whole = running or shown, whole or running or shown
    sure = confidence_of(rule.confidence, whole, stream) if rule.confidence else None
    if sure is not None and rule.confidence and sure < rule.confidence.get("at_least", 0):
        return None
    row = running[-1][1]
    if outcome == "empty":
        row = replace(row, values={})
    asking = Asking(stream, row, running, whole, number)
    measures = (
        {}
        if outcome == "unmatched"
        else {name: measured(node, asking) for name, node in rule.measures.items()}
    )
    said: dict[str, Any] = {
        "stream": stream.number,
        "event": rule.emit[outcome],
        "stamp_us": stamp_us,
        "rows": [[label, each.uid] for label, each in shown],
        "measures": measures,
        "confidence": sure,
    }
    if by:
        said["by"] = [[label, each.uid] for label, each in by]
    stamps = [stamp_us, *(each.stamp_us for _, each in shown)]
    return Claim(said, shown[0][1].order, min(stamps), max(stamps))


def measured(node: Node, asking: Asking) -> Any:
    found, kind = value_of(node, asking), kind_of(node, asking)
    if kind == "instant":
        return None if found is None else written(found)
    if kind == "array" and found is not None:
        return [
            written(each) if is_of_instants(node, asking) and each is not None else finite(each)
            for each in found
        ]
    return finite(found)


def is_of_instants(node: Node, asking: Asking) -> bool:
    return node.op in ("array", "distinct", "final", "running") and (
        is_of_instants(node.args[0], asking) or kind_of(node.args[0], asking) == "instant"
    )


def finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def confidence_of(given: Mapping[str, Any], chain: Chain, stream: Stream) -> float | None:
    """The share of gaps that are at least as long as that of these rows."""
    first = [stream.own_stamp_us(row) for label, row in chain if label == given["gap"][0]]
    last = [stream.own_stamp_us(row) for label, row in chain if label == given["gap"][1]]
    if not first or not last:
        return None
    gap_s = (last[-1] - first[0]) / 1e6
    if given["distribution"] == "exponential":
        return math.exp(-max(gap_s, 0.0) / given["mean_s"])
    if given["distribution"] == "normal":
        deviations = (gap_s - given["mean_s"]) / given["std_s"]
    elif gap_s <= 0:
        return 1.0
    else:
        deviations = (math.log(gap_s) - math.log(given["median_s"])) / given["sigma"]
    return 0.5 * math.erfc(deviations / math.sqrt(2))


MEMBERS = {
    *("certificate", "map", "version", "rule", "key", "from_us", "until_us", "known_us"),
    *("streams", "events", "attempts", "other_attempts"),
}


def verify(document: object) -> list[str]:
    """Lines that say what a certificate proves.

    raises  Wrong if it does not hold; Unable if that cannot be worked out
    """
    given = mapping(document, "the certificate")
    if given.keys() != MEMBERS or canonical(given["certificate"]) != str(VERSION):
        wrong(f"it is no certificate of version {VERSION}")
    span = [given[name] for name in ("from_us", "until_us", "known_us")]
    if not all(type(each) is int for each in span) or not span[0] <= span[1]:
        wrong("its span is none")
    from_us, until_us, known_us = span
    try:
        rule = read_rule(given["rule"])
        spent = [0]
        streams = [read_stream(rule, number, each, spent) for number, each in enumerate(given["streams"])]
        if len({tuple(map(key_of, stream.key)) for stream in streams}) < len(streams):
            wrong("a key has two streams")
        for name, value in mapping(given["key"], "its key").items():
            if not all(
                any(str(at_path(row.values, name.split("."))) == value for row in each.rows)
                for each in streams
            ):
                wrong(f"it has a key of which no row has {name} {value}")
        if any(row.stamp_us > known_us for stream in streams for row in stream.rows):
            wrong("it has rows that are later than what it knows of")
        found = [claims_of(stream, known_us) for stream in streams]
    except (TypeError, ValueError, KeyError, IndexError, AttributeError, OverflowError) as error:
        if isinstance(error, Wrong):
            raise
        wrong(f"it cannot be read: {error}")
    except RecursionError as error:
        raise Unable("it is nested too deeply") from error
    events = [each for of_stream, _ in found for each in of_stream if each.meets(from_us, until_us)]
    attempts = [each for _, of_stream in found for each in of_stream if each.meets(from_us, until_us)]
    check_events(given["events"], events, rule)
    check_attempts(given, attempts)
    return summary(given, rule, streams)


def canonical(value: object) -> str:
    return json.dumps(value, sort_keys=True, ensure_ascii=False)


def check_events(claimed: object, found: Sequence[Claim], rule: Rule) -> None:
    """Each that is claimed was made, and each that was made and told is claimed."""
    if not isinstance(claimed, list):
        wrong("its events are no list")
    left = list(found)
    for each in claimed:
        same = next((one for one in left if is_same(mapping(each, "an event"), one.said)), None)
        if same is None:
            wrong(f"the rule does not make {canonical(each)}")
        left.remove(same)
    told: dict[object, int] = {}
    if rule.skip in ("none", "clear"):
        for each in claimed:
            told[each["stream"], each["stamp_us"]] = told.get((each["stream"], each["stamp_us"]), 0) + 1
    for one in left:
        if told.get((one.said["stream"], one.said["stamp_us"]), 0) != rule.at_most:
            also = {name: value for name, value in one.said.items() if name != "by"}
            wrong(f"the rule also makes {canonical(also)}")


def is_same(claimed: Mapping[str, Any], found: Mapping[str, Any]) -> bool:
    """A formula's event may name one row that decided it."""
    by = found.get("by", [])
    said = {name: value for name, value in found.items() if name != "by"}
    if by and len(claimed.get("rows", ())) == 2 and claimed["rows"][1] in by:
        said["rows"] = [*said["rows"], claimed["rows"][1]]
    return canonical(claimed) == canonical(said)


def check_attempts(given: Mapping[str, Any], found: Sequence[Claim]) -> None:
    """Those that are claimed came furthest."""
    claimed = given["attempts"]
    if not isinstance(claimed, list):
        wrong("its attempts are no list")
    ranked = sorted(found, key=lambda each: (-len(each.said["rows"]), each.first, each.said["stream"]))
    for each, one in zip(claimed, ranked, strict=False):
        if canonical(each) != canonical(one.said):
            wrong(f"it claims the attempt {canonical(each)} where {canonical(one.said)} came next")
    if len(claimed) > len(ranked) or canonical(given["other_attempts"]) != str(len(ranked) - len(claimed)):
        wrong(
            f"{len(ranked)} attempts came to nothing, not {len(claimed)} and {given['other_attempts']} others"
        )


def summary(given: Mapping[str, Any], rule: Rule, streams: Sequence[Stream]) -> list[str]:
    span = written(given["from_us"])
    if given["until_us"] != given["from_us"]:
        span = f"from {span} to {written(given['until_us'])}"
    rows = {(stream.number, row.uid): row for stream in streams for row in stream.rows}

    def bound(each: Mapping[str, Any]) -> list[str]:
        return [f"  {label or '-'}: {said(rows[each['stream'], uid])}" for label, uid in each["rows"]]

    keys = {stream.number: key_said(stream) for stream in streams}
    lines = [] if given["events"] else [f"The rule {rule.name} makes no event {span}."]
    for each in sorted(given["events"], key=lambda event: event["stamp_us"]):
        lines += [f"The rule {rule.name} makes {each['event']} at {written(each['stamp_us'])}:", *bound(each)]
        lines += [f"  {name} = {canonical(value)}" for name, value in each["measures"].items()]
    for each in given["attempts"]:
        lines += [f"An attempt came to nothing{keys[each['stream']]}:", *bound(each)]
        if each["awaits"]:
            lines.append(f"  next would have been {' or '.join(each['awaits'])}")
        ended_by = each["ended"].get("row", "") if isinstance(each["ended"], dict) else ""
        row = rows.get((each["stream"], ended_by))
        lines.append(f"  {ended_text(each['ended'], row)}")
    if given["other_attempts"]:
        lines.append(f"{given['other_attempts']} others came no further.")
    of = counted(len(rows), "row")
    if rule.partition_by:
        of += f" of {counted(len(streams), 'key')}"
    return [*lines, f"That follows from {of}, known up to {written(given['known_us'])}."]


def counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def key_said(stream: Stream) -> str:
    """Of which key an attempt is, by names where its rows have them."""
    row = stream.rows[0] if stream.rows else None
    named = [f"{name} {at_path(row.values, name.split('.'))}" for name in stream.rule.partition_by if row]
    return f" ({', '.join(named)})" if named else ""


def said(row: Row) -> str:
    named = [
        row.values.get(name)
        for name in ("input", "type", "track", "subject", "instance", "other", "direction")
    ]
    stamp = row.values.get("stamp")
    at_us = row.stamp_us if stamp is None else stamp
    return f"{' '.join(str(each) for each in named if each)} at {written(at_us)}"


def ended_text(how: Any, row: Row | None) -> str:
    match how:
        case {"row": _}:
            return f"it was ended by {said(row)}" if row is not None else "it was ended by a row"
        case {"silence_us": int(stamp_us)}:
            return f"nothing that fits came until {written(stamp_us)}"
        case {"holds": int(stamp_us)}:
            return f"the formula held, at {written(stamp_us)}"
        case {"fails": int(stamp_us)}:
            return f"the formula failed, at {written(stamp_us)}"
        case "skipped":
            return "it matched, and another match skipped it (after_match)"
        case "unsure":
            return "it matched, and was too unsure (confidence)"
        case "unnamed":
            return "it matched, and the rule names no event for that (emit)"
    return "it is still under way"


def main(arguments: Sequence[str]) -> int:
    if len(arguments) != 1:
        sys.stderr.write("usage: certificate.py FILE\n")
        return 2
    try:
        with open(arguments[0], encoding="utf-8") as file:
            lines = verify(json.load(file))
    except (OSError, ValueError, Unable) as error:
        sys.stderr.write(f"It does not hold: {error}\n")
        return 1
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
