"""Signed messages as Standard Webhooks 1.0.0 has them, so that any of its libraries verifies them.

The signature is HMAC-SHA256 over `ID.TIMESTAMP.BODY`, in base64, with the prefix `v1,`. While a secret is
replaced by another, a message carries a signature of each, with a space between them.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import secrets
from collections.abc import Iterable

SECRET_BYTES = 32
PREFIX = "whsec_"


def new_secret() -> bytes:
    return secrets.token_bytes(SECRET_BYTES)


def shown(secret: bytes) -> str:
    """A secret as receivers are given it."""
    return PREFIX + base64.b64encode(secret).decode()


def signed_headers(message_id: str, stamp_s: int, body: bytes, keys: Iterable[bytes]) -> dict[str, str]:
    """The headers of a message.

    stamp_s  when this attempt is made, in seconds since 1970; receivers refuse what is older than minutes
    """
    signed = f"{message_id}.{stamp_s}.".encode() + body
    signatures = (base64.b64encode(hmac.new(key, signed, hashlib.sha256).digest()).decode() for key in keys)
    return {
        "webhook-id": message_id,
        "webhook-timestamp": str(stamp_s),
        "webhook-signature": " ".join(f"v1,{each}" for each in signatures),
    }
