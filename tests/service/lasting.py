"""Services that last longer than a test, or that can be killed.

One for all tests of a module has no empty database for each, but they take a tenth of the time.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import httpx
import uvicorn
from patience import until
from running import Service
from semap_service.processes.port import free_port
from semap_service.serving.app import create_app
from semap_service.serving.uvicorn_server import OPTIONS
from server import fresh_database

from semap.cluster import Cluster
from semap.store.database.connection import connect
from semap.store.operate.rule_slot import ensure_slot

PATIENCE_S = 90.0


@contextmanager
def lasting_service(cluster: Cluster, template: str, **options: object) -> Iterator[Service]:
    """A service over a database of its own, until the block ends.

    options  as for `create_app`
    """
    with fresh_database(cluster, template) as dsn, connect(dsn) as plain:
        ensure_slot(plain)
        app = create_app(dsn, **{"heartbeat_s": 0.3, "without_tokens": True, **options})
        config = uvicorn.Config(
            app, host="127.0.0.1", port=0, log_level="error", timeout_graceful_shutdown=1, **OPTIONS
        )
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run)
        thread.start()
        until(lambda: server.started or not thread.is_alive())
        assert server.started
        port = server.servers[0].sockets[0].getsockname()[1]
        running = Service(port, plain, app, server)
        running.until(lambda: app.state.feed.connected)
        try:
            yield running
        finally:
            running.close()
            server.should_exit = True
            thread.join()


@contextmanager
def serving(dsn: str, *options: str) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """A service in a process of its own, and its address."""
    port = free_port()
    process = subprocess.Popen(
        [sys.executable, "-m", "semap_service", "serve", "--port", str(port), "--without-tokens", *options],
        env={**os.environ, "SEMAP_DSN": dsn},
    )
    try:
        yield process, f"http://127.0.0.1:{port}"
    finally:
        process.kill()
        process.wait()


def answers(url: str) -> bool:
    try:
        return httpx.get(f"{url}/health").is_success
    except httpx.TransportError:
        return False
