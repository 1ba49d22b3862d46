"""How uvicorn serves semap: with connections that it lends to the feeds, and frames as they are written."""

from __future__ import annotations

from typing import Any

from semap_service.feed.connection import HttpConnection, WebSocketConnection

FROM_CLIENT_BYTES = 64 * 1024

OPTIONS: dict[str, Any] = {
    "http": HttpConnection,
    "ws": WebSocketConnection,
    # Compression would make a frame of its own for each client, and keep a window of 4 kB or more for each.
    "ws_per_message_deflate": False,
    "ws_max_size": FROM_CLIENT_BYTES,
}
"""For uvicorn.Config."""
