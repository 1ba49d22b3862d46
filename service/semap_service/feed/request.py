"""What a request for events asks for: which events, from where on, in which envelope."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from fastapi import Depends, Query
from starlette.requests import HTTPConnection

from semap.errors import InvalidInput
from semap.store.event.event_selection import Selection
from semap_service.context.caller import current_caller
from semap_service.documents.cloud_event import schema_url
from semap_service.documents.document import LARGEST_ID, MapFilter, Name
from semap_service.feed.encoding import Envelope

EnvelopeName = Annotated[
    Literal["cloudevents"] | None,
    Query(description="Give each event as a CloudEvents 1.0 object (JSON format)."),
]


def _wanted(
    map_name: MapFilter = None,
    event_type: Annotated[Name | None, Query(alias="type", description="Only events of this type.")] = None,
    rule_name: Annotated[Name | None, Query(alias="rule", description="Only events of this rule.")] = None,
    filter: Annotated[  # noqa: A002
        str | None,
        Query(
            min_length=1,
            max_length=8000,
            description="Only events that this CQL2 text takes. It may ask for seq, map, type, rule,"
            " rule_version, track, track_id, instance, instance_id, stamp, since, cause, confidence,"
            " by_batch, verdict, place (where its track was then, or else its instance is, in the map"
            " frame), and for key.NAME, measures.NAME and payload.NAME (either of the two).",
            examples=["instance = 'Room07' AND measures.gap_s < 2"],
        ),
    ] = None,
) -> Selection:
    return Selection(map_name, event_type, rule_name, filter, current_caller().maps)


Wanted = Annotated[Selection, Depends(_wanted)]


def envelope_of(name: str | None, connection: HTTPConnection) -> Envelope:
    """How a client wants its events."""
    return Envelope(None if name is None else schema_url(connection))


def selection_of(parameters: Mapping[str, str]) -> Selection:
    """What is selected by a query, among what the caller may see."""
    map_name, event_type, rule, text = (
        parameters.get(name) or None for name in ("map", "type", "rule", "filter")
    )
    return Selection(map_name, event_type, rule, text, current_caller().maps)


def socket_envelope(name: str | None, connection: HTTPConnection) -> Envelope:
    if name in (None, "", "none"):
        return Envelope()
    if name != "cloudevents":
        raise InvalidInput(f"{name[:40]!r} is no envelope", "Leave it out, or give cloudevents.", "envelope")
    return Envelope(schema_url(connection))


def cursor_of(text: str | None, where: str) -> int | None:
    """The number of an event that a client gives.

    raises  InvalidInput
    """
    if text is None or text == "":
        return None
    if not (text.isascii() and text.isdigit()) or int(text[:20]) > LARGEST_ID:
        raise InvalidInput(f"{text[:40]!r} is no number of an event", "Give a whole number from 0.", where)
    return int(text)
