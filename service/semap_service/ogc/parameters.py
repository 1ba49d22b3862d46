"""What clients say in the query of a request for features, read to values."""

from __future__ import annotations

import base64
import binascii
import json
import math
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Annotated, Literal

from fastapi import Path, Query
from pydantic import BeforeValidator

from semap.cql2 import Expression, check, parse
from semap.errors import InvalidInput
from semap.store.features.page import Box, Cursor, SortKey
from semap.store.features.placing import System
from semap.store.features.source import TYPES, Source
from semap.timeline.stamp import require_usual

OPEN = ("", "..")
MOST_SORT_KEYS = 8
AS_TEXT = "Give CQL2 JSON, or filter-lang=cql2-text."


CollectionId = Annotated[
    str,
    Path(
        min_length=1,
        max_length=450,
        pattern=r"^[^\x00]*$",
        description="map.Concept, map.tracks, map.relations or map.events.",
        examples=["office.Room"],
    ),
]
Format = Annotated[Literal["json"] | None, Query(alias="f", description="There is JSON only.")]
Crs = Annotated[
    str | None, Query(max_length=200, description="Give coordinates in this system. [default: CRS84]")
]
FeatureId = Annotated[str, Path(min_length=1, max_length=50, pattern=r"^[^\x00]*$", examples=["7"])]


def at_most(largest: int) -> BeforeValidator:
    """What asks for more gets as much as there is (OGC API Features, part 1, 7.15.2), and no error."""

    def lowered(given: object) -> object:
        text = str(given)
        return largest if text.isascii() and text.isdigit() and int(text[:10]) > largest else given

    return BeforeValidator(lowered)


def boxes_of(given: str | None, system: System) -> tuple[Box, ...]:
    """Four numbers, or six with heights; one in degrees that crosses the antimeridian is two boxes.

    raises  InvalidInput
    """
    if given is None:
        return ()
    remedy = "Give bbox=west,south,east,north, or six numbers with heights."
    try:
        numbers = [float(each) for each in given.split(",")]
    except ValueError as error:
        raise InvalidInput("it is no list of numbers", remedy, "bbox") from error
    if len(numbers) not in (4, 6) or not all(math.isfinite(each) and abs(each) < 1e15 for each in numbers):
        raise InvalidInput("it is not of four or six numbers", remedy, "bbox")
    half = len(numbers) // 2
    x_min, y_min, x_max, y_max = *numbers[:2], *numbers[half : half + 2]
    heights = None if half == 2 else (numbers[2], numbers[5])
    if heights is not None and heights[0] > heights[1]:
        raise InvalidInput("its lower height is above its upper one", remedy, "bbox")
    if system.north_first:
        (x_min, y_min), (x_max, y_max) = (y_min, x_min), (y_max, x_max)
    if y_min > y_max:
        raise InvalidInput("its north is south of its south", remedy, "bbox")
    spans = [(x_min, x_max)]
    if x_min > x_max:
        if not system.degrees:
            raise InvalidInput("its east is west of its west", remedy, "bbox")
        spans = [(x_min, 180.0), (-180.0, x_max)]
    found = [(low, y_min, high, y_max) for low, high in spans]
    if system.north_first:
        found = [(south, west, north, east) for west, south, east, north in found]
    return tuple(Box(bounds, heights) for bounds in found)


def interval_of(given: str | None) -> tuple[datetime | None, datetime | None]:
    """An instant, or an interval whose ends may be open (OGC API Features, part 1, 7.15.4).

    raises  InvalidInput
    """
    if given is None:
        return None, None
    start, slash, end = given.partition("/")
    if not slash:
        stamp = stamp_of(start, "datetime")
        return stamp, stamp
    if start in OPEN and end in OPEN:
        raise InvalidInput("an interval without any end", "Leave datetime out.", "datetime")
    first = None if start in OPEN else stamp_of(start, "datetime")
    last = None if end in OPEN else stamp_of(end, "datetime")
    if first is not None and last is not None and first > last:
        raise InvalidInput("it ends before it begins", "Give the earlier time first.", "datetime")
    return first, last


