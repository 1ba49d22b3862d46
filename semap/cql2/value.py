"""What CQL2's operators say of values in memory, as `semap.store.database.cql2_sql` has PostGIS say it.

A value is None (unknown), a bool, a number, a text, a list, a dict (JSON), a shapely geometry seen from
above, or an instant as an int [us since 1970]. What is asked of an unknown value is unknown.
"""

from __future__ import annotations

import math
import operator
import re
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from datetime import date
from typing import Any

import shapely

from semap.cql2.check import Kind
from semap.timeline.stamp import DAY_US, EPOCH, to_datetime

Value = object

LARGEST_FLOAT = 1.7e308
INSTANT = re.compile(
    r"(\d{4})-(\d\d)-(\d\d)(?:[Tt](\d\d):(\d\d):(\d\d)(\.\d+)?(?:[Zz]|([+-])(\d\d):(\d\d)))?", re.ASCII
)
INDEX = re.compile(r"\s*[+-]?\d+", re.ASCII)
ACCENT = re.compile("[\u0300-\u036f]")
NEW_LETTER = re.compile(
    "[\u1c89-\u1c8f\ua7cb-\ua7cf\ua7d2-\ua7d5\ua7da-\ua7f4\U00010000-\U000103ff\U00010428-\U000104af"
    "\U000104d4-\U0001056f\U00010596-\U00010c7f\U00010cb3-\U0001189f\U000118c0-\U00016e3f\U00016e60-\U0001e8ff"
    "\U0001e922-\U0010ffff]"
)
"""What has a lower case that only Unicode after version 14 knows, or might have."""


def json_at(value: Value, keys: Sequence[str]) -> Value:
    """What stands in JSON under these keys, one within the other; lists go by index, from either end."""
    for key in keys:
        if isinstance(value, dict):
            value = value.get(key)
        elif isinstance(value, list | tuple) and INDEX.fullmatch(key):
            at = int(key)
            value = value[at] if -len(value) <= at < len(value) else None
        else:
            return None
    return value


def number_of(value: Value) -> float | None:
    """None also where no float holds it."""
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST_FLOAT:
        return float(value)
    return None


def text_of(value: Value) -> str | None:
    return value if isinstance(value, str) else None


def boolean_of(value: Value) -> bool | None:
    return value if isinstance(value, bool) else None


def array_of(value: Value) -> Sequence[Value] | None:
    return value if isinstance(value, list | tuple) else None


def shape_of(_: Value) -> None:
    """JSON holds no shape."""


def instant_of(value: Value) -> int | None:
    """The instant [us] that a text of RFC 3339 says, a date being its first instant in UTC."""
    found = INSTANT.fullmatch(value) if isinstance(value, str) else None
    if found is None:
        return None
    year, month, day, hour, minute, second, fraction, sign, offset_h, offset_min = found.groups()
    try:
        days = date(int(year), int(month), int(day)).toordinal() - EPOCH.toordinal()
    except ValueError:
        return None
    if hour is None:
        return days * DAY_US
    if int(minute) > 59 or int(second) > 60 or int(offset_h or 0) > 15 or int(offset_min or 0) > 59:
        return None
    seconds = (int(hour) * 60 + int(minute)) * 60 + int(second)
    of_day_us = seconds * 1_000_000 + round(float(fraction or 0) * 1_000_000)
    if of_day_us > DAY_US:
        return None
    offset_us = (int(offset_h or 0) * 60 + int(offset_min or 0)) * 60_000_000
    return days * DAY_US + of_day_us - (-offset_us if sign == "-" else offset_us)


OF_KIND: Mapping[Kind, Callable[[Value], Value]] = {
    "number": number_of,
    "text": text_of,
    "boolean": boolean_of,
    "array": array_of,
    "instant": instant_of,
    "shape": shape_of,
}
"""The value of a kind that one of the kind `any` is; None where it is of another."""


def instant_text(stamp_us: int | None) -> str | None:
    """RFC 3339, in UTC, to the microsecond."""
    if stamp_us is None:
        return None
    return to_datetime(stamp_us).isoformat(timespec="microseconds").replace("+00:00", "Z")


def lower(text: str | None) -> str | None:
    """In lower case, character by character, by Unicode 14 whatever version Python knows."""
    if text is None or text.isascii():
        return text and text.lower()
    return "".join(each if NEW_LETTER.match(each) else each.lower()[0] for each in text)


def without_accents(text: str | None) -> str | None:
    return text and ACCENT.sub("", unicodedata.normalize("NFD", text))


