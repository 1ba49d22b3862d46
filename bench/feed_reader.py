"""Many WebSocket clients of /events/feed in one process, so cheap that they keep up; some of them never read.

python -m bench.feed_reader PORT READERS DEAF COUNT FILE

Says `ready` when all follow. Ends when each reader has COUNT events, or when nothing has come for a while;
then FILE has a row for each frame: client, first and last number, time of arrival [s, monotonic]. The number
of every event is looked at; frames with a gap, or that do not go on where the one before ended, are `broken`.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import socket
import sys
import time
from array import array
from dataclasses import dataclass, field

import numpy as np
import uvloop

PATIENCE_S = 20.0
NUMBER = re.compile(rb'\{"seq":(\d+),')
FRAMES_KNOWN = 64
ASKS = (
    b"GET /events/feed HTTP/1.1\r\nHost: localhost:%d\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


@dataclass
class Tally:
    """What all clients of this process have seen."""

    wanted: int
    following: int = 0
    done: int = 0
    broken: int = 0
    told: int = 0
    arrivals: array[float] = field(default_factory=lambda: array("d"))
    known: dict[bytes, tuple[int, int, bool]] = field(default_factory=dict)
    last_s: float = 0.0

    def numbers(self, payload: bytes) -> tuple[int, int, bool]:
        """First and last number of a frame, and whether all between are there once; most frames are alike."""
        found = self.known.get(payload)
        if found is None:
            seen = [int(each) for each in NUMBER.findall(payload)]
            whole = seen == list(range(seen[0], seen[0] + len(seen)))
            found = self.known[payload] = (seen[0], seen[-1], whole)
            if len(self.known) > FRAMES_KNOWN:
                del self.known[next(iter(self.known))]
        return found


class Reader(asyncio.Protocol):
    """One client. Frames of a server are not masked."""

    def __init__(self, number: int, tally: Tally, port: int) -> None:
        self.number = number
        self.tally = tally
        self.port = port
        self.buffer = bytearray()
        self.begun = False
        self.last: int | None = None
        self.count = 0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        self.transport = transport
        transport.write(ASKS % self.port)

    def data_received(self, data: bytes) -> None:
        at_s = time.monotonic()
        self.buffer += data
        if not self.begun:
            head, separator, rest = self.buffer.partition(b"\r\n\r\n")
            if not separator:
                return
            assert head.startswith(b"HTTP/1.1 101"), bytes(head)
            self.begun = True
            self.buffer = rest
        at = 0
        while (found := self._frame(at)) is not None:
            start, end = found
            if self.buffer[at] == 0x81:
                self._take(bytes(self.buffer[start:end]), at_s)
            elif self.buffer[at] == 0x89:
                self.transport.write(b"\x8a\x84\0\0\0\0" + self.buffer[start:end])
            at = end
        del self.buffer[:at]

    def _frame(self, at: int) -> tuple[int, int] | None:
        have = len(self.buffer) - at
        if have < 2:
            return None
        length, start = self.buffer[at + 1], at + 2
        if length >= 126:
            start += 2 if length == 126 else 8
            if len(self.buffer) < start:
                return None
            length = int.from_bytes(self.buffer[at + 2 : start], "big")
        return (start, start + length) if len(self.buffer) >= start + length else None

    def _take(self, payload: bytes, at_s: float) -> None:
        if not payload.startswith(b'{"type":"events"'):
            document = json.loads(payload)
            if document["type"] == "hello":
                self.last = document["cursor"]
                self.tally.following += 1
            elif document["type"] in ("error", "too_slow"):
                self.tally.told += 1
                print(payload.decode(), file=sys.stderr)
            return
        first, last, whole = self.tally.numbers(payload)
        if not whole or first != (self.last or 0) + 1:
            self.tally.broken += 1
        self.last = last
        self.count += last - first + 1
        self.tally.arrivals.extend((self.number, first, last, at_s))
        self.tally.last_s = at_s
        if self.count == self.tally.wanted:
            self.tally.done += 1


def deaf_client(port: int) -> socket.socket:
    """One that asks to follow and reads nothing of what it gets."""
    made = socket.create_connection(("127.0.0.1", port))
    made.sendall(ASKS % port)
    return made


async def main(port: int, readers: int, deaf: int, wanted: int, path: str) -> None:
    loop = asyncio.get_running_loop()
    tally = Tally(wanted)
    for number in range(readers):
        await loop.create_connection(lambda n=number: Reader(n, tally, port), "127.0.0.1", port)
    held = [deaf_client(port) for _ in range(deaf)]
    while tally.following < readers:
        await asyncio.sleep(0.01)
    print("ready", flush=True)
    tally.last_s = time.monotonic() + PATIENCE_S
    while tally.done < readers and time.monotonic() < tally.last_s + PATIENCE_S:
        await asyncio.sleep(0.1)
    np.save(path, np.array(tally.arrivals).reshape(-1, 4))
    print(json.dumps({"done": tally.done, "broken": tally.broken, "told": tally.told}), flush=True)
    # The deaf are held until the end, so that it is the service that lets go of them.
    with contextlib.suppress(EOFError):
        await asyncio.to_thread(input)
    for each in held:
        each.close()


if __name__ == "__main__":
    uvloop.install()
    given = sys.argv[1:]
    asyncio.run(main(*(int(each) for each in given[:4]), given[4]))
