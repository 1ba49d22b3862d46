"""How many values a document of JSON may have, which is counted before it is read."""

from __future__ import annotations

import re

from semap.errors import InvalidInput, TooLarge

MOST_VALUES = 100_000
TEXT = re.compile(rb'"[^"\\]*(?:\\.[^"\\]*)*"?', re.DOTALL)
TEXTS_AT_ONCE = 10_000
"""Texts that are removed in one call into C, during which no other thread runs."""
MARKS = (b"[", b"{", b",")
LONG_NUMBER = re.compile(rb"(?<!\d)\d{401,}")
"""Longer than any that a double can be; to read one takes the square of its length."""


def require_few_values(document: bytes) -> None:
    """raises TooLarge for too many values, InvalidInput for a very long number or other than UTF-8"""
    if b"\0" in document:
        raise InvalidInput("this is no JSON in UTF-8", "Encode it in UTF-8 (RFC 8259, 8.1).", "body")
    if LONG_NUMBER.search(document) and LONG_NUMBER.search(_without_texts(document)):
        raise InvalidInput("it has a number of more than 400 digits", "Give it as text.", "body")
    # Of texts, each with two quotes, every other one may be a name.
    quotes = document.count(b'"') - document.count(b'\\"')
    if quotes > 4 * MOST_VALUES or (
        _marks(document) > MOST_VALUES and _marks(_without_texts(document)) > MOST_VALUES
    ):
        raise TooLarge(
            f"The document has more than {MOST_VALUES:,} values.", "Send it in parts, or as a file."
        )


def _without_texts(document: bytes) -> bytes:
    removed = TEXTS_AT_ONCE
    while removed == TEXTS_AT_ONCE:
        document, removed = TEXT.subn(b"", document, TEXTS_AT_ONCE)
    return document


def _marks(document: bytes) -> int:
    return sum(document.count(mark) for mark in MARKS)
