"""Continuous queries and rules."""

import pytest
from sqlalchemy import Connection, Engine

from semap.errors import Conflict, InvalidInput, NotFound
from semap.rules.declaration import parse_declaration
from semap.store.maps import create_map
from semap.store.queries import add_query, delete_query, enable_query, get_query, list_queries
from semap.store.rules import add_rule, declare_rule, delete_rule, enable_rule, get_rule, list_rules

VISITS = {"input": "track_in_room", "emit": {"began": "entered", "ended": "left"}}


@pytest.fixture
def connection(engine: Engine):
    with engine.begin() as connection:
        create_map(connection, "office")
        yield connection


def test_a_query_is_added_rests_and_goes(connection: Connection) -> None:
    made = add_query(connection, "office", "at_door", "Door")
    assert (made.map, made.concept, made.predicate, made.enabled) == ("office", "Door", "contains", True)
    assert [each.name for each in list_queries(connection, map_name="office")] == ["track_in_room", "at_door"]
    assert enable_query(connection, made.query_id, False).enabled is False
    delete_query(connection, made.query_id)
    for act in (get_query, delete_query, lambda c, id_: enable_query(c, id_, True)):
        with pytest.raises(NotFound):
            act(connection, made.query_id)


def test_a_query_that_a_rule_reads_stays(connection: Connection) -> None:
    (query,) = list_queries(connection)
    with pytest.raises(Conflict, match="room_visits"):
        delete_query(connection, query.query_id)


def test_the_version_rises_with_the_declaration_only(connection: Connection) -> None:
    (rule,) = list_rules(connection, map_name="office")
    assert (rule.version, rule.query, rule.declaration) == (1, "track_in_room", VISITS)
    assert enable_rule(connection, rule.rule_id, False).version == 1
    assert declare_rule(connection, rule.rule_id, parse_declaration(VISITS, "room_visits")).version == 1
    other = {"input": "track_in_room", "emit": {"began": "came"}}
    changed = declare_rule(connection, rule.rule_id, parse_declaration(other, "room_visits"))
    assert (changed.version, changed.declaration, changed.enabled) == (2, other, False)


def test_a_rule_is_added_and_goes(connection: Connection) -> None:
    made = add_rule(connection, "office", parse_declaration(VISITS, "again"))
    assert get_rule(connection, made.rule_id) == made
    delete_rule(connection, made.rule_id)
    for act in (
        get_rule,
        delete_rule,
        lambda c, id_: enable_rule(c, id_, True),
        lambda c, id_: declare_rule(c, id_, parse_declaration(VISITS, "again")),
    ):
        with pytest.raises(NotFound):
            act(connection, made.rule_id)


def test_a_rule_reads_a_query_of_its_map(connection: Connection) -> None:
    with pytest.raises(InvalidInput, match="there is no query nothing"):
        add_rule(connection, "office", parse_declaration({**VISITS, "input": "nothing"}, "r"))
    with pytest.raises(NotFound):
        add_rule(connection, "nowhere", parse_declaration(VISITS, "r"))
    with pytest.raises(InvalidInput, match="there is no concept Nothing"):
        add_query(connection, "office", "q", "Nothing")
