"""Lines of JSON: states from a file, which may grow, or over TCP; events as CloudEvents to a file.

A file that is read has a position, how many bytes of it are in, so that each of its lines is in once,
whatever is killed. Over TCP it comes live. A file that is written has its cursor in itself, the number in its
last line, so that each event is in it once; a line that was cut short is cut off.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, ClassVar, Literal

from pydantic import Field, model_validator

from semap.errors import ServiceUnreachable
from semap.store.motion.bridges import Position
from semap_bridge import adapter
from semap_bridge.adapter import Adapter, Batch, Happening, Sight, Sink, Source
from semap_bridge.config import ConfigPath
from semap_bridge.lines import batch_of_lines
from semap_bridge.messages.cursor import number_in

LINES = 1000
LONGEST_LINE = 1 << 20
LOOK_S = 0.1
"""So often a file is looked at that may have grown."""
ADDRESS = r"^[^:\s]*:[0-9]{1,5}$"


class NdjsonSettings(adapter.Settings):
    """Where lines come from, and where they go."""

    read: ConfigPath | None = Field(default=None, description="File of states, a JSON object a line.")
    follow: bool = Field(default=False, description="Wait for more at the end of the file.")
    listen: str | None = Field(
        default=None, pattern=ADDRESS, description="Address for states over TCP, such as 127.0.0.1:9000."
    )
    write: ConfigPath | None = Field(default=None, description="File that events are added to.")
    write_changes: ConfigPath | None = Field(
        default=None, description="File that changes of relations are added to."
    )

    @model_validator(mode="after")
    def _require_something(self) -> NdjsonSettings:
        if self.read is not None and self.listen is not None:
            raise ValueError("give read or listen: each is a bridge of its own")
        if not any((self.read, self.listen, self.write, self.write_changes)):
            raise ValueError("give read, listen, write or write_changes")
        return self


class Ndjson(Adapter[NdjsonSettings]):
    Settings = NdjsonSettings

    def source(self) -> Source | None:
        if self.settings.read is not None:
            return _File(self.settings.read, self.settings.follow)
        return None if self.settings.listen is None else _Listening(self.settings.listen, self)

    def sink(self) -> Sink | None:
        return None if self.settings.write is None else _Written(self.settings.write)

    def changes(self) -> Sink | None:
        return None if self.settings.write_changes is None else _Written(self.settings.write_changes)

    async def look(self, seconds: float) -> Sequence[Sight]:
        sights = []
        if self.settings.read is not None:
            there = self.settings.read.is_file()
            sights.append(
                Sight(
                    self.settings.read.name,
                    f"{self.settings.read.stat().st_size} bytes" if there else "file",
                    trouble="" if there else f"There is no file {self.settings.read}.",
                    remedy="" if there else "Correct `read`, or write the file.",
                )
            )
        if self.settings.write is not None:
            folder = self.settings.write.resolve().parent
            usable = os.access(folder, os.W_OK)
            sights.append(
                Sight(
                    self.settings.write.name,
                    "file of events",
                    trouble="" if usable else f"Nothing can be written to {folder}.",
                    remedy="" if usable else "Correct `write`, or the rights of the folder.",
                )
            )
        return sights


class _File(Source):
    """A file; a position is {"offset": how many bytes are in}."""

    def __init__(self, path: Path, follow: bool) -> None:
        self._path = path
        self._follow = follow

    async def batches(self, position: Position | None) -> AsyncIterator[Batch]:
        offset = int(str((position or {}).get("offset", 0)))
        try:
            with self._path.open("rb") as file:
                if os.fstat(file.fileno()).st_size < offset:
                    offset = 0  # it was begun anew
                file.seek(offset)
                while True:
                    lines = await asyncio.to_thread(_whole_lines, file, self._follow)
                    if lines:
                        yield batch_of_lines(lines, {"offset": file.tell()})
                    elif self._follow:
                        await asyncio.sleep(LOOK_S)
                    else:
                        return
        except OSError as error:
            raise ServiceUnreachable(
                f"{self._path} cannot be read: {error.strerror}.", "Correct `read`, or write the file."
            ) from error


class _Listening(Source):
    """Lines of whoever connects."""

    def __init__(self, address: str, bridge: Ndjson) -> None:
        self._host, _, port = address.rpartition(":")
        self._port = int(port)
        self._bridge = bridge
        self._came: asyncio.Queue[Batch] = asyncio.Queue(maxsize=10)

    async def batches(self, position: Position | None) -> AsyncIterator[Batch]:
        try:
            server = await asyncio.start_server(self._hear, self._host, self._port, limit=LONGEST_LINE)
        except OSError as error:
            raise ServiceUnreachable(
                f"{self._host}:{self._port} cannot be listened to: {error.strerror}.", "Correct `listen`."
            ) from error
        try:
            while True:
                yield await self._came.get()
        finally:
            server.close()

    async def _hear(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        rest = b""
        with suppress(OSError):
            while data := await reader.read(LONGEST_LINE):
                *lines, rest = (rest + data).split(b"\n")
                if len(rest) > LONGEST_LINE:
                    self._bridge.context.refuse("line too long", f"more than {LONGEST_LINE} bytes")
                    break
                if lines:
                    await self._came.put(batch_of_lines(lines))
            writer.close()


class _Written(Sink):
    """A file of CloudEvents, which is its own cursor."""

    cursor_at: ClassVar[Literal["database", "broker"]] = "broker"

    def __init__(self, path: Path) -> None:
        self._path = path

    async def cursor(self) -> int | None:
        return await asyncio.to_thread(_last_number, self._path)

    async def deliver(self, happenings: Sequence[Happening]) -> None:
        data = b"".join(each.cloud_event_json() + b"\n" for each in happenings)
        await asyncio.to_thread(_append, self._path, data)


def _whole_lines(file: BinaryIO, follow: bool) -> list[bytes]:
    """The next lines; the last one may have no end where nothing more is waited for."""
    lines: list[bytes] = []
    for line in file:
        if not line.endswith(b"\n") and follow:
            file.seek(-len(line), os.SEEK_CUR)
            break
        lines.append(line)
        if len(lines) == LINES:
            break
    return lines


def _last_number(path: Path) -> int | None:
    """Of the last whole line; what follows it is cut off."""
    try:
        with path.open("r+b") as file:
            end = last = 0
            for line in file:
                if line.endswith(b"\n"):
                    end, last = end + len(line), number_in(line, "sequence")
            file.truncate(end)
            return last if end else None
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise ServiceUnreachable(
            f"{path} cannot be gone on with: {error}.", "Name a file that semap alone writes to."
        ) from error


def _append(path: Path, data: bytes) -> None:
    try:
        with path.open("ab") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise ServiceUnreachable(
            f"{path} cannot be written: {error.strerror}.", "See that there is room, and that semap may."
        ) from error