def like(pattern: str) -> Callable[[str | None], bool | None]:
    """Whether a text fits a pattern, in which % stands for any characters, _ for one, and \\ for the next.

    Between two % what fits first is taken for good, so that the time is in proportion to text and pattern.
    """
    parts, escaped = [""], False
    for character in pattern:
        if escaped or character not in "%_\\":
            parts[-1], escaped = parts[-1] + re.escape(character), False
        elif character == "\\":
            escaped = True
        elif character == "_":
            parts[-1] += "."
        else:
            parts.append("")
    begin, *between, end = parts if len(parts) > 1 else (parts[0], None)
    taken = "".join(f"(?>.*?{part})" for part in between if part)
    found = begin + taken + ("" if end is None else f".*{end}")
    fits = re.compile(found, re.DOTALL).fullmatch
    return lambda text: None if text is None else fits(text) is not None


def _known(of: Callable[[float, float], float]) -> Callable[[float | None, float | None], float | None]:
    """In double precision; what has no finite value is unknown."""

    def checked(a: float | None, b: float | None) -> float | None:
        if a is None or b is None:
            return None
        try:
            found = of(float(a), float(b))
        except (ZeroDivisionError, OverflowError):
            return None
        return found if math.isfinite(found) else None

    return checked


def _power(a: float, b: float) -> float:
    if a < 0 and b != math.trunc(b):
        return math.nan
    return float(a**b)


ARITHMETIC: Mapping[str, Callable[[float | None, float | None], float | None]] = {
    "+": _known(operator.add),
    "-": _known(operator.sub),
    "*": _known(operator.mul),
    "/": _known(operator.truediv),
    "div": _known(lambda a, b: float(math.trunc(a / b))),
    "%": _known(lambda a, b: a - b * math.trunc(a / b)),
    "^": _known(_power),
}


def _spatial(of: Callable[[Value, Value], object]) -> Callable[[Value, Value], bool | None]:
    return lambda a, b: None if a is None or b is None else bool(of(a, b))


SPATIAL: Mapping[str, Callable[[Value, Value], bool | None]] = {
    "s_intersects": _spatial(shapely.intersects),
    "s_equals": _spatial(shapely.equals),
    "s_disjoint": _spatial(shapely.disjoint),
    "s_touches": _spatial(shapely.touches),
    "s_within": _spatial(shapely.within),
    "s_overlaps": _spatial(shapely.overlaps),
    "s_crosses": _spatial(shapely.crosses),
    "s_contains": _spatial(shapely.contains),
}


def json_equal(a: Value, b: Value) -> bool:
    """JSON is equal as in PostgreSQL's jsonb: 1 is 1.0, and true is no number."""
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(json_equal(a[key], b[key]) for key in a)
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(map(json_equal, a, b))
    return _json_type(a) == _json_type(b) and a == b


def _json_type(value: Value) -> str:
    match value:
        case None:
            return "null"
        case bool():
            return "boolean"
        case int() | float():
            return "number"
        case str():
            return "string"
        case dict():
            return "object"
    return "array"


def _alike(equal: bool) -> Callable[[Value, Value], bool | None]:
    def compared(a: Value, b: Value) -> bool | None:
        if a is None or b is None or _json_type(a) != _json_type(b):
            return None
        return json_equal(a, b) == equal

    return compared


def _ordered(of: Callable[[Any, Any], bool]) -> Callable[[Value, Value], bool | None]:
    def compared(a: Value, b: Value) -> bool | None:
        for kind in (number_of, text_of):
            left, right = kind(a), kind(b)
            if left is not None and right is not None:
                return of(left, right)
        return None

    return compared


JSON_COMPARISONS: Mapping[str, Callable[[Value, Value], bool | None]] = {
    "=": _alike(True),
    "<>": _alike(False),
    "<": _ordered(operator.lt),
    "<=": _ordered(operator.le),
    ">": _ordered(operator.gt),
    ">=": _ordered(operator.ge),
}
"""Of two values of the kind `any`: known where they are of one kind, and ordered if numbers or texts."""


def _json_contains(a: Value, b: Value) -> bool:
    """PostgreSQL's `@>` of jsonb, b having been found within an array or object."""
    if isinstance(a, dict) and isinstance(b, dict):
        return all(key in a and _json_contains(a[key], b[key]) for key in b)
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return all(any(_json_contains(mine, each) for mine in a) for each in b)
    return json_equal(a, b)


def _arrays(of: Callable[[Sequence[Value], Sequence[Value]], bool]) -> Callable[[Value, Value], bool | None]:
    def compared(a: Value, b: Value) -> bool | None:
        left, right = array_of(a), array_of(b)
        return None if left is None or right is None else of(left, right)

    return compared


ARRAYS: Mapping[str, Callable[[Value, Value], bool | None]] = {
    "a_contains": _arrays(_json_contains),
    "a_containedBy": _arrays(lambda a, b: _json_contains(b, a)),
    "a_equals": _arrays(lambda a, b: _json_contains(a, b) and _json_contains(b, a)),
    "a_overlaps": _arrays(lambda a, b: any(_json_contains(b, [each]) for each in a)),
}
"""Arrays as sets; items that are arrays themselves count by what they contain."""
