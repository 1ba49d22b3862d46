"""Rules in one process: steps from a topic in, events to a topic out, what is under way in a file.

Events are sent before the file says that their steps were taken. Killed between the two, it sends them again,
with the same ids. One process of a file at a time: SQLite keeps a second one out.
"""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Iterable, Mapping
from contextlib import closing
from pathlib import Path
from threading import Event as Signal

from confluent_kafka import Message

from semap.errors import Conflict, ServiceUnreachable
from semap.rules.engine.map_rules import MapRules
from semap.store.database.backoff import Patience
from semap_bridge.relay.topics import Topics

log = logging.getLogger(__name__)

TABLES = """
    create table if not exists entry (
      map_uid text, name text, said text, primary key (map_uid, name)) without rowid;
    create table if not exists place (partition integer primary key, next_offset integer);
"""


class Kept:
    """Mutable: the state of rules in a file; raises Conflict where another process has it."""

    def __init__(self, path: Path) -> None:
        self._file = sqlite3.connect(path, timeout=1, isolation_level=None)
        try:
            self._file.execute("pragma locking_mode = exclusive")
            self._file.execute("pragma journal_mode = wal")
            self._file.executescript(TABLES)
            self._file.execute("begin immediate")
            self._file.execute("commit")
        except sqlite3.OperationalError as error:
            self._file.close()
            raise Conflict(
                f"{path} cannot be used: {error}.", "Run one process of a file at a time."
            ) from error

    def entries(self, map_uid: str) -> dict[str, str]:
        return dict(self._file.execute("select name, said from entry where map_uid = ?", [map_uid]))

    def places(self) -> dict[int, int]:
        return dict(self._file.execute("select partition, next_offset from place"))

    def write(self, changes: Mapping[str, Mapping[str, str | None]], places: Mapping[int, int]) -> None:
        """By map, entries that changed or (None) are gone; and where to read on: all or nothing."""
        self._file.execute("begin")
        for map_uid, of_map in changes.items():
            gone = [(map_uid, name) for name, said in of_map.items() if said is None]
            there = [(map_uid, name, said) for name, said in of_map.items() if said is not None]
            self._file.executemany("delete from entry where map_uid = ? and name = ?", gone)
            self._file.executemany("insert or replace into entry values (?, ?, ?)", there)
        self._file.executemany("insert or replace into place values (?, ?)", places.items())
        self._file.execute("commit")

    def close(self) -> None:
        self._file.close()


class Rules:
    """Mutable: the rules of all maps that records came of."""

    def __init__(self, kept: Kept | None = None) -> None:
        self._kept = kept
        self._maps: dict[str, MapRules] = {}

    def take(self, messages: Iterable[Message]) -> list[tuple[str, str]]:
        """What the rules make of records, with the uids of their maps."""
        made = []
        for message in messages:
            uid, text = (message.key() or b"").decode(), (message.value() or b"").decode()
            if uid not in self._maps:
                self._maps[uid] = MapRules({} if self._kept is None else self._kept.entries(uid))
            made += [(uid, said) for said in self._maps[uid].take(text)]
        return made

    def changes(self) -> dict[str, Mapping[str, str | None]]:
        """By map, since they were last asked for."""
        return {uid: changed for uid, rules in self._maps.items() if (changed := rules.changes())}


def derive(topics: Topics, path: Path, stop: Signal) -> None:
    """Run the rules until `stop` is set; brokers that are away are awaited; raises Conflict as `Kept`."""
    patience = Patience(log, "Steps wait for their rules")
    with closing(Kept(path)) as kept:
        while not stop.is_set():
            try:
                _derive(topics, kept, stop, patience)
            except ServiceUnreachable as error:
                patience.wait(error, stop)


def _derive(topics: Topics, kept: Kept, stop: Signal, patience: Patience) -> None:
    sender, rules = topics.sender(topics.events), Rules(kept)
    with closing(topics.reader(topics.due, kept.places())) as reader:
        while not stop.is_set():
            messages = reader.read()
            if messages:
                sender.send(rules.take(messages))
                kept.write(rules.changes(), reader.next)
                patience.restored()
