"""How many values a document of JSON may have, which is counted before it is read."""

from __future__ import annotations

import re

from semap.errors import InvalidInput, TooLarge

MOST_VALUES = 100_000
TEXT = re.compile(rb'"[^"\\]*(?:\\.[^"\\]*)*"?', re.DOTALL)
MARKS = (b"[", b"{", b",")


def require_few_values(document: bytes) -> None:
    """raises TooLarge for JSON of too many values, InvalidInput for what is not in UTF-8"""
    if b"\0" in document:
        raise InvalidInput("this is no JSON in UTF-8", "Encode it in UTF-8 (RFC 8259, 8.1).", "body")
    if _marks(document) > MOST_VALUES and _marks(TEXT.sub(b"", document)) > MOST_VALUES:
        raise TooLarge(
            f"The document has more than {MOST_VALUES:,} values.", "Send it in parts, or as a file."
        )


def _marks(document: bytes) -> int:
    return sum(document.count(mark) for mark in MARKS)
