"""Sending states over a WebSocket: a state machine between a connection that may break and a sender that must
not notice.

Messages are numbered, above the last number that the service has taken of the source. Those without an answer
are kept; after a break the greeting says which of them were taken, and the others are sent again, so that
nothing is lost or taken twice. At most `window` are without an answer: then the sender waits.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from http import HTTPStatus
from typing import Any, TypeAlias

from semap.client.exchange import read, segment
from semap.client.following import AGAIN
from semap.client.problem import error_of
from semap.client.retrying import backoff_s
from semap.client.values import TakenStates
from semap.errors import Conflict, InvalidInput, SemapError, ServiceUnreachable, UntrustedBytes

NewStates: TypeAlias = Sequence[Mapping[str, Any]] | Mapping[str, Any]
"""Rows, or columns: a list, or an array, for each member, or one value for all."""

REFUSED = 4400
"""The code with which the service closes where sending the same again would not help."""


@dataclass
class Streaming:
    """One sender: `greet` after each connection, `add` for each message, `take` each answer.

    tries     so often the first connection is tried; later ones are tried again for ever
    sequence  the number of the last message
    """

    map: str
    source: str
    tries: int
    sequence: int = 0
    window: int = 1
    failures: int = 0
    has_begun: bool = False
    _sent: deque[tuple[int, str]] = field(default_factory=deque)
    _failure: SemapError | None = None

    @property
    def path(self) -> str:
        return f"/maps/{segment(self.map)}/states/live"

    @property
    def unanswered(self) -> int:
        return len(self._sent)

    @property
    def is_full(self) -> bool:
        return len(self._sent) >= self.window

    def greet(self, text: str | bytes) -> list[str] | None:
        """What is to be sent again after the greeting of a connection; None where the service closes it next.

        raises  Conflict where somebody else counts for the source; UntrustedBytes
        """
        hello = self._message(text)
        if hello is None:
            return None
        if hello.get("type") != "hello":
            raise UntrustedBytes("The service does not greet.", "See what is between it and you.")
        last = int(hello.get("sequence", 0))
        if self.has_begun and last > self.sequence:
            raise Conflict(
                "Another client counts for this source, too.", "Give each client a source of its own."
            )
        if not self.has_begun:
            self.sequence = last
        while self._sent and self._sent[0][0] <= last:
            self._sent.popleft()
        self.has_begun, self.failures = True, 0
        self.window = max(1, int(hello.get("window", 1)))
        return [text for _, text in self._sent]

    def add(self, states: NewStates, watermark: datetime | None) -> str:
        """The next message. raises InvalidInput for what cannot be written as JSON"""
        message: dict[str, Any] = {"type": "states", "sequence": self.sequence + 1, "states": states}
        if watermark is not None:
            message["watermark"] = watermark
        text = json.dumps(message, default=_plain, separators=(",", ":"))
        self.sequence += 1
        self._sent.append((self.sequence, text))
        return text

    def take(self, text: str | bytes) -> TakenStates | None:
        """An answer; None where the service closes the connection next. raises UntrustedBytes"""
        message = self._message(text)
        if message is None:
            return None
        taken = read(TakenStates, message)
        if not self._sent or self._sent[0][0] != taken.sequence:
            raise UntrustedBytes("An answer is to no message.", "See what is between the service and you.")
        self._sent.popleft()
        return taken

    def refused(self, status: int, headers: Mapping[str, str], body: bytes) -> float:
        """Seconds to wait after a connection was refused. raises what the problem stands for"""
        if status not in (*AGAIN, HTTPStatus.INTERNAL_SERVER_ERROR):
            raise error_of(status, headers, body)
        return self.lost(f"it answers with status {status}")

    def lost(self, reason: str, code: int | None = None) -> float:
        """Seconds to wait before it is connected again.

        code    with which the service closed
        raises  what the service said, where that does not pass by itself; ServiceUnreachable where it never
                answered
        """
        failure, self._failure = self._failure, None
        if code == REFUSED:
            raise failure or InvalidInput(f"the service refuses it: {reason}", "See the reason.")
        self.failures += 1
        if not self.has_begun and self.failures > self.tries:
            raise failure or ServiceUnreachable(
                f"States cannot be sent: {reason}.",
                "See that semap is up, and that the address and port are right.",
            )
        return backoff_s(self.failures - 1)

    def _message(self, text: str | bytes) -> Mapping[str, Any] | None:
        """None: it says why the service closes the connection next."""
        try:
            message = json.loads(text)
        except ValueError as error:
            raise UntrustedBytes("A message is no JSON.", "See what is between it and you.") from error
        if not isinstance(message, dict):
            raise UntrustedBytes("A message is no object.", "See what is between it and you.")
        if message.get("type") == "error":
            self._failure = SemapError(str(message.get("detail", "")), str(message.get("remedy", "")))
            return None
        return message


def _plain(value: Any) -> Any:
    if isinstance(value, datetime):
        if value.tzinfo is None:
            raise InvalidInput(f"the stamp {value.isoformat()} has no zone", "Give aware stamps, as in UTC.")
        return value.isoformat()
    if hasattr(value, "tolist"):
        return value.tolist()
    raise InvalidInput(f"{value!r} is nothing that JSON has", "Give texts, numbers and aware stamps.")
