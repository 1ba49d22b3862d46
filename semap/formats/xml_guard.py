"""XML from files that nobody vouches for: no document types, no entities, bounded in depth and number.

An entity that is made of entities grows to gigabytes from a kilobyte, and an external one reads files.
Mesh formats need neither, so that a document type is refused before anything is expanded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from xml.parsers import expat

from semap.errors import InvalidInput, TooLarge

MAX_DEPTH = 200

Start = Callable[[str, dict[str, str]], None]
End = Callable[[str], None]


def walk_xml(
    chunks: Iterable[bytes], max_elements: int, start: Start | None = None, end: End | None = None
) -> None:
    """Parse XML and call for each element, with names and attributes without namespaces.

    start   of name and attributes; may raise to stop
    raises  InvalidInput for anything but well-formed XML without a document type; TooLarge above a limit
    """
    parser = expat.ParserCreate()
    counts = {"depth": 0, "elements": 0}

    def refuse(*_: object) -> None:
        raise InvalidInput("a document type or an entity in XML", "Export the mesh again, without a DOCTYPE.")

    def started(name: str, attributes: dict[str, str]) -> None:
        counts["depth"] += 1
        counts["elements"] += 1
        if counts["depth"] > MAX_DEPTH or counts["elements"] > max_elements:
            raise TooLarge(
                f"The XML has more than {max_elements} elements, or more than {MAX_DEPTH} in one another.",
                "Simplify the mesh, or upload it in parts.",
            )
        if start is not None:
            start(local(name), {local(key): value for key, value in attributes.items()})

    def ended(name: str) -> None:
        counts["depth"] -= 1
        if end is not None:
            end(local(name))

    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    parser.StartElementHandler = started
    parser.EndElementHandler = ended
    try:
        for chunk in chunks:
            parser.Parse(chunk, False)
        parser.Parse(b"", True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise InvalidInput(f"no well-formed XML: {error}", "Export the mesh again.") from error


def local(name: str) -> str:
    """The name without its namespace, written as a prefix or in braces."""
    return name.rpartition("}")[2].rpartition(":")[2]
