"""The log as XES (IEEE 1849-2016): one trace for each case, one event for each event."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path
from typing import Literal
from xml.sax.saxutils import XMLGenerator
from xml.sax.xmlreader import AttributesImpl

from semap.model.event_log import ENTRY_TYPES, Entry

Case = Literal["instance", "track"]
EXTENSIONS = {
    "Concept": ("concept", "http://www.xes-standard.org/concept.xesext"),
    "Time": ("time", "http://www.xes-standard.org/time.xesext"),
    "Organizational": ("org", "http://www.xes-standard.org/org.xesext"),
    "Identity": ("identity", "http://www.xes-standard.org/identity.xesext"),
}
XML_TEXT = dict.fromkeys((*range(9), 11, 12, *range(14, 32), 0xFFFE, 0xFFFF), "\N{REPLACEMENT CHARACTER}")
"""Characters that XML cannot hold."""
ELSEWHERE = ("event_id", "type", "stamp", "track_id", "track", "instance_id", "key", "measures")
"""What extensions and measures say."""
SAID = tuple(name for name in ENTRY_TYPES if name not in ELSEWHERE)


def write_xes(entries: Iterable[Entry], path: Path, case: Case) -> int:
    """Write entries that come case by case, each case in the order of its stamps; returns how many.

    case  whose life a trace is: that of an instance, such as a room, or of a track. An event that has none
          is left out
    """
    count = 0
    with path.open("w", encoding="utf-8") as file:
        xml = XMLGenerator(file, "utf-8", short_empty_elements=True)
        xml.startDocument()
        _open(xml, "log", {"xes.version": "1849.2016", "xes.features": ""})
        for name, (prefix, uri) in EXTENSIONS.items():
            _element(xml, "extension", {"name": name, "prefix": prefix, "uri": uri})
        _element(xml, "classifier", {"name": "event", "keys": "concept:name"})
        known = (entry for entry in entries if getattr(entry, case) is not None)
        for (case_id, name), of_case in groupby(known, lambda entry: _case(entry, case)):
            _open(xml, "trace")
            _attributes(xml, {"concept:name": name, f"semap:{case}_id": case_id})
            for entry in of_case:
                _open(xml, "event")
                _attributes(xml, _said(entry))
                xml.endElement("event")
                count += 1
            xml.endElement("trace")
            xml.characters("\n")
        xml.endElement("log")
        xml.endDocument()
    return count


def _case(entry: Entry, case: Case) -> tuple[int | None, str]:
    return getattr(entry, f"{case}_id"), str(getattr(entry, case))


def _said(entry: Entry) -> Iterator[tuple[str, object]]:
    yield "concept:name", entry.type
    yield "time:timestamp", entry.stamp
    yield "identity:id", entry.event_id
    if entry.track is not None:
        yield "org:resource", entry.track
    for name in SAID:
        value = getattr(entry, name)
        if value is not None:
            yield f"semap:{name}", value
    for name, value in entry.measures.items():
        if value is not None:
            yield f"measure:{name}", value


def _attributes(xml: XMLGenerator, said: Iterable[tuple[str, object]] | Mapping[str, object]) -> None:
    for key, value in said.items() if isinstance(said, Mapping) else said:
        kind, text = _typed(key, value)
        _element(xml, kind, {"key": key.translate(XML_TEXT), "value": text.translate(XML_TEXT)})


def _typed(key: str, value: object) -> tuple[str, str]:
    match value:
        case bool():
            return "boolean", str(value).lower()
        case int():
            return "int", str(value)
        case float():
            return "float", repr(value)
        case datetime():
            return "date", value.astimezone(UTC).isoformat()
    return "id" if key == "identity:id" else "string", str(value)


def _element(xml: XMLGenerator, name: str, attributes: Mapping[str, str]) -> None:
    _open(xml, name, attributes)
    xml.endElement(name)


def _open(xml: XMLGenerator, name: str, attributes: Mapping[str, str] | None = None) -> None:
    xml.startElement(name, AttributesImpl(dict(attributes or {})))
