"""The size that a JPEG or PNG says to have, before anything is decoded."""

from __future__ import annotations

JPEG = b"\xff\xd8\xff"
PNG = b"\x89PNG\r\n\x1a\n"
# SOF0 to SOF15 of ISO/IEC 10918-1, table B.1, without DHT, JPG and DAC, which lie among them.
START_OF_FRAME = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


def size_px(data: bytes) -> tuple[int, int] | None:
    """Width and height; None where the header does not tell."""
    if data.startswith(PNG):
        return (_number(data, 16, 4), _number(data, 20, 4)) if len(data) >= 24 else None
    return _size_of_jpeg(data) if data.startswith(JPEG) else None


def _size_of_jpeg(data: bytes) -> tuple[int, int] | None:
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker, length = data[at + 1], _number(data, at + 2, 2)
        if marker in START_OF_FRAME:
            return _number(data, at + 7, 2), _number(data, at + 5, 2)
        if marker == 0xFF:  # a marker may be preceded by any number of these
            at += 1
        elif length >= 2:
            at += 2 + length
        else:
            return None
    return None


def _number(data: bytes, at: int, count: int) -> int:
    return int.from_bytes(data[at : at + count], "big")
