"""Which event a match is: the same rule, version, type and evidence give the same id, however often."""

from __future__ import annotations

from hashlib import sha1
from uuid import UUID, SafeUUID

from semap.rules.declaration import Declaration, RowPattern, TemporalFormula
from semap.rules.pattern import Absent, Alternation, Node, Permutation, Repeat, Sequence
from semap.rules.program import Match

EVENT_NAMESPACE = UUID("5f0c1f0e-6c1a-5b8e-9d55-0a6d3a3c9f11")
NEITHER_VARIANT_NOR_VERSION = ~((0xC000 << 48) | (0xF000 << 64))
RFC_4122_VERSION_5 = (0x8000 << 48) | (5 << 76)

UNKNOWN = SafeUUID.unknown
_new, _set = object.__new__, object.__setattr__


class EventIdentity:
    """The identities of the events of one rule: UUIDs of version 5, of texts that begin alike."""

    def __init__(self, name: str, version: int, declaration: Declaration) -> None:
        self._begun = sha1(EVENT_NAMESPACE.bytes + f"{name}|{version}|".encode(), usedforsecurity=False)
        self._is_stamped = _is_stamped(declaration)

    def event_id(self, match: Match, room_uid: str | None = None) -> UUID:
        """The identity of the event that a match makes.

        room_uid  of the key's room, where one of the rows belongs to several rooms and so to several keys
        """
        text = "|".join([match.type, *[row.uid for _, row in match.rows]])
        if match.identity:
            text += f"|{match.identity}"
        if self._is_stamped:
            text += f"|{match.stamp_us}"
        if room_uid is not None:
            text += f"|room {room_uid}"
        digest = self._begun.copy()
        digest.update(text.encode())
        number = int.from_bytes(digest.digest()[:16], "big")
        return _uuid(number & NEITHER_VARIANT_NOR_VERSION | RFC_4122_VERSION_5)


def uuid_of(text: str) -> UUID:
    """The UUID that is written in the usual form."""
    return _uuid(int(text.replace("-", ""), 16))


def _uuid(number: int) -> UUID:
    """As UUID(int=number), in a third of the time: each event has three of them or more."""
    made = _new(UUID)
    _set(made, "int", number)
    _set(made, "is_safe", UNKNOWN)
    return made


def _is_stamped(declaration: Declaration) -> bool:
    """Whether what a rule finds may come of time that passed, so that the rows alone do not say when."""
    match declaration.body:
        case RowPattern(node):
            return "timeout" in declaration.emit or _may_end_absent(node)
        case TemporalFormula():
            return True
        case _:
            return False


def _may_end_absent(node: Node) -> bool:
    match node:
        case Absent():
            return True
        case Sequence(elements):
            return bool(elements) and _may_end_absent(elements[-1].node)
        case Alternation(nodes) | Permutation(nodes):
            return any(map(_may_end_absent, nodes))
        case Repeat(inner):
            return _may_end_absent(inner)
        case _:
            return False
