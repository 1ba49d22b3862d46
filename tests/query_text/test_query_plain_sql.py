"""The text of a continuous query is a plain query over the views, and gives what its declaration says."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import psycopg
import pytest
from corpus import ACCEPTED, CONCEPTS, Accepted
from meaning import One, is_tied, members, pairs
from query_scene import build, shown, walk
from server import fresh_database

from semap.cluster import Cluster
from semap.query_text import declaration_of
from semap.store.database.connection import connect


@pytest.fixture(scope="module")
def reader(cluster: Cluster, template: str) -> Iterator[psycopg.Connection]:
    """Who sees the house but not the one next door, where all is the same."""
    with fresh_database(cluster, template) as dsn:
        with connect(dsn) as connection:
            house, next_door = build(dsn, "house"), build(dsn, "next door")
            walk(connection, house)
            walk(connection, next_door, "other ")
        with connect(dsn, "semap_read_map") as connection:
            connection.execute("set search_path = semap_query, public")
            connection.execute("select set_config('semap.maps', %s, false)", [f"{{{house}}}"])
            yield connection


SEEN = ("name", "source", "attributes", "uid")
"""Properties that the scene knows, too."""


@pytest.mark.parametrize("accepted", ACCEPTED, ids=lambda each: each.sql[:90])
def test_plain_sql_gives_what_the_declaration_says(reader: psycopg.Connection, accepted: Accepted) -> None:
    declaration = declaration_of("q", accepted.sql, CONCEPTS)
    cursor = reader.execute(accepted.sql.encode())
    payload = declaration.payload or dict.fromkeys(range(len(cursor.description or ())), "")
    if not declaration.payload:  # all there are: the names of either side are enough
        names = [each.name for each in cursor.description or ()]
        (first, second) = [n for n, name in enumerate(names) if name == "name"]
        kinds = [n for n, name in enumerate(names) if name == "kind"]
        rows = cursor.fetchall()
        turned = rows and rows[0][kinds[0]] != declaration.subject.kind
        found = Counter((row[second], row[first]) if turned else (row[first], row[second]) for row in rows)
        assert found == Counter((s.properties["name"], o.properties["name"]) for s, o in pairs(declaration))
        return
    # of two objects that are as near a plain query may give either
    may_be_either = declaration.predicate == "nearest" and is_tied(declaration)
    places = [
        n for n, of in enumerate(payload.values())
        if of.partition(".")[2] in SEEN and not (may_be_either and of.startswith("object."))
    ]  # fmt: skip
    found = Counter(shown({str(n): row[n] for n in places}) for row in cursor.fetchall())
    expected = [
        {str(n): value(of, s, o) for n, of in enumerate(payload.values()) if n in places}
        for s, o in pairs(declaration)
    ]
    assert found == Counter(map(shown, expected))
    assert places


def value(of: str, subject: One, object_: One) -> object:
    side, _, name = of.partition(".")
    one = subject if side == "subject" else object_
    return one.uid if name == "uid" else one.properties[name]


def test_the_scene_tells_texts_apart() -> None:
    """Of each text something holds and something does not, so that to agree is worth something."""
    for accepted in ACCEPTED:
        declaration = declaration_of("q", accepted.sql, CONCEPTS)
        possible = len(members(declaration.subject)) * len(members(declaration.object))
        assert len(pairs(declaration)) > 0, accepted.sql
        assert len(pairs(declaration)) < possible or possible == 1, accepted.sql
