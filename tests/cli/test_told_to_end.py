"""`semap serve` that is told to end while it starts: it waits for a database that takes connections and is silent."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from threading import Event, Thread

import pytest
from psycopg.conninfo import conninfo_to_dict, make_conninfo
from semap_service.processes.port import free_port
from server import reachable_folder

PATIENCE_S = 60.0


@contextmanager
def silent_after(dsn: str, answered: int) -> Iterator[tuple[str, Event]]:
    """The database behind a socket that answers so many connections; the event is set when another one comes."""
    parts = conninfo_to_dict(dsn)
    behind = f"{parts['host']}/.s.PGSQL.{parts.get('port', 5432)}"
    kept: list[socket.socket] = []
    waits = Event()

    def pump(source: socket.socket, sink: socket.socket) -> None:
        try:
            while data := source.recv(65_536):
                sink.sendall(data)
            sink.shutdown(socket.SHUT_WR)
        except OSError:
            pass  # one of both is gone

    def accept(listening: socket.socket) -> None:
        for number in count():
            try:
                client, _ = listening.accept()
            except OSError:
                return
            kept.append(client)
            if number >= answered:
                waits.set()
                continue
            server = socket.socket(socket.AF_UNIX)
            kept.append(server)
            server.connect(behind)
            for ends in ((client, server), (server, client)):
                Thread(target=pump, args=ends, daemon=True).start()

    with reachable_folder() as folder, socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(Path(folder) / ".s.PGSQL.5432"))
        listening.listen()
        Thread(target=accept, args=(listening,), daemon=True).start()
        yield make_conninfo(dsn, host=str(folder), port=5432), waits
        listening.shutdown(socket.SHUT_RDWR)
        for each in kept:
            each.close()


@pytest.mark.parametrize("answered", range(2))
def test_serve_leaves_wherever_it_waits(database: str, answered: int) -> None:
    with silent_after(database, answered) as (dsn, waits):
        process = subprocess.Popen(
            [sys.executable, "-m", "semap_service", "serve", "--port", str(free_port())],
            env={**os.environ, "SEMAP_DSN": dsn}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        try:
            assert waits.wait(PATIENCE_S)
            process.terminate()
            said, _ = process.communicate(timeout=PATIENCE_S)
        finally:
            process.kill()
        assert "Traceback" not in said
        assert process.returncode == 0
