"""Rows that wait for the watermark."""

from __future__ import annotations

from collections.abc import Iterable
from operator import attrgetter

from semap.rules.row import Row

order_of = attrgetter("stamp_us", "rank", "uid")
stamp_of = attrgetter("stamp_us")


class Waiting:
    """Mutable; a row that comes again while it waits is one row. Those not yet stored are kept apart."""

    def __init__(self) -> None:
        self._new: dict[str, Row] = {}
        self._stored: dict[str, Row] = {}
        self._removed: list[str] = []
        self._earliest_us: int | None = None

    def __contains__(self, uid: str) -> bool:
        return uid in self._new or uid in self._stored

    def add(self, row: Row) -> None:
        if row.uid in self._stored:
            return
        self._new[row.uid] = row
        if self._earliest_us is None or row.stamp_us < self._earliest_us:
            self._earliest_us = row.stamp_us

    def retract_changes(self, uid: str) -> bool:
        """Whether this row waited; it does no more."""
        if uid in self._stored:
            del self._stored[uid]
            self._removed.append(uid)
            return True
        return self._new.pop(uid, None) is not None

    def load(self, row: Row) -> None:
        """Take a row that is stored."""
        self._stored[row.uid] = row
        if self._earliest_us is None or row.stamp_us < self._earliest_us:
            self._earliest_us = row.stamp_us

    def until(self, watermark_us: int) -> list[Row]:
        """The rows up to a watermark, in order."""
        if self._earliest_us is None or self._earliest_us > watermark_us:
            return []
        found = [
            row for rows in (self._stored, self._new) for row in rows.values() if row.stamp_us <= watermark_us
        ]
        return in_order(found)

    def remove_until(self, watermark_us: int) -> None:
        """They have been taken."""
        if self._earliest_us is None or self._earliest_us > watermark_us:
            return
        self._new = {uid: row for uid, row in self._new.items() if row.stamp_us > watermark_us}
        gone = [uid for uid, row in self._stored.items() if row.stamp_us <= watermark_us]
        for uid in gone:
            del self._stored[uid]
        self._removed += gone
        self._earliest_us = min(
            (row.stamp_us for rows in (self._stored, self._new) for row in rows.values()), default=None
        )

    def clear(self) -> None:
        self._removed += self._stored
        self._new, self._stored, self._earliest_us = {}, {}, None

    def changes(self) -> tuple[Iterable[Row], Iterable[str]]:
        """Rows to store and uids to delete since the last call."""
        added, removed = self._new, self._removed
        self._stored |= added
        self._new, self._removed = {}, []
        return added.values(), removed


def in_order(rows: Iterable[Row]) -> list[Row]:
    """The rows in the order in which rules take them."""
    found = sorted(rows, key=stamp_of)
    # most rows stand alone at their stamp, and the whole order costs four times as much
    if len(set(map(stamp_of, found))) < len(found):
        found.sort(key=order_of)
    return found
