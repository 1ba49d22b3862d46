"""Who is asking, and for what: the context of each request and of each piece of background work.

`access.authorisation` sets it for a request. Work of semap's own says `with acting_as(SYSTEM):`; whoever says
nothing is refused by `transaction`, so that work that lost its context does not get all rights by mistake.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

Scope: TypeAlias = Literal["read", "write", "ingest", "admin"]

SCOPES: tuple[Scope, ...] = get_args(Scope)
INCLUDED: dict[Scope, frozenset[Scope]] = {
    "read": frozenset({"read"}),
    "write": frozenset({"read", "write"}),
    "ingest": frozenset({"read", "ingest"}),
    "admin": frozenset(SCOPES),
}
"""What each scope allows."""


@dataclass(frozen=True)
class Caller:
    """Somebody with rights.

    scopes   with all that they include
    maps     the names of the only maps that there are for this caller; None: all
    map_ids  the same by id, for the database
    """

    name: str
    token_id: int | None
    scopes: frozenset[Scope]
    maps: frozenset[str] | None = None
    map_ids: frozenset[int] | None = None

    def may(self, scope: Scope) -> bool:
        return scope in self.scopes

    def may_see(self, map_name: str | None) -> bool:
        """Whether a map exists for this caller; what belongs to no map is seen by all."""
        return self.maps is None or map_name is None or map_name in self.maps


SYSTEM = Caller("semap", None, frozenset(SCOPES))
"""semap's own work."""

ANYONE = Caller("anyone", None, frozenset(SCOPES))
"""Whoever asks a service that was started without tokens."""


@dataclass(frozen=True)
class Acting:
    """A caller at one piece of work.

    scope         what the work needs; the transaction has the rights of no more than that
    statement_s   a statement that takes longer is cancelled; None: no limit
    """

    caller: Caller
    scope: Scope
    statement_s: float | None = None


_ACTING: ContextVar[Acting] = ContextVar("semap_acting")


def acting() -> Acting:
    """raises RuntimeError outside a request and outside `acting_as`"""
    try:
        return _ACTING.get()
    except LookupError:
        raise RuntimeError("Nobody is acting here: background work says `with acting_as(SYSTEM)`.") from None


def current_caller() -> Caller:
    """raises RuntimeError outside a request and outside `acting_as`"""
    return acting().caller


@contextmanager
def acting_as(caller: Caller, scope: Scope = "admin", *, statement_s: float | None = None) -> Iterator[None]:
    """Let the work inside, and the tasks and threads that it starts with its context, be this caller's."""
    token = _ACTING.set(Acting(caller, scope, statement_s))
    try:
        yield
    finally:
        _ACTING.reset(token)
