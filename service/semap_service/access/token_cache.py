"""Which caller a token belongs to, asked of the database once in a few seconds.

So a token that is revoked is refused everywhere at most `KEPT_S` later, and at once by the process that
revoked it. Tokens that do not exist are remembered as long, so that a wrong one costs no more than a right
one. What is remembered is bounded: whoever was not seen for longest is forgotten.
"""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from typing import cast

import anyio
from sqlalchemy import Engine

from semap.store.tokens import FORM, ValidToken, find_token, hash_of
from semap_service.context.caller import INCLUDED, SYSTEM, Caller, Scope, acting_as
from semap_service.database.transaction import transaction

KEPT_S = 3.0
MOST_KEPT = 10_000
THREADS = 4
LONGEST_S = 5.0


class TokenCache:
    """Belongs to one event loop. The engine comes when the service starts."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.engine: Engine | None = None
        self._clock = clock
        self._known: OrderedDict[bytes, tuple[float, Caller | None]] = OrderedDict()
        self._asked: dict[bytes, asyncio.Task[Caller | None]] = {}
        self._forgotten = 0
        self._limiter: anyio.CapacityLimiter | None = None

    async def caller(self, secret: str) -> Caller | None:
        """Whose token this is; None if it is nobody's now.

        raises  DatabaseError if the database is needed and does not answer
        """
        if FORM.fullmatch(secret) is None:
            return None
        hash_ = hash_of(secret)
        known = self._known.get(hash_)
        if known is not None and known[0] > self._clock():
            with suppress(KeyError):  # forgotten by another thread just now
                self._known.move_to_end(hash_)
            return known[1]
        asked = self._asked.get(hash_)
        if asked is None:
            asked = self._asked[hash_] = asyncio.create_task(self._ask(hash_))
            asked.add_done_callback(lambda _: self._asked.pop(hash_, None))
        return await asyncio.shield(asked)  # others wait for the same answer

    def is_known(self, secret: str) -> bool:
        """Whether the answer is at hand, without the database."""
        known = self._known.get(hash_of(secret))
        return known is not None and known[0] > self._clock()

    def forget(self, token_id: int) -> None:
        """Ask again for a token that was changed. May be called from any thread."""
        self._forgotten += 1
        for hash_, (_, caller) in list(self._known.items()):
            if caller is not None and caller.token_id == token_id:
                self._known.pop(hash_, None)

    async def _ask(self, hash_: bytes) -> Caller | None:
        if self._limiter is None:
            self._limiter = anyio.CapacityLimiter(THREADS)
        asked_s, forgotten = self._clock(), self._forgotten
        found = await anyio.to_thread.run_sync(self._find, hash_, limiter=self._limiter)
        if forgotten != self._forgotten:
            return found  # it may be from before the change
        self._known[hash_] = (asked_s + KEPT_S, found)
        with suppress(KeyError):
            self._known.move_to_end(hash_)
        while len(self._known) > MOST_KEPT:
            self._known.popitem(last=False)
        return found

    def _find(self, hash_: bytes) -> Caller | None:
        assert self.engine is not None  # noqa: S101  (requests come after the start)
        with acting_as(SYSTEM, statement_s=LONGEST_S), transaction(self.engine) as connection:
            found = find_token(connection, hash_)
        return None if found is None else caller_of(found)


def caller_of(token: ValidToken) -> Caller:
    """The caller with all that the scopes of the token include."""
    granted = (INCLUDED[cast(Scope, each)] for each in token.scopes)
    return Caller(token.name, token.token_id, frozenset().union(*granted), token.maps, token.map_ids)
