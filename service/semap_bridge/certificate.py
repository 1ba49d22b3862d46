"""How long a certificate is valid: the two times of X.509 (RFC 5280, 4.1.2.5), without I/O."""

from __future__ import annotations

import ssl
from datetime import UTC, datetime
from typing import NamedTuple

BEGIN, END = "-----BEGIN CERTIFICATE-----", "-----END CERTIFICATE-----"
UTC_TIME, VERSION = 0x17, 0xA0


class Validity(NamedTuple):
    """From when until when a certificate is valid."""

    since: datetime
    until: datetime


def validity(pem: str) -> Validity:
    """Of the first certificate in a text that OpenSSL has read as PEM."""
    start = pem.index(BEGIN)
    der = ssl.PEM_cert_to_DER_cert(pem[start : pem.index(END, start) + len(END)])
    at = _content(der, _content(der, 0)[0])[0]
    if der[at] == VERSION:
        at = _content(der, at)[1]
    for _ in ("serial number", "signature", "issuer"):
        at = _content(der, at)[1]
    since, after = _time(der, _content(der, at)[0])
    until, _ = _time(der, after)
    return Validity(since, until)


def _content(der: bytes, at: int) -> tuple[int, int]:
    """Where the content of an element begins and ends (X.690, 8.1.3)."""
    length, at = der[at + 1], at + 2
    if length & 0x80:
        digits = length & 0x7F
        length, at = int.from_bytes(der[at : at + digits], "big"), at + digits
    return at, at + length


def _time(der: bytes, at: int) -> tuple[datetime, int]:
    """A UTCTime, whose years are of 1950 to 2049, or a GeneralizedTime; and where it ends."""
    begin, end = _content(der, at)
    text = der[begin:end].decode("ascii")
    if der[at] == UTC_TIME:
        text = ("20" if text < "50" else "19") + text
    return datetime.strptime(text, "%Y%m%d%H%M%SZ").replace(tzinfo=UTC), end
