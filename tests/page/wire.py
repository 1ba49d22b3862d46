"""The line between browser and service, which can be cut in the ways in which lines are."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine
from dataclasses import dataclass, field
from typing import Any, Literal

Cut = Literal["reset", "silent", "midway"]
CUTS: tuple[Cut, ...] = ("reset", "silent", "midway")
A_FEW_BYTES = 200


@dataclass
class Wire:
    """Passes bytes on to a port of this machine.

    Cut by `reset`, connections break and no new one is made; `silent`, nothing is passed on any more; `midway`, each
    answer ends after its first bytes.
    """

    to_port: int
    port: int
    how: Cut | None = None
    loop: asyncio.AbstractEventLoop = field(default_factory=asyncio.new_event_loop)
    open: set[asyncio.StreamWriter] = field(default_factory=set)

    def __enter__(self) -> Wire:
        self.thread = threading.Thread(target=self.loop.run_forever, daemon=True)
        self.thread.start()
        self._do(self._listen())
        return self

    def __exit__(self, *raised: object) -> None:
        self._do(self._end())
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join()
        self.loop.close()

    def cut(self, how: Cut) -> None:
        self.how = how
        if how != "silent":
            self._do(self._break())

    def mend(self) -> None:
        self.how = None
        self._do(self._break())

    def _do(self, work: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(work, self.loop).result()

    async def _listen(self) -> None:
        self.server = await asyncio.start_server(self._pass, "127.0.0.1", self.port)

    async def _end(self) -> None:
        self.server.close()
        await self._break()
        passing = asyncio.all_tasks() - {asyncio.current_task()}
        for each in passing:
            each.cancel()
        await asyncio.gather(*passing, return_exceptions=True)

    async def _break(self) -> None:
        for each in self.open:
            each.transport.abort()
        self.open.clear()

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self.how == "reset":
            writer.transport.abort()
            return
        to_reader, to_writer = await asyncio.open_connection("127.0.0.1", self.to_port)
        self.open |= {writer, to_writer}
        await asyncio.gather(
            self._copy(reader, to_writer, is_answer=False), self._copy(to_reader, writer, is_answer=True)
        )

    async def _copy(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, *, is_answer: bool
    ) -> None:
        try:
            while data := await reader.read(65_536):
                if self.how == "silent":
                    continue
                if self.how == "midway" and is_answer:
                    writer.write(data[:A_FEW_BYTES])
                    await writer.drain()
                    break
                writer.write(data)
                await writer.drain()
        except ConnectionError:
            pass
        finally:
            if self.how != "silent":
                writer.close()
