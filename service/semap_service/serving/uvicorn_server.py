"""How uvicorn serves semap: with connections that it lends to the feeds, and frames as they are written."""

from __future__ import annotations

import gc
from typing import Any

import uvicorn

from semap_service.http.connection import HttpConnection, WebSocketConnection

FROM_CLIENT_BYTES = 1024**2

OPTIONS: dict[str, Any] = {
    "http": HttpConnection,
    "ws": WebSocketConnection,
    # Compression would make a frame of its own for each client, and keep a window of 4 kB or more for each.
    "ws_per_message_deflate": False,
    "ws_max_size": FROM_CLIENT_BYTES,
}
"""For uvicorn.Config."""


def serve(app: Any, host: str, port: int, **options: Any) -> None:
    """Run an application until it is told to stop.

    What was loaded until now stays, and is not looked at again whenever unreachable objects are sought: that
    would take a tenth of a second, in which nobody is answered.
    """
    gc.collect()
    gc.freeze()
    uvicorn.run(app, host=host, port=port, log_config=None, access_log=False, **OPTIONS, **options)
