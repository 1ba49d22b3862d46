"""NATS JetStream: events and changes of relations go to subjects of a stream, each with the id of its own.

A message that comes twice is known to the server by its id, within the stream's window. Beyond it, the stream
itself says how far it is, by the last message of the subject: what is up to it is not sent again, and each
message names the one that it comes after, so that a server refuses it where somebody else wrote meanwhile.
"""

from __future__ import annotations

import json
import ssl
from collections.abc import Callable, Sequence
from typing import Annotated, Any, NamedTuple
from urllib.parse import quote

from nats.aio.client import Client
from nats.errors import AuthorizationError, Error
from nats.js import JetStreamContext
from nats.js.api import Header
from nats.js.errors import APIError, NotFoundError
from pydantic import Field, model_validator
from sqlalchemy import Connection

from semap.errors import Conflict, ServiceUnreachable
from semap.store.database.event_number import newest_event
from semap.store.event.cloud_event import STRUCTURED
from semap.store.relation.changes import StoredChange
from semap_bridge import adapter
from semap_bridge.adapter import Adapter, Happening, Sight, Sink
from semap_bridge.config import ConfigPath
from semap_bridge.context import Context
from semap_bridge.messages.cursor import number_in
from semap_bridge.secret import Login, Tls, read_secret

ANSWER_S = 10.0
FULL = (10023, 10047, 10077)
"""Errors of JetStream: no resources, no storage, a stream at its limit that discards nothing."""

Subject = Annotated[str, Field(pattern=r"^[^\s.*>]+(\.[^\s.*>]+)*$", max_length=200)]


class NatsSettings(adapter.Settings):
    """Which subjects, and how the servers are reached."""

    servers: str = Field(
        pattern=r"^(nats|tls)://[^\s,@]+(,(nats|tls)://[^\s,@]+)*$",
        description="Addresses of servers, such as nats://host:4222.",
    )
    events: Subject | None = Field(default=None, description="Subject that events are published to.")
    changes: Subject | None = Field(
        default=None, description="Subject that changes of relations are published to."
    )
    stream: str = Field(
        default="semap",
        pattern=r"^[A-Za-z0-9_-]{1,200}$",
        description="Stream that is made for subjects which no stream has.",
    )
    login: Login | None = Field(default=None, description="User and password_file.")
    token_file: ConfigPath | None = Field(default=None, description="File with a token in its first line.")
    tls: Tls | None = Field(default=None, description="ca_file, certificate_file, key_file; {} for defaults.")

    @model_validator(mode="after")
    def _require_something(self) -> NatsSettings:
        if self.events is None and self.changes is None:
            raise ValueError("give events or changes: the subjects of messages")
        if self.events == self.changes:
            raise ValueError("give events and changes a subject each")
        return self


class Nats(Adapter[NatsSettings]):
    Settings = NatsSettings

    _client: Client | None = None
    _said: Exception | None = None

    async def open(self) -> None:
        settings = self.settings
        login, tls = settings.login, settings.tls
        shown: dict[str, Any] = {
            "user": None if login is None else login.user,
            "password": None if login is None else login.password(),
            "token": None if settings.token_file is None else read_secret(settings.token_file),
            "tls": None if tls is None else tls.context(),
        }
        try:
            # kept, so that `close` ends what of a connection was made, too
            self._client = Client()
            await self._client.connect(
                settings.servers.split(","),
                name=f"semap {settings.name}",
                allow_reconnect=False,  # the core waits, and tells so
                max_reconnect_attempts=1,
                reconnect_time_wait=0,
                connect_timeout=int(ANSWER_S),
                error_cb=self._hear,
                **shown,
            )
        except (TimeoutError, Error, OSError, ssl.SSLError) as error:
            raise self.unreachable(self._said or error) from error

    async def close(self) -> None:
        if self._client is not None:
            await self._client.close()

    def sink(self) -> Sink | None:
        return self._publishing(self.settings.events, newest_event)

    def changes(self) -> Sink | None:
        return self._publishing(self.settings.changes, None)

    async def look(self, seconds: float) -> Sequence[Sight]:
        stream = self._stream()
        sights = []
        for what in ("events", "changes"):
            subject = getattr(self.settings, what)
            if subject is None:
                continue
            try:
                found = await stream.find_stream_name_by_subject(subject)
                sights.append(Sight(subject, f"subject of {what}, in the stream {found}"))
            except NotFoundError:
                said = f"subject of {what}; the stream {self.settings.stream} will be made"
                sights.append(Sight(subject, said))
            except (Error, APIError) as error:
                raise self.unreachable(error) from error
        return sights

    def unreachable(self, error: Exception) -> ServiceUnreachable:
        remedy = "See that a server runs with JetStream (nats-server -js), and that `servers` is right."
        said = str(error) or type(error).__name__
        if isinstance(error, APIError):
            said = error.description or said
            if error.err_code in FULL:
                remedy = "Make room: on the server's disk, or by the limits of the stream."
        elif isinstance(error, AuthorizationError) or "uthori" in said:
            remedy = "Correct `login` or `token_file`; what is new in a file is taken at the next try."
        elif isinstance(error, ssl.SSLError) or "SSL" in said:
            remedy = "Correct `tls`: whom to trust (ca_file), and what this client shows."
        return ServiceUnreachable(f"NATS at {self.settings.servers}: {said}.", remedy)

    def _publishing(self, subject: str | None, newest: Callable[[Connection], int] | None) -> Sink | None:
        return None if subject is None else _Publishing(self, self._stream(), subject, newest)

    def _stream(self) -> JetStreamContext:
        if self._client is None:
            raise ServiceUnreachable("The connection to NATS was closed.")
        return self._client.jetstream(timeout=ANSWER_S)

    async def _hear(self, error: Exception) -> None:
        self._said = error


