"""What every answer tells browsers: its content is what it says it is, and may do nothing by itself.

A page, or whatever else needs more, says so itself.
"""

from __future__ import annotations

from starlette.datastructures import MutableHeaders
from starlette.types import Message

PAGE_POLICY = (
    "default-src 'self'; img-src 'self' data: blob:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'; object-src 'none'"
)
"""Of a page: nothing from another host, no script or style in the document, no frame around it."""

DEFAULTS = {
    "Content-Security-Policy": "default-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


def secure(start: Message) -> None:
    """Put on the start of an answer what it does not say itself."""
    headers = MutableHeaders(scope=start)
    for name, value in DEFAULTS.items():
        headers.setdefault(name, value)
