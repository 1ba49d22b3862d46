"""States sent over a WebSocket by a client that awaits."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack, suppress
from datetime import datetime
from types import TracebackType

import httpx
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus

from semap.client.socket import closed_by, said_by, socket_arguments
from semap.client.streaming import NewStates, Streaming
from semap.client.values import TakenStates

NOW_S = 0.001


class AsyncStateStream:
    """As StateStream, to be used in `async with`."""

    def __init__(self, streaming: Streaming, http: httpx.AsyncClient) -> None:
        self._streaming = streaming
        self._http = http
        self._open = AsyncExitStack()
        self._socket: ClientConnection | None = None

    async def __aenter__(self) -> AsyncStateStream:
        await self._connected()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is None:
                await self.flush()
        finally:
            await self._open.aclose()

    async def send(self, states: NewStates, *, watermark: datetime | None = None) -> list[TakenStates]:
        """As StateStream.send."""
        text = self._streaming.add(states, watermark)
        taken: list[TakenStates] = []
        try:
            await (await self._connected(but=text)).send(text)
        except (ConnectionClosed, OSError) as error:
            await self._lost(error)
        while (answer := await self._answer(NOW_S)) is not None:
            taken.append(answer)
        while self._streaming.is_full:
            taken += await self._awaited()
        return taken

    async def flush(self) -> list[TakenStates]:
        """Wait until all that was sent is answered."""
        taken: list[TakenStates] = []
        while self._streaming.unanswered:
            taken += await self._awaited()
        return taken

    async def _awaited(self) -> list[TakenStates]:
        answer = await self._answer(None)
        return [] if answer is None else [answer]

    async def _answer(self, timeout_s: float | None) -> TakenStates | None:
        if self._streaming.unanswered == 0:
            return None
        try:
            connected = await self._connected()
            async with asyncio.timeout(timeout_s):
                text = await connected.recv()
        except TimeoutError:
            return None
        except (ConnectionClosed, OSError) as error:
            await self._lost(error)
            return None
        return self._streaming.take(text)

    async def _connected(self, but: str | None = None) -> ClientConnection:
        while self._socket is None:
            try:
                arguments = socket_arguments(self._http, self._streaming)
                made = await self._open.enter_async_context(connect(**arguments))
                again = None
                while again is None:
                    again = self._streaming.greet(await made.recv())
                for text in again:
                    if text is not but:
                        await made.send(text)
                self._socket = made
            except InvalidStatus as error:
                await asyncio.sleep(self._streaming.refused(*said_by(error)))
            except (ConnectionClosed, InvalidHandshake, OSError) as error:
                await self._lost(error)
        return self._socket

    async def _lost(self, error: Exception) -> None:
        self._socket = None
        with suppress(ConnectionClosed, OSError):
            await self._open.aclose()
        await asyncio.sleep(self._streaming.lost(*closed_by(error)))
