import threading
from collections.abc import Iterator

import psycopg
import pytest
import uvicorn
from patience import until
from running import Service
from semap_service.serving.app import create_app
from semap_service.serving.uvicorn_server import OPTIONS

from semap.store.database import connect


@pytest.fixture
def plain(database: str) -> Iterator[psycopg.Connection]:
    """A connection that may do anything."""
    with connect(database) as connection:
        yield connection


@pytest.fixture
def service(database: str, plain: psycopg.Connection) -> Iterator[Service]:
    """The service as it runs for users, on a port of its own."""
    app = create_app(database, heartbeat_s=0.3, without_tokens=True)
    config = uvicorn.Config(
        app, host="127.0.0.1", port=0, log_level="error", timeout_graceful_shutdown=1, **OPTIONS
    )
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        until(lambda: server.started or not thread.is_alive())
        assert server.started
        port = server.servers[0].sockets[0].getsockname()[1]
        running = Service(port, plain, app, server)
        running.until(lambda: app.state.feed.connected)
        yield running
        running.close()
    finally:
        server.should_exit = True
        thread.join()
