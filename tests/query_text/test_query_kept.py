"""What is kept of a text in SQL is what its declaration says: of a scene that is there when the query comes."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from itertools import count

import pytest
from corpus import ACCEPTED, CONCEPTS, Accepted
from meaning import pairs
from query_scene import build, walk
from server import fresh_database

from semap.cluster import Cluster
from semap.errors import InvalidInput
from semap.query_text import declaration_of
from semap.query_text.views import OF_SPACE
from semap.store.database.connection import connect, one_transaction
from semap.store.relation.queries import add_query, delete_query

NUMBER = count()
MOVING = {"approaching", "crosses"}
"""These begin with the next states: tests/relation looks at them."""
UNKEPT = re.compile(r"r\.storey|'Space'")
"""Conditions on what the database does not look at."""


@pytest.fixture(scope="module")
def scene(cluster: Cluster, template: str) -> Iterator[str]:
    """The house, and the one next door, where all is the same."""
    with fresh_database(cluster, template) as dsn:
        with connect(dsn) as connection:
            for name, prefix in (("house", ""), ("next door", "other ")):
                walk(connection, build(dsn, name), prefix)
        yield dsn


@pytest.mark.parametrize("accepted", ACCEPTED, ids=lambda each: each.sql[:90])
def test_what_is_kept_is_what_the_text_says(scene: str, accepted: Accepted) -> None:
    declaration = declaration_of(f"q{next(NUMBER)}", accepted.sql, CONCEPTS)
    beyond = UNKEPT.search(accepted.sql)
    of_ground = declaration.predicate == "intersects" and declaration.subject.kind == "track"
    with one_transaction(scene) as connection:
        if declaration.abstraction in OF_SPACE or beyond is not None:
            named = declaration.abstraction if beyond is None else "condition|property"
            with pytest.raises(InvalidInput, match=named):
                add_query(connection, "house", declaration)
            return
        query_id = add_query(connection, "house", declaration, sql=accepted.sql).query_id
    with connect(scene) as connection:
        rows = connection.execute(
            "select subject, object from semap.relation_now where query_id = %s", [query_id]
        ).fetchall()
    if declaration.predicate in MOVING:
        assert rows == []
    elif not of_ground:  # an ellipse in the plain query, and a rectangle in the kept one
        expected = Counter((s.properties["name"], o.properties["name"]) for s, o in pairs(declaration))
        assert Counter(rows) == expected
    with one_transaction(scene) as connection:
        delete_query(connection, query_id)
