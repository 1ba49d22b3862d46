"""Following the events: a state machine between a stream that may break and a reader that must not notice.

The stream is Server-Sent Events (`/events/stream`). The cursor is the number of the last event that was given
out; a stream that breaks is asked for again after the cursor, so that nothing is missed, and what comes with
a number up to the cursor is passed over, so that nothing is repeated. The greeting of each stream says
whether events after the cursor have been deleted meanwhile: that is told, never passed over in silence.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, Literal

from semap.client.exchange import Answer, Request, given, read
from semap.client.problem import retry_after_s
from semap.client.retrying import backoff_s
from semap.client.values import Event
from semap.errors import NoLongerKept, ServiceUnreachable, UntrustedBytes

Gaps = Literal["raise", "skip"]

SILENCE_S = 45.0
"""A stream from which not even a heartbeat comes for so long is taken for broken; they come every 15 s."""

AGAIN = (
    HTTPStatus.TOO_MANY_REQUESTS,
    HTTPStatus.BAD_GATEWAY,
    HTTPStatus.SERVICE_UNAVAILABLE,
    HTTPStatus.GATEWAY_TIMEOUT,
)
"""What these say passes by itself."""


@dataclass
class Following:
    """One reader; `request`, then `take` each message, and after a break `lost` and `request` again.

    cursor  the number of the last event that the reader knows; None: begin with what comes
    gaps    what to do where events after the cursor are no longer kept
    tries   so often the first connection is tried; later ones are tried again for ever
    """

    query: Mapping[str, Any]
    cursor: int | None
    gaps: Gaps
    tries: int
    failures: int = 0
    has_begun: bool = False

    def request(self) -> Request:
        """The stream, from the cursor on."""
        headers = {"Accept": "text/event-stream"}
        return Request("GET", "/events/stream", given({**self.query, "after": self.cursor}), headers=headers)

    def take(self, kind: str, number: str, data: str) -> Event | None:
        """The event of a message, if it holds one that is new.

        kind, number, data  of the message; heartbeats have a number only
        raises              NoLongerKept, UntrustedBytes, Interrupted where the service ends the stream
        """
        event = None
        if kind == "hello":
            self._greet(_object(data))
        elif kind in ("error", "too_slow"):
            raise Interrupted(str(_object(data).get("detail") or kind))
        elif data:
            event = read(Event, _object(data))
            if self.cursor is not None and event.seq <= self.cursor:
                return None
            self.cursor = event.seq
        if number.isascii() and number.isdigit():
            self.cursor = max(self.cursor or 0, int(number))
        return event

    def refused(self, answer: Answer) -> float:
        """Seconds to wait before the stream is asked for again. raises what the problem stands for"""
        if answer.status not in AGAIN:
            answer.raise_for_problem()
        wait_s = self.lost(f"it answers with status {answer.status}")
        return max(wait_s, retry_after_s(answer.headers))

    def lost(self, reason: str) -> float:
        """Seconds to wait before the stream is asked for again.

        raises  ServiceUnreachable where it never answered
        """
        self.failures += 1
        if not self.has_begun and self.failures > self.tries:
            raise ServiceUnreachable(
                f"The feed of events cannot be followed: {reason}.",
                "See that semap is up, and that the address and port are right.",
            )
        return backoff_s(self.failures - 1)

    def _greet(self, hello: Mapping[str, Any]) -> None:
        self.has_begun = True
        self.failures = 0
        if hello.get("resumed") == "no_longer_kept" and self.gaps == "raise":
            oldest = hello.get("oldest")
            raise NoLongerKept(self.cursor or 0, oldest if isinstance(oldest, int) else None)


class Interrupted(Exception):
    """The service ended the stream; it may be asked for again."""


def _object(data: str) -> Mapping[str, Any]:
    try:
        message = json.loads(data)
    except ValueError as error:
        raise UntrustedBytes(
            "A message of the feed is no JSON.", "See what is between it and you."
        ) from error
    if not isinstance(message, dict):
        raise UntrustedBytes("A message of the feed is no object.", "See what is between it and you.")
    return message
