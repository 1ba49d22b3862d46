"""Continuous queries, and rules with their versions, the queries that they read and the seam of a backfill."""

from datetime import UTC, datetime

import pytest
from sqlalchemy import Connection, Engine, text

from semap.errors import Conflict, InvalidInput, NotFound
from semap.model.continuous_query import Declaration, Side
from semap.rules.language.reading import parse_declaration
from semap.store.event.rules import (
    SINCE_EVER,
    add_rule,
    declare_rule,
    delete_rule,
    enable_rule,
    find_rule,
    get_rule,
    list_rules,
    list_versions,
)
from semap.store.map.maps import create_map, delete_map
from semap.store.relation.queries import add_query, delete_query, enable_query, get_query, list_queries

VISITS = {"input": "track_in_room", "emit": {"began": "entered", "ended": "left"}}
CAME = {"input": "track_in_room", "emit": {"began": "came"}}
DOOR = {"input": "door", "emit": {"open": "opened"}}


@pytest.fixture
def connection(engine: Engine):
    with engine.begin() as connection:
        create_map(connection, "office")
        yield connection


def asked(name: str, concept: str) -> Declaration:
    return Declaration(name, "contains", Side("track"), Side("instance", concept))


def test_a_query_is_added_rests_and_goes(connection: Connection) -> None:
    made = add_query(connection, "office", asked("at_door", "Door"))
    assert (made.map, made.declaration, made.enabled) == ("office", asked("at_door", "Door"), True)
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
    (rule,) = list_rules(connection)
    declare_rule(connection, rule.rule_id, parse_declaration(DOOR, rule.name))
    delete_query(connection, query.query_id)


def test_a_query_that_a_rule_reads_stays_whoever_deletes_it(engine: Engine) -> None:
    with engine.begin() as connection:
        create_map(connection, "office")
    with pytest.raises(Exception, match="still referenced"), engine.begin() as connection:
        connection.execute(text("delete from semap.continuous_query"))
    with engine.begin() as connection:
        delete_map(connection, "office")
        assert connection.scalar(text("select count(*) from semap.rule_query")) == 0


def test_the_version_rises_with_the_declaration_only(connection: Connection) -> None:
    (rule,) = list_rules(connection, map_name="office")
    assert (rule.version, rule.queries, rule.declaration) == (1, ("track_in_room",), VISITS)
    assert enable_rule(connection, rule.rule_id, False).version == 1
    assert declare_rule(connection, rule.rule_id, parse_declaration(VISITS, "room_visits")).version == 1
    changed = declare_rule(connection, rule.rule_id, parse_declaration(CAME, "room_visits"))
    assert (changed.version, changed.declaration, changed.enabled) == (2, CAME, False)
    renamed = declare_rule(connection, rule.rule_id, parse_declaration(CAME, "visits"))
    assert (renamed.version, renamed.name) == (3, "visits")
    assert [(v.version, v.name, v.declaration) for v in list_versions(connection, rule.rule_id)] == [
        (1, "room_visits", VISITS), (2, "room_visits", CAME), (3, "visits", CAME),
    ]  # fmt: skip


def test_no_version_of_a_name_is_given_twice(connection: Connection) -> None:
    first = add_rule(connection, "office", parse_declaration(VISITS, "again"))
    delete_rule(connection, first.rule_id)
    second = add_rule(connection, "office", parse_declaration(CAME, "again"))
    assert (first.version, second.version) == (1, 2)
    delete_rule(connection, second.rule_id)
    (other,) = list_rules(connection)
    assert declare_rule(connection, other.rule_id, parse_declaration(CAME, "again")).version == 3
    create_map(connection, "garden")
    assert add_rule(connection, "garden", parse_declaration(VISITS, "again")).version == 1


def test_a_rule_is_added_found_and_goes(connection: Connection) -> None:
    made = add_rule(connection, "office", parse_declaration(VISITS, "again"))
    assert get_rule(connection, made.rule_id) == made == find_rule(connection, "again")
    assert find_rule(connection, str(made.rule_id)) == made
    with pytest.raises(Conflict, match="There is a rule again"):
        add_rule(connection, "office", parse_declaration(CAME, "again"))
    create_map(connection, "garden")
    with pytest.raises(InvalidInput, match="room_visits on 2 maps"):
        find_rule(connection, "room_visits")
    assert find_rule(connection, "room_visits", "garden").map == "garden"
    delete_rule(connection, made.rule_id)
    for act in (
        get_rule,
        delete_rule,
        list_versions,
        lambda c, id_: enable_rule(c, id_, True),
        lambda c, id_: declare_rule(c, id_, parse_declaration(VISITS, "again")),
        lambda c, id_: find_rule(c, "again"),
    ):
        with pytest.raises(NotFound):
            act(connection, made.rule_id)


def test_a_name_is_looked_up_among_queries_rules_and_properties(connection: Connection) -> None:
    def queries(inputs: object) -> tuple[str, ...]:
        declaration = parse_declaration({"input": inputs, "pattern": "A", "emit": "a"}, "r")
        made = add_rule(connection, "office", declaration)
        delete_rule(connection, made.rule_id)
        return made.queries

    add_query(connection, "office", asked("at_door", "Door"))
    assert queries(["track_in_room", "at_door", "door"]) == ("at_door", "track_in_room")
    assert queries([{"query": "at_door"}, {"object_state": "track_in_room"}]) == ("at_door",)
    assert queries(["room_visits", {"map": True}]) == ()
    assert queries([{"rule": "room_visits"}]) == ()
    for wrong, words in (
        ({"query": "door"}, "there is no query door"),
        ({"rule": "track_in_room"}, "there is no rule track_in_room"),
        ("track_in_rom", "there is no query or rule track_in_rom"),
    ):
        with pytest.raises(InvalidInput, match=words):
            queries([wrong])
    assert queries([{"object_state": "track_in_rom"}]) == ()
    with pytest.raises(NotFound):
        add_rule(connection, "nowhere", parse_declaration(VISITS, "r"))
    with pytest.raises(InvalidInput, match="there is no concept Nothing"):
        add_query(connection, "office", asked("q", "Nothing"))


def test_a_backfill_has_its_seam_until_the_next_version(connection: Connection) -> None:
    def seam() -> object:
        return connection.scalar(text("select seam from semap.rule where name = 'r'"))

    nothing = {"change_id": 0, "object_state_id": 0}
    made = add_rule(connection, "office", parse_declaration(VISITS, "r"), backfill_from=SINCE_EVER)
    assert (made.backfill_from, seam()) == (SINCE_EVER, nothing)
    enable_rule(connection, made.rule_id, False)
    assert seam() == nothing
    later = datetime(2026, 1, 31, tzinfo=UTC)
    connection.execute(text("update semap.rule set seam = '{}' where name = 'r'"))
    same = declare_rule(connection, made.rule_id, parse_declaration(VISITS, "r"), backfill_from=SINCE_EVER)
    assert (same.version, seam()) == (1, {})
    again = declare_rule(connection, made.rule_id, parse_declaration(VISITS, "r"), backfill_from=later)
    assert (again.version, again.backfill_from, seam()) == (1, later, nothing)
    other = declare_rule(connection, made.rule_id, parse_declaration(CAME, "r"))
    assert (other.version, other.backfill_from, seam()) == (2, None, None)
    with pytest.raises(InvalidInput, match="the stamp 1700"):
        declare_rule(
            connection, made.rule_id, parse_declaration(VISITS, "r"),
            backfill_from=datetime(1700, 1, 1, tzinfo=UTC),
        )  # fmt: skip
