"""Authorisation of every request and every socket: size, host, rate, token, scope, and the caller that it
acts as.

What is refused is refused before its body or the database is read, but for the token itself. What stays open
is looked after: when its token is revoked, expires, or comes to be for other maps, it is closed.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from http import HTTPStatus
from urllib.parse import parse_qs

from starlette.types import ASGIApp, Message, Receive, Send
from starlette.types import Scope as Connection

from semap.errors import DatabaseError
from semap_service.access.credentials import SUBPROTOCOL, address_of, shown_token, without_token
from semap_service.access.limits import Limits
from semap_service.access.loopback_host import is_loopback
from semap_service.access.policy import Demand, demand_of
from semap_service.access.rate_limit import Allowance, Buckets
from semap_service.access.refusal import Refusal, close, refuse
from semap_service.access.token_cache import TokenCache
from semap_service.context.caller import ANYONE, Caller, acting_as
from semap_service.http.connection import EXTENSION
from semap_service.http.connection import Connection as LentConnection
from semap_service.http.problem import RETRY_S

CHECK_S = 1.0
"""What is open is looked after so often; the answer may be as old as TokenCache keeps it."""

NOBODY = Caller("nobody", None, frozenset({"read"}), frozenset(), frozenset())
"""Who shows no token where none is needed: for them there is no map."""

NO_TOKEN = Refusal(
    HTTPStatus.UNAUTHORIZED,
    "no-token",
    "This needs a token.",
    "Send the header `Authorization: Bearer semap_...`; `semap token add` makes a token.",
    {"WWW-Authenticate": 'Bearer realm="semap"'},
)
WRONG_TOKEN = Refusal(
    HTTPStatus.UNAUTHORIZED,
    "wrong-token",
    "The token is unknown, has expired, or was revoked.",
    "Ask the administrator for another one; `semap token list` shows them.",
    {"WWW-Authenticate": 'Bearer realm="semap", error="invalid_token"'},
)
CHANGED_TOKEN = Refusal(
    HTTPStatus.UNAUTHORIZED,
    "changed-token",
    "What the token allows has changed.",
    "Connect again and go on from the last cursor.",
)
MISDIRECTED = Refusal(
    HTTPStatus.MISDIRECTED_REQUEST,
    "misdirected",
    "A service without tokens answers to localhost, 127.0.0.1 and [::1] only.",
    "Call it by one of these, or start it with tokens.",
)
URL_TOO_LONG = Refusal(
    HTTPStatus.REQUEST_URI_TOO_LONG, "url-too-long", "The URL is too long.", "Ask for less at once."
)
HEADERS_TOO_LARGE = Refusal(
    HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE,
    "headers-too-large",
    "The headers are too large.",
    "Send fewer cookies and headers.",
)


class Authorisation:
    """Counts what is open and how often each caller asks.

    token_cache  None: nobody needs a token
    """

    def __init__(self, app: ASGIApp, limits: Limits, token_cache: TokenCache | None) -> None:
        self.app = app
        self._limits = limits
        self._token_cache = token_cache
        self._buckets = Buckets(limits.rate_per_s)
        self._open: Counter[str] = Counter()

    async def __call__(self, scope: Connection, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        refusal = self._misshapen(scope)
        if refusal is not None:
            await refuse(refusal, scope, receive, send)
            return
        demand = demand_of(scope.get("method", "GET"), route_path(scope))
        token = None if self._token_cache is None or demand.scope is None else shown_token(scope)
        try:
            found, key, allowance = await self._come_forward(demand, token, address_of(scope))
        except DatabaseError as error:
            await refuse(_unavailable(error), scope, receive, send)
            return
        answering = self._answering(scope, send, allowance)
        if allowance.wait_s > 0:
            await refuse(self._too_many(allowance), scope, receive, answering)
        elif isinstance(found, Refusal):
            await refuse(found, scope, receive, answering)
        else:
            scope = without_token(scope)
            scope.setdefault("state", {})["caller"] = found
            await self._let_in(found, demand, key, token, (scope, receive, answering))

    async def _come_forward(
        self, demand: Demand, token: str | None, address: str
    ) -> tuple[Caller | Refusal, str, Allowance]:
        """Who asks, or why they may not; by what they are counted; and what they have left.

        Whoever shows a token that counts is counted by it, everybody else by their address. A token that is
        not known costs a look-up, so that it is counted by its address first.
        """
        key = f"address {address}"
        if token is None or self._token_cache is None:
            return self._without(demand), key, self._buckets.take(key, time.monotonic())
        if not self._token_cache.is_known(token):
            allowance = self._buckets.take(key, time.monotonic())
            if allowance.wait_s > 0:
                return NO_TOKEN, key, allowance
        caller = await self._token_cache.caller(token)
        if caller is None:
            return WRONG_TOKEN, key, self._buckets.take(key, time.monotonic())
        key = f"token {caller.token_id}"
        return _lack(demand, caller) or caller, key, self._buckets.take(key, time.monotonic())

    def _without(self, demand: Demand) -> Caller | Refusal:
        """Who it is that shows no token."""
        if self._token_cache is None:
            return ANYONE
        return NOBODY if demand.scope is None else NO_TOKEN

    async def _let_in(
        self,
        caller: Caller,
        demand: Demand,
        key: str,
        token: str | None,
        call: tuple[Connection, Receive, Send],
    ) -> None:
        """Pass a request on as its caller, with the rights and the time that it asks for."""
        limits = self._limits
        statement_s = limits.long_statement_s if demand.is_long else limits.statement_s
        if not _is_held(demand, call[0]):
            with acting_as(caller, demand.scope or "read", statement_s=statement_s):
                await self.app(*call)
            return
        if self._open[key] >= limits.feeds:
            await refuse(_too_many_open(limits.feeds), *call)
            return
        self._open[key] += 1
        try:
            with acting_as(caller, demand.scope or "read", statement_s=statement_s):
                await self._hold(caller, token, call)
        finally:
            self._open[key] -= 1
            if not self._open[key]:
                del self._open[key]

    async def _hold(self, caller: Caller, token: str | None, call: tuple[Connection, Receive, Send]) -> None:
        """Pass on what stays open, and end it when its token no longer allows what it did."""
        if token is None or self._token_cache is None:
            await self.app(*call)
            return
        scope, receive, send = call
        sender = _Sender(send)
        running = asyncio.ensure_future(self.app(scope, receive, sender))
        try:
            refusal = await self._end_of(self._token_cache, caller, token, running)
            if refusal is None:
                return
            sender.is_shut = True
        finally:
            if not running.done():
                running.cancel()
                await asyncio.gather(running, return_exceptions=True)
        await _end(refusal, sender, scope, receive, send)

    async def _end_of(
        self, known: TokenCache, caller: Caller, token: str, running: asyncio.Future[None]
    ) -> Refusal | None:
        """Wait until a request is over (None), or its token no longer allows what it did."""
        while True:
            await asyncio.wait({running}, timeout=CHECK_S)
            if running.done():
                await running  # with what it raised
                return None
            try:
                now = await known.caller(token)
            except DatabaseError:
                continue  # it is asked again, and nothing new comes from the database meanwhile
            if now is None:
                return WRONG_TOKEN
            if now != caller:
                return CHANGED_TOKEN

    def _misshapen(self, scope: Connection) -> Refusal | None:
        """Why a request is refused whoever sends it."""
        headers: list[tuple[bytes, bytes]] = scope["headers"]
        if len(scope.get("raw_path") or b"") + len(scope["query_string"]) > self._limits.url_bytes:
            return URL_TOO_LONG
        if sum(len(name) + len(value) for name, value in headers) > self._limits.header_bytes:
            return HEADERS_TOO_LARGE
        if self._token_cache is None and not is_loopback(dict(headers).get(b"host", b"").decode("latin-1")):
            return MISDIRECTED
        return None

    def _too_many(self, allowance: Allowance) -> Refusal:
        return Refusal(
            HTTPStatus.TOO_MANY_REQUESTS,
            "too-many-requests",
            f"More than {self._buckets.rate_per_s:g} requests a second.",
            "Wait for the time in Retry-After; a feed needs no polling.",
            {"Retry-After": str(allowance.retry_after_s)},
        )

    def _answering(self, scope: Connection, send: Send, allowance: Allowance) -> Send:
        """Sends on, with the rate limit in the headers, and the subprotocol."""
        policy = self._buckets.policy().encode()
        state = self._buckets.state(allowance).encode()

        async def answer(message: Message) -> None:
            if message["type"] == "http.response.start":
                given = [(b"ratelimit-policy", policy), (b"ratelimit", state)]
                message = {**message, "headers": [*message.get("headers", ()), *given]}
            elif message["type"] == "websocket.accept" and SUBPROTOCOL in scope.get("subprotocols", ()):
                message = {**message, "subprotocol": message.get("subprotocol") or SUBPROTOCOL}
            await send(message)

        return answer


class _Sender:
    """Sends on until it is shut, and knows how far an answer has come."""

    def __init__(self, send: Send) -> None:
        self.is_shut = False
        self.has_begun = False
        self.has_ended = False
        self._send = send

    async def __call__(self, message: Message) -> None:
        if self.is_shut:
            raise asyncio.CancelledError
        self.has_begun = True
        ends_body = message["type"] == "http.response.body" and not message.get("more_body", False)
        self.has_ended = self.has_ended or ends_body or message["type"] == "websocket.close"
        await self._send(message)


async def _end(refusal: Refusal, sender: _Sender, scope: Connection, receive: Receive, send: Send) -> None:
    """End what was open, in the way that is left."""
    if sender.has_ended:
        return
    lent: LentConnection | None = scope.get("extensions", {}).get(EXTENSION)
    if lent is not None:
        lent.drop_unless_taken()  # who does not read cannot keep it open
    if not sender.has_begun:
        await refuse(refusal, scope, receive, send)
    elif scope["type"] == "websocket":
        await close(refusal, send)
    else:
        await send({"type": "http.response.body", "body": b"", "more_body": False})


def route_path(scope: Connection) -> str:
    """The path as routes know it, without what a proxy put before it."""
    path, root = str(scope["path"]), str(scope.get("root_path", ""))
    return path.removeprefix(root) if root and path.startswith(f"{root}/") else path


def _is_held(demand: Demand, scope: Connection) -> bool:
    if demand.is_held == "waiting":
        return "wait" in parse_qs(scope["query_string"].decode("latin-1"))
    return bool(demand.is_held)


def _lack(demand: Demand, caller: Caller) -> Refusal | None:
    """Why a caller may not do what they ask for; None if they may."""
    if demand.scope is not None and not caller.may(demand.scope):
        return _lacks_scope(demand.scope)
    return _needs_all_maps() if demand.all_maps and caller.maps is not None else None


def _unavailable(error: DatabaseError) -> Refusal:
    return Refusal(
        HTTPStatus.SERVICE_UNAVAILABLE,
        "database-unavailable",
        str(error),
        error.remedy,
        {"Retry-After": RETRY_S},
    )


def _lacks_scope(scope: str) -> Refusal:
    return Refusal(
        HTTPStatus.FORBIDDEN,
        "forbidden",
        f"This needs a token with the scope {scope}.",
        f"Use one; `semap token add NAME --scope {scope}` makes one.",
        {"WWW-Authenticate": f'Bearer realm="semap", error="insufficient_scope", scope="{scope}"'},
    )


def _needs_all_maps() -> Refusal:
    return Refusal(
        HTTPStatus.FORBIDDEN,
        "forbidden",
        "This is about what all maps share, and the token is for some maps only.",
        "Use a token for all maps.",
    )


def _too_many_open(most: int) -> Refusal:
    return Refusal(
        HTTPStatus.TOO_MANY_REQUESTS,
        "too-many-feeds",
        f"{most} feeds are open already.",
        "Close one, or share one among those who read the same.",
        {"Retry-After": "5"},
    )
