"""How much one caller may ask for."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """Generous, so that nobody meets them who does not err; each caller has them for itself.

    rate_per_s     requests, in the long run; a burst may be `BURST` times as many
    feeds          sockets, streams and waiting polls that are open at once
    statement_s    a statement of the database that takes longer is cancelled; long_statement_s: of one that
                   edits, imports or exports
    stall_s        a body that does not go on arriving for so long is given up
    url_bytes      path and query
    header_bytes   all headers together
    """

    rate_per_s: float = 500.0
    feeds: int = 2000
    statement_s: float = 30.0
    long_statement_s: float = 600.0
    stall_s: float = 30.0
    url_bytes: int = 16 * 1024
    header_bytes: int = 32 * 1024


LIMITS = Limits()
