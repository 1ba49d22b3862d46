"""Events as JSON: bare, and as CloudEvents 1.0 (CNCF CloudEvents, JSON Event Format 1.0.2).

`id` is the event's own, so that an event that is delivered twice is known again; `source` is the path of its
map; `sequence` is the extension of that name, with the event's number, padded so that texts sort as numbers
do.
"""

from __future__ import annotations

import json
from urllib.parse import quote

from semap.store.event.events import StoredEvent
from semap.timeline.stamp import rfc3339

STRUCTURED = "application/cloudevents+json"
BATCH = "application/cloudevents-batch+json"
TYPE = "semap.event."
DIGITS = 19
"""Of the largest bigint: the extension Sequence wants texts in their order."""


def event_value(event: StoredEvent) -> dict[str, object]:
    """An event as a value for JSON; the service's documents say what each member means."""
    return {
        "seq": event.seq,
        "event_id": str(event.event_id),
        "map": event.map,
        "type": event.type,
        "stamp": rfc3339(event.stamp),
        "cause": event.cause,
        "rule": event.rule,
        "rule_version": event.rule_version,
        "track": _named(event.track_id, event.track_name),
        "instance": _named(event.instance_id, event.instance_name),
        "since": rfc3339(event.since),
        "key": dict(event.key),
        "measures": dict(event.measures),
        "confidence": event.confidence,
        "by_batch": event.by_batch,
        "verdict": event.verdict,
        "amended_by": None if event.amended_by is None else str(event.amended_by),
        "evidence": [
            {
                "uid": str(each.uid),
                "variable": each.variable,
                "source": each.source,
                "stamp": rfc3339(each.stamp),
            }
            for each in event.evidence
        ],
    }


def event_json(event: StoredEvent) -> bytes:
    """An event as JSON in UTF-8, without a line break."""
    return written(event_value(event))


def cloud_event(event: StoredEvent, schema_url: str | None = None) -> dict[str, object]:
    """An event in its envelope, as a value for JSON.

    schema_url  where the JSON Schema of `data` is, if the receiver can be told
    """
    return {**_attributes(event, schema_url), "data": event_value(event)}


def cloud_event_json(event: StoredEvent, document: bytes, schema_url: str | None = None) -> bytes:
    """The same as JSON in UTF-8, of an event whose document is written already."""
    return written(_attributes(event, schema_url))[:-1] + b',"data":' + document + b"}"


def _named(number: int | None, name: str | None) -> dict[str, object] | None:
    return None if number is None else {"id": number, "name": name or ""}


def written(value: dict[str, object]) -> bytes:
    """JSON in UTF-8 without a line break."""
    return json.dumps(value, ensure_ascii=False, separators=(",", ":")).encode()


def _attributes(event: StoredEvent, schema_url: str | None) -> dict[str, object]:
    attributes = {
        "specversion": "1.0",
        "id": str(event.event_id),
        "source": f"/maps/{quote(event.map, safe='')}",
        "type": TYPE + event.type,
        "time": rfc3339(event.stamp),
        "subject": event.instance_name or event.track_name,
        "datacontenttype": "application/json",
        "dataschema": schema_url,
        "sequence": f"{event.seq:0{DIGITS}}",
    }
    return {name: value for name, value in attributes.items() if value}
