"""Which events a reader wants, and may have."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import shapely

from semap.cql2 import Kinds, check, parse
from semap.cql2.evaluate import Subject, compile_filter
from semap.cql2.expression import Property, parts
from semap.cql2.logic import Code, code
from semap.errors import InvalidInput
from semap.store.event.events import StoredEvent
from semap.timeline.stamp import to_us

FILTERS_KEPT = 1024

KINDS: Kinds = {
    "seq": "number",
    "map": "text",
    "type": "text",
    "rule": "text",
    "rule_version": "number",
    "track": "text",
    "track_id": "number",
    "instance": "text",
    "instance_id": "number",
    "stamp": "instant",
    "since": "instant",
    "cause": "text",
    "confidence": "number",
    "by_batch": "boolean",
    "verdict": "text",
    "place": "shape",
    "key": "any",
    "measures": "any",
    "payload": "any",
}
"""What a filter may ask of an event.

`payload` is `key` and `measures` together. `place` is where its track was then, or else where its instance
is.
"""

CODE = {
    "track": "event.track_name",
    "instance": "event.instance_name",
    "stamp": "to_us(event.stamp)",
    "since": "to_us(event.since)",
    "key": "event.key",
    "measures": "event.measures",
    "payload": "{**event.key, **event.measures}",
    "place": "place_of(event.place)",
}
"""How a property is found where it is not the event's own attribute of that name."""


@dataclass(frozen=True)
class Selection:
    """Which events a reader wants; None: any.

    filter  CQL2 text over the properties in KINDS
    maps    the names of the only maps that the reader may see
    """

    map: str | None = None
    type: str | None = None
    rule: str | None = None
    filter: str | None = None
    maps: frozenset[str] | None = None

    @property
    def own_of(self) -> str | None:
        """The only map that its reader may see, whose events are told by their own numbers.

        None: the reader may see all, and is told the numbers of all maps.
        """
        return None if self.maps is None else self.map or next(iter(self.maps), "")

    @property
    def asks_places(self) -> bool:
        """Whether the place of an event matters."""
        return self.filter is not None and _asks_places(self.filter)

    def check(self) -> None:
        """raises InvalidInput for a filter that cannot be used, or for several maps with their own numbers"""
        if self.maps is not None and self.map is None and len(self.maps) > 1:
            raise InvalidInput(
                f"The token is for {len(self.maps)} maps, whose events have numbers of their own",
                f"Follow one map at a time: map={min(self.maps)}, and so on.",
                "map",
            )
        if self.filter is not None:
            _compiled(self.filter)

    def takes(self, event: StoredEvent) -> bool:
        """Whether the reader wants this event, and may have it."""
        return (
            self.map in (None, event.map)
            and self.type in (None, event.type)
            and self.rule in (None, event.rule)
            and (self.maps is None or event.map in self.maps)
            and (self.filter is None or _compiled(self.filter)(event))
        )


@lru_cache(FILTERS_KEPT)
def _compiled(text: str) -> Callable[[StoredEvent], bool]:
    expression = parse(text)
    check(expression, KINDS)
    return compile_filter(expression, _SUBJECT)


@lru_cache(FILTERS_KEPT)
def _asks_places(text: str) -> bool:
    return any(isinstance(each, Property) and each.name == "place" for each in parts(parse(text)))


def _property(name: str) -> Code:
    return code(CODE.get(name, f"event.{name}"))


def _place_of(place: bytes | None) -> shapely.Geometry | None:
    return None if place is None else shapely.from_wkb(place)


def _is_a(concept: str) -> Code:
    raise InvalidInput(
        f"isA('{concept}'): an event is of no concept", "Ask for its type, or for its instance.", "filter"
    )


_SUBJECT = Subject(
    kinds=KINDS,
    parameters="event",
    property_of=_property,
    is_a=_is_a,
    names={"to_us": to_us, "place_of": _place_of},
)