def stamp_of(given: str, where: str) -> datetime:
    """raises InvalidInput for what is no RFC 3339 stamp"""
    # In a query "+" stands for a space.
    text = given.replace(" ", "+").upper()
    try:
        stamp = datetime.fromisoformat(text)
        if stamp.tzinfo is None or "T" not in text:
            raise ValueError
        return require_usual(stamp.astimezone(UTC), where)
    except (ValueError, OverflowError) as error:
        raise InvalidInput(f"{given} is no time", "Write 2026-01-31T12:00:00Z.", where) from error


def sort_of(given: str | None, source: Source) -> tuple[SortKey, ...]:
    """Names with + or - before them, by commas (OGC API Features, part 8).

    raises  InvalidInput for what cannot be sorted by
    """
    if given is None:
        return ()
    known = sortable(source)
    found: list[SortKey] = []
    for each in given.split(","):
        name = each.strip().lstrip("+-").strip()
        if name not in known:
            raise InvalidInput(f"it cannot be sorted by {name}", f"There are {', '.join(known)}.", "sortby")
        found.append(SortKey(name, each.strip().startswith("-")))
    if len(found) > MOST_SORT_KEYS:
        raise InvalidInput(f"more than {MOST_SORT_KEYS} keys", "Sort by fewer.", "sortby")
    return tuple(found)


def sortable(source: Source) -> list[str]:
    return [name for name in source.properties if source.thing.kinds[name] in TYPES]


def properties_of(given: str | None, source: Source) -> tuple[str, ...] | None:
    """raises InvalidInput for a property that there is not"""
    if given is None:
        return None
    names = tuple(dict.fromkeys(each.strip() for each in given.split(",") if each.strip()))
    unknown = [each for each in names if each not in source.properties]
    if unknown:
        raise InvalidInput(
            f"there is no property {unknown[0]}", f"There are {', '.join(source.properties)}.", "properties"
        )
    return names


def filter_of(
    given: str | None, language: str | None, source: Source, *, degrees: bool = False
) -> Expression | None:
    """A filter in CQL2 text or JSON; without a language what it looks like.

    degrees  whether its shapes are in longitude and latitude, so that a box may cross the antimeridian
    raises  InvalidInput
    """
    if given is None:
        return None
    looks_like_json = given.lstrip().startswith("{")
    if language == "cql2-json" or (language is None and looks_like_json):
        try:
            document = json.loads(given)
        except (ValueError, RecursionError) as error:
            raise InvalidInput("it is no JSON", AS_TEXT, "filter") from error
        if isinstance(document, str):
            raise InvalidInput("it is a text", AS_TEXT, "filter")
        expression = parse(document, "filter", degrees=degrees)
    else:
        expression = parse(given, "filter", degrees=degrees)
    check(expression, source.thing.kinds)
    return expression


def write_cursor(values: Sequence[object], order: str, *, back: bool) -> str:
    """A place in an order as a text that clients only pass on."""
    document = json.dumps({"o": order, "v": list(values), "b": back}, separators=(",", ":"))
    return base64.urlsafe_b64encode(document.encode()).rstrip(b"=").decode()


def read_cursor(given: str | None, order: str) -> Cursor | None:
    """raises InvalidInput for what no page gave, or for a place in another order"""
    if given is None:
        return None
    refused = InvalidInput("it is no place in this order", "Follow the links of a page.", "cursor")
    try:
        document = json.loads(base64.urlsafe_b64decode(given + "=" * (-len(given) % 4)))
        json.dumps(document, ensure_ascii=False).encode()  # no half of a surrogate pair
    except (ValueError, binascii.Error, RecursionError) as error:
        raise refused from error
    match document:
        case {"o": str(known), "v": list(values), "b": bool(back)} if known == order:
            if all(each is None or (isinstance(each, str) and "\0" not in each) for each in values):
                return Cursor(tuple(values), back)
    raise refused
