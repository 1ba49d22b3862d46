"""What texts of rules name on a map: rooms, people, concepts, queries and whatever else has a name there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sqlalchemy import Connection, column, func, select

from semap.store.database.connection import translated
from semap.store.map.maps import map_id_of

KINDS = ("room", "door", "instance", "person", "concept", "query", "rule", "state", "value")


def words_of_map(connection: Connection, map_name: str) -> Mapping[str, Sequence[str]]:
    """The words of each kind, ascending; `state` are properties of objects, `value` what they came to lately.

    raises  NotFound
    """
    words: dict[str, list[str]] = {kind: [] for kind in KINDS}
    named = func.semap.rule_words(map_id_of(connection, map_name)).table_valued(
        column("kind"), column("word")
    )
    with translated():
        for kind, word in connection.execute(select(named.c.kind, named.c.word)):
            words[kind].append(word)
    return words
