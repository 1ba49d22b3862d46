"""Which pages of other sites may call the service from a browser (CORS): none, unless they are named.

What is allowed is the same with and without tokens. Cookies are never asked for: a page of a named site has
to have a token of its own, and a browser sends none by itself.
"""

from __future__ import annotations

from collections.abc import Sequence

from starlette.middleware.cors import CORSMiddleware
from starlette.types import ASGIApp

METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE")
SENT = (
    "Authorization",
    "Content-Type",
    "If-Match",
    "If-None-Match",
    "Last-Event-ID",
    "Prefer",
    "Semap-Author",
    "Semap-Message",
    "X-Request-ID",
)
READ = (
    "ETag",
    "Link",
    "Location",
    "Preference-Applied",
    "RateLimit",
    "RateLimit-Policy",
    "Retry-After",
    "WWW-Authenticate",
    "X-Request-ID",
)
PREFLIGHT_KEPT_S = 600


class CrossOrigin(CORSMiddleware):
    """Answers preflights, and tells browsers that pages of these origins may read the answers."""

    def __init__(self, app: ASGIApp, origins: Sequence[str]) -> None:
        super().__init__(
            app,
            allow_origins=list(origins),
            allow_methods=list(METHODS),
            allow_headers=list(SENT),
            expose_headers=list(READ),
            max_age=PREFLIGHT_KEPT_S,
        )
