"""GML as a tree of elements, from bytes that nobody vouches for.

No document type, and so no entity, is accepted; nothing outside the bytes is read. Depth and number of
elements are limited. Each element remembers its line.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput, TooLarge

MAX_BYTES = 256 * 1024**2
MAX_ELEMENTS = 5_000_000
MAX_DEPTH = 100
LINE = "{semap}line"
GML = "http://www.opengis.net/gml"
XLINK = "{http://www.w3.org/1999/xlink}"


def parse_xml(data: bytes, where: str) -> Element:
    """The root element of an XML document.

    raises  InvalidInput if it is not well-formed or has a document type; TooLarge
    """
    if len(data) > MAX_BYTES:
        raise TooLarge(f"{where}: {len(data)} bytes; the limit is {MAX_BYTES}.", "Export it in parts.")
    reading = _Reading(where)
    try:
        return reading.tree(data)
    except expat.ExpatError as error:
        raise InvalidInput(
            f"not XML: {expat.ErrorString(error.code)}", "Export it again.", f"{where}:{error.lineno}"
        ) from error
    except (ValueError, LookupError) as error:
        raise InvalidInput(f"not XML: {error}", "Export it again, in UTF-8.", where) from error


def name_of(element: Element) -> str:
    """The name of an element without its namespace."""
    return element.tag.rpartition("}")[2]


def children(element: Element, *names: str) -> Iterator[Element]:
    """The children of some names, in whatever namespace: those of IndoorGML differ between versions."""
    return (child for child in element if name_of(child) in names)


def child(element: Element, *names: str) -> Element | None:
    """The first of `children`."""
    return next(children(element, *names), None)


def text_of(element: Element, *names: str) -> str | None:
    """The text of the first child of some names, without white space around; None where it is empty."""
    found = child(element, *names)
    return None if found is None or found.text is None else found.text.strip() or None


def id_of(element: Element) -> str | None:
    """gml:id, of GML 3.1 or 3.2."""
    return element.get(f"{{{GML}/3.2}}id") or element.get(f"{{{GML}}}id")


def by_id(root: Element) -> dict[str, Element]:
    """All elements that have a gml:id, by it."""
    return {key: element for element in root.iter() if (key := id_of(element)) is not None}


def referred(element: Element, ids: Mapping[str, Element]) -> Element | None:
    """The element of this document that an xlink:href refers to; None where there is none."""
    href = element.get(f"{XLINK}href") or ""
    return ids.get(href[1:]) if href.startswith("#") else None


def points_of(element: Element, where: str) -> NDArray[np.float64]:
    """The positions (n, 3) of a point, ring or line; heights that are not given are 0.

    raises  InvalidInput if a number is none or not finite, or if they do not go together
    """
    lists = [each for each in element.iter() if name_of(each) in ("pos", "posList")]
    rows: list[NDArray[np.float64]] = []
    for each in lists:
        at = f"{where}:{each.get(LINE)}"
        try:
            numbers = np.array((each.text or "").split(), dtype=np.float64)
        except ValueError as error:
            raise InvalidInput(f"a position that is no number: {error}", "Export it again.", at) from error
        size = _dimension(each, element, len(numbers))
        if size not in (2, 3) or len(numbers) % size or not np.isfinite(numbers).all():
            raise InvalidInput(
                f"{len(numbers)} numbers are no positions of {size} finite coordinates",
                "Export it again.",
                at,
            )
        points = numbers.reshape(-1, size)
        rows.append(points if size == 3 else np.column_stack([points, np.zeros(len(points))]))
    if not rows:
        raise InvalidInput("there are no positions", "Export it with gml:pos or gml:posList.", where)
    return np.concatenate(rows)


def _dimension(positions: Element, around: Element, count: int) -> int:
    for element in (positions, around):
        if (said := element.get("srsDimension")) is not None:
            return int(said) if said.isdigit() else 0
    return count if name_of(positions) == "pos" else 3


@dataclass(eq=False)
class _Reading:
    """State of one parse."""

    where: str
    depth: int = 0
    count: int = 0
    builder: TreeBuilder = field(default_factory=TreeBuilder)

    def tree(self, data: bytes) -> Element:
        parser = expat.ParserCreate(namespace_separator="}")
        parser.buffer_text = True

        def begin(name: str, attributes: dict[str, str]) -> None:
            self.depth += 1
            self.count += 1
            at = f"{self.where}:{parser.CurrentLineNumber}"
            if self.depth > MAX_DEPTH:
                raise InvalidInput(
                    f"more than {MAX_DEPTH} elements inside each other", "Export it again.", at
                )
            if self.count > MAX_ELEMENTS:
                raise TooLarge(f"{at}: more than {MAX_ELEMENTS} elements.", "Export it in parts.")
            named = {_qualified(key): value for key, value in attributes.items()}
            self.builder.start(_qualified(name), {**named, LINE: str(parser.CurrentLineNumber)})

        def end(name: str) -> None:
            self.depth -= 1
            self.builder.end(_qualified(name))

        def refuse(*_: object) -> None:
            raise InvalidInput(
                "a document type, which could hide entities",
                "Remove the line <!DOCTYPE ...>.",
                f"{self.where}:{parser.CurrentLineNumber}",
            )

        parser.StartElementHandler = begin
        parser.EndElementHandler = end
        parser.CharacterDataHandler = self.builder.data
        parser.StartDoctypeDeclHandler = refuse
        parser.EntityDeclHandler = refuse
        parser.Parse(data, True)
        return self.builder.close()


def _qualified(name: str) -> str:
    return "{" + name if "}" in name else name