class _Last(NamedTuple):
    """Of a subject: the number of its last event, and the sequence that its message has."""

    number: int
    sequence: int


def number_of(message: bytes, map_name: str) -> int | None:
    """Of an event or a change of this map; None for whatever else a subject may have."""
    try:
        number = number_in(message, "sequence")
    except ValueError:
        return None
    is_own = json.loads(message).get("source") == f"/maps/{quote(map_name, safe='')}"
    return number if is_own else None


class _Publishing(Sink):
    """Mutable: the last message of the subject."""

    def __init__(
        self,
        bridge: Nats,
        stream: JetStreamContext,
        subject: str,
        newest: Callable[[Connection], int] | None,
    ) -> None:
        self._bridge = bridge
        self._context: Context = bridge.context
        self._stream = stream
        self._subject = subject
        self._newest = newest
        self._last: _Last | None = None

    async def deliver(self, happenings: Sequence[Happening]) -> None:
        try:
            if self._last is None:
                self._last = await self._find_last()
            for each in happenings:
                if each.number > self._last.number:
                    self._last = await self._publish(each, self._last)
        except (Error, APIError, OSError) as error:
            raise self._bridge.unreachable(error) from error

    async def _publish(self, happening: Happening, last: _Last) -> _Last:
        made = happening.made
        uid = made.uid if isinstance(made, StoredChange) else made.event_id
        answer = await self._stream.publish(
            self._subject,
            happening.cloud_event_json(),
            headers={
                Header.MSG_ID: str(uid),
                Header.EXPECTED_LAST_SUBJECT_SEQUENCE: str(last.sequence),
                "Content-Type": STRUCTURED,
            },
        )
        return _Last(happening.number, answer.seq)

    async def _find_last(self) -> _Last:
        """Of the stream, which is made where there is none."""
        try:
            name = await self._stream.find_stream_name_by_subject(self._subject)
        except NotFoundError:
            name = await self._make_stream()
        try:
            message = await self._stream.get_last_msg(name, self._subject)
        except NotFoundError:
            return _Last(0, 0)
        number = number_of(message.data or b"", self._context.map_name)
        if number is None:
            raise ServiceUnreachable(
                f"The subject {self._subject} has a message that is not of the map {self._context.map_name}.",
                "Name a subject that this bridge alone writes to.",
            )
        last = _Last(number, message.seq or 0)
        if self._newest is not None and last.number > (newest := await self._context.ask(self._newest)):
            raise Conflict(
                f"The subject {self._subject} has events up to number {last.number}, and this database up to"
                f" {newest}: they are of another one.",
                "Give this bridge another subject, or purge this one.",
            )
        return last

    async def _make_stream(self) -> str:
        name = self._bridge.settings.stream
        settings = self._bridge.settings
        subjects = [each for each in (settings.events, settings.changes) if each is not None]
        try:
            there = (await self._stream.stream_info(name)).config
        except NotFoundError:
            await self._stream.add_stream(name=name, subjects=subjects)
            return name
        raise ServiceUnreachable(
            f"The stream {name} has {', '.join(there.subjects or ())}, and not {self._subject}.",
            "Add the subject to a stream, or set `stream` to the name of one that is to be made.",
        )
