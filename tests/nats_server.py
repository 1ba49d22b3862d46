"""A server of NATS with JetStream for tests, from Debian's nats-server."""

from __future__ import annotations

import asyncio
import json
import shutil
import subprocess
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import nats
import pytest
from nats.aio.client import Client
from nats.js import JetStreamContext
from patience import until
from semap_service.processes.port import free_port


@dataclass
class Server:
    """A server of NATS with JetStream; what it stores outlives it."""

    folder: Path
    more: str = ""
    user: dict[str, str] = field(default_factory=dict)
    port: int = field(default_factory=free_port)
    process: subprocess.Popen | None = None

    @property
    def url(self) -> str:
        return f"nats://127.0.0.1:{self.port}"

    def start(self) -> None:
        program = shutil.which("nats-server", path="/usr/sbin:/usr/bin:/usr/local/bin:/bin")
        if program is None:
            pytest.skip("there is no nats-server: apt-get install nats-server")
        conf = self.folder / "nats.conf"
        conf.write_text(
            f'listen: "127.0.0.1:{self.port}"\njetstream {{ store_dir: "{self.folder}/store" }}\n{self.more}'
        )
        with (self.folder / "nats.log").open("ab") as log:
            self.process = subprocess.Popen([program, "-c", str(conf)], stdout=log, stderr=log)
        until(self.answers)

    def answers(self) -> bool:
        try:
            self.ask(lambda stream: stream.account_info())
        except (OSError, nats.errors.Error):
            return False
        return True

    def stop(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process = None

    def ask(self, question: Callable[[JetStreamContext], Awaitable[Any]]) -> Any:
        async def asking() -> Any:
            async def quiet(_: Exception) -> None: ...

            client = Client()
            try:
                await client.connect(self.url, allow_reconnect=False, error_cb=quiet, **self.user)
                return await question(client.jetstream())
            finally:
                await client.close()

        return asyncio.run(asking())

    def messages(self, subject: str, name: str = "semap") -> list[dict]:
        """All of a subject, by a reader that begins at its beginning."""

        async def read(stream: JetStreamContext) -> list[dict]:
            try:
                state = (await stream.stream_info(name)).state
            except nats.js.errors.NotFoundError:
                return []
            found = [
                await stream.get_msg(name, number)
                for number in range(max(state.first_seq, 1), state.last_seq + 1)
            ]
            return [json.loads(each.data) for each in found if each.subject == subject]

        return self.ask(read)


@contextmanager
def serving(folder: Path, more: str = "", **user: str) -> Iterator[Server]:
    server = Server(folder, more, user)
    server.start()
    try:
        yield server
    finally:
        server.stop()
