"""What each operation asks of its caller: the one table.

Whatever is not in it: reading (GET, HEAD) asks for `read`, everything else for `write`. So a new route is
guarded before anybody thinks of it. The first row whose method and path fit decides.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from starlette.routing import compile_path

from semap.store.map.operator_table import OPERATORS
from semap_service.context.caller import Scope

READING = ("GET", "HEAD", "OPTIONS")


@dataclass(frozen=True)
class Demand:
    """What an operation asks of its caller.

    scope     None: nobody needs a token
    all_maps  it is about what all maps share, so that a token for some of them is not enough
    is_held   it stays open, and counts as a feed: `always`, or only `waiting` (with the parameter `wait`)
    is_long   it may take the database as long as an import does
    """

    scope: Scope | None
    all_maps: bool = False
    is_held: str = ""
    is_long: bool = False


READ = Demand("read")
WRITE = Demand("write", is_long=True)
INGEST = Demand("ingest")
ADMIN = Demand("admin")
NOBODY = Demand(None)
SHARED = Demand("write", all_maps=True, is_long=True)
HELD = Demand("read", is_held="always")
WAITING = Demand("read", is_held="waiting")

POLICY: tuple[tuple[str, str, Demand], ...] = (
    # What says nothing of any map: health for whoever watches the process, how to ask, and files of the page.
    ("GET", "/", NOBODY),
    ("GET", "/health", NOBODY),
    ("GET", "/ready", NOBODY),
    ("GET", "/conformance", NOBODY),
    ("GET", "/api", NOBODY),
    ("GET", "/openapi.json", NOBODY),
    ("GET", "/asyncapi.json", NOBODY),
    ("GET", "/docs", NOBODY),
    ("GET", "/docs/{file:path}", NOBODY),
    ("GET", "/page/{file:path}", NOBODY),
    ("GET", "/favicon.ico", NOBODY),
    # What is about the service itself.
    ("*", "/tokens", ADMIN),
    ("*", "/tokens/{rest:path}", ADMIN),
    ("*", "/webhooks", ADMIN),
    ("*", "/webhooks/{rest:path}", ADMIN),
    ("GET", "/metrics", ADMIN),
    # What sources say.
    ("POST", "/object-states", INGEST),
    ("POST", "/maps/{name}/states", INGEST),
    ("GET", "/maps/{name}/states/live", Demand("ingest", is_held="always")),
    # Questions that are posted.
    *(("POST", f"/maps/{{name}}/operators/{each.name}", WRITE) for each in OPERATORS.values() if each.edits),
    ("POST", "/maps/{name}/operators/{operator}", READ),
    ("POST", "/maps/{name}/rules/check", READ),
    ("POST", "/rules/dry-run", READ),
    ("POST", "/rule-templates/{name}/text", READ),
    # What all maps share: concepts, and the list of maps itself.
    ("POST", "/maps", SHARED),
    ("POST", "/maps/import", SHARED),
    ("POST", "/concepts", SHARED),
    ("PATCH", "/concepts/{name}", SHARED),
    ("DELETE", "/concepts/{name}", SHARED),
    # What stays open.
    ("GET", "/events", WAITING),
    ("GET", "/jobs/{id}", WAITING),
    ("GET", "/events/stream", HELD),
    ("GET", "/events/feed", HELD),
    ("GET", "/maps/{name}/live", HELD),
    # What reads a whole map.
    ("GET", "/maps/{name}/export", Demand("read", is_long=True)),
)

_COMPILED: tuple[tuple[str, re.Pattern[str], Demand], ...] = tuple(
    (method, compile_path(path)[0], demand) for method, path, demand in POLICY
)


def demand_of(method: str, path: str) -> Demand:
    """What is asked of whoever calls a path (or a template of it, as /openapi.json names it)."""
    wanted = "GET" if method == "HEAD" else method
    for known, pattern, demand in _COMPILED:
        if known in ("*", wanted) and pattern.match(path):
            return demand
    return READ if method in READING else WRITE
