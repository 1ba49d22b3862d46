"""States sent over a WebSocket by a client that blocks."""

from __future__ import annotations

import time
from contextlib import ExitStack, suppress
from datetime import datetime
from types import TracebackType

import httpx
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from semap.client.socket import closed_by, said_by, socket_arguments
from semap.client.streaming import NewStates, Streaming
from semap.client.values import TakenStates


class StateStream:
    """Sends states; to be used in `with`, at whose end all is answered. See `Client.stream_states`."""

    def __init__(self, streaming: Streaming, http: httpx.Client) -> None:
        self._streaming = streaming
        self._http = http
        self._open = ExitStack()
        self._socket: ClientConnection | None = None

    def __enter__(self) -> StateStream:
        self._connected()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is None:
                self.flush()
        finally:
            self._open.close()

    def send(self, states: NewStates, *, watermark: datetime | None = None) -> list[TakenStates]:
        """Send states as one message; returns the answers to earlier ones that have come meanwhile.

        It waits where the service is behind, or is not there.

        watermark  the source gives no state up to this stamp after these
        raises     InvalidInput; Conflict where another client counts for the source
        """
        text = self._streaming.add(states, watermark)
        taken: list[TakenStates] = []
        try:
            self._connected(but=text).send(text)
        except (ConnectionClosed, OSError) as error:
            self._lost(error)
        while (answer := self._answer(0.0)) is not None:
            taken.append(answer)
        while self._streaming.is_full:
            taken += self._awaited()
        return taken

    def flush(self) -> list[TakenStates]:
        """Wait until all that was sent is answered."""
        taken: list[TakenStates] = []
        while self._streaming.unanswered:
            taken += self._awaited()
        return taken

    def _awaited(self) -> list[TakenStates]:
        answer = self._answer(None)
        return [] if answer is None else [answer]

    def _answer(self, timeout_s: float | None) -> TakenStates | None:
        """The next answer; None where none came in time, or the connection was lost."""
        if self._streaming.unanswered == 0:
            return None
        try:
            return self._streaming.take(self._connected().recv(timeout=timeout_s))
        except TimeoutError:
            return None
        except (ConnectionClosed, OSError) as error:
            self._lost(error)
            return None

    def _connected(self, but: str | None = None) -> ClientConnection:
        """but: a message that its sender sends"""
        while self._socket is None:
            try:
                made = self._open.enter_context(connect(**socket_arguments(self._http, self._streaming)))
                again = None
                while again is None:
                    again = self._streaming.greet(made.recv())
                for text in again:
                    if text is not but:
                        made.send(text)
                self._socket = made
            except InvalidStatus as error:
                time.sleep(self._streaming.refused(*said_by(error)))
            except (ConnectionClosed, InvalidHandshake, OSError) as error:
                self._lost(error)
        return self._socket

    def _lost(self, error: Exception) -> None:
        self._socket = None
        with suppress(ConnectionClosed, OSError):
            self._open.close()
        time.sleep(self._streaming.lost(*closed_by(error)))
