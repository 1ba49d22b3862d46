"""Continuous queries that are asked for in SQL alone, over the database and the thread that answers."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from unittest.mock import patch

import psycopg
import pytest
import shapely
from corpus import ACCEPTED, CONCEPTS
from patience import PATIENCE_S
from psycopg import errors
from world import World

from semap.store.database.connection import connect, open_engine
from semap.store.operate.maintenance import maintain
from semap.store.relation import query_requests as answers
from semap.store.relation.queries import declaration_from_sql, find_query
from semap.store.relation.query_requests import answer_next
from semap.worker import query_requests
from semap.worker.query_requests import answering

IN_ROOM = "select r.name, t.name, t.position from track t, room r where ST_Contains(r.footprint, t.position)"
MAKE = "call semap.await_continuous_query(semap.create_continuous_query(%s, %s), '20 s')"
ASK = "select semap.create_continuous_query(%s, %s)"


@contextmanager
def a_worker(dsn: str) -> Iterator[None]:
    """The thread that answers, once the database knows of it."""
    with patch.multiple(query_requests, WAKE_S=0.02, RETRY_S=0.02), answering(dsn), connect(dsn) as asking:
        while asking.execute("select semap.requests_are_answered()").fetchone() != (True,):
            pass
        yield


@pytest.fixture
def writer(world: World) -> Iterator[psycopg.Connection]:
    with connect(world.dsn, "semap_api") as connection:
        yield connection


def refused(connection: psycopg.Connection, statement: str, *parameters: object) -> tuple[type, str, str]:
    with pytest.raises(psycopg.Error) as raised:
        connection.execute(statement, parameters)
    diagnosis = raised.value.diag
    return type(raised.value), diagnosis.message_primary or "", diagnosis.message_hint or ""


def states(connection: psycopg.Connection) -> list[tuple]:
    return connection.execute("select name, state from semap.query_requests order by request_id").fetchall()


def answer_all(dsn: str) -> int:
    engine = open_engine(dsn, "semap_api", size=1)
    try:
        count = 0
        while answer_next(engine):
            count += 1
        return count
    finally:
        engine.dispose()


def test_a_query_is_made_by_its_text_and_holds_at_once(world: World, writer: psycopg.Connection) -> None:
    world.add_room("Kitchen", shapely.box(0, 0, 4, 4))
    world.add_states([(world.add_track("anna"), 1, 1.0, 1.0, None)])
    with a_worker(world.dsn):
        made = writer.execute(MAKE, ["in_room", IN_ROOM]).fetchone()
    assert made == (world.one("select query_id from semap.continuous_query where name = 'in_room'"),)
    assert world.rows(
        'select room_name, track_name, st_astext("position") from semap_result."world/in_room"'
    ) == [("Kitchen", "anna", "POINT(1 1)")]
    assert writer.execute("select state, query_id from semap.continuous_query_state('in_room')").fetchone() == (
        "kept", *made
    )  # fmt: skip
    assert states(writer) == [("in_room", "made")]
    engine = open_engine(world.dsn, "semap_read", size=1)
    with engine.begin() as connection:
        kept = find_query(connection, "world", "in_room")
        assert kept.declaration == declaration_from_sql(connection, "in_room", IN_ROOM)
    engine.dispose()
    assert kept.sql == IN_ROOM


def test_what_cannot_be_kept_is_an_error_with_its_place_and_remedy(
    world: World, writer: psycopg.Connection
) -> None:
    text = "select r.name\nfrom track t, room r\nwhere ST_Touches(r.footprint, t.position)"
    with a_worker(world.dsn):
        kind, message, hint = refused(writer, MAKE, "touching", text)
    assert kind is errors.InvalidParameterValue
    assert message.startswith("line 3, column 7: ")
    assert "st_touches" in message.lower()
    assert hint
    assert writer.execute(
        "select state, line, \"column\", 'line 3, column 7: ' || reason, remedy"
        " from semap.continuous_query_state('touching')"
    ).fetchone() == ("refused", 3, 7, message, hint)
    with a_worker(world.dsn):  # it may be asked for again, better
        assert writer.execute(MAKE, ["touching", IN_ROOM]).fetchone() is not None
    assert states(writer) == [("touching", "refused"), ("touching", "made")]
    writer.execute("select semap.drop_continuous_query('touching')")
    kind, message, _ = refused(writer, "select semap.continuous_query_state('touching')")
    assert (kind, message) == (errors.NoDataFound, "There is no continuous query touching.")


def test_a_request_is_told_when_its_transaction_is_committed(
    world: World, writer: psycopg.Connection
) -> None:
    with a_worker(world.dsn), connect(world.dsn) as listening:
        listening.execute("listen semap_query_answer")
        with writer.transaction():
            (request_id,) = writer.execute(ASK, ["in_room", IN_ROOM]).fetchone() or ()
            assert answer_all(world.dsn) == 0
        (told,) = listening.notifies(timeout=PATIENCE_S, stop_after=1)
        assert told.payload == str(request_id)
        with writer.transaction():  # it was committed before
            writer.execute("call semap.await_continuous_query(%s)", [request_id])


def test_without_a_worker_it_waits_and_says_so(world: World, writer: psycopg.Connection) -> None:
    notices: list[str] = []
    writer.add_notice_handler(lambda each: notices.append(f"{each.message_primary} {each.message_hint}"))
    (request_id,) = writer.execute(ASK, ["in_room", IN_ROOM]).fetchone() or ()
    assert notices == [
        f"No worker is there to answer: request {request_id} waits until one is. Start one: semap work"
    ]
    kind, message, hint = refused(writer, "call semap.await_continuous_query(%s, '0.05 s')", request_id)
    assert kind is errors.QueryCanceled
    assert "was not answered within" in message
    assert "semap work" in hint
    assert states(writer) == [("in_room", "waiting")]
    assert answer_all(world.dsn) == 1
    assert states(writer) == [("in_room", "made")]


def test_a_worker_without_the_parser_leaves_requests_to_others(
    world: World, writer: psycopg.Connection
) -> None:
    writer.execute(ASK, ["in_room", IN_ROOM])
    with patch.object(query_requests, "find_spec", lambda _: None), answering(world.dsn):
        pass
    assert states(writer) == [("in_room", "waiting")]
    assert writer.execute("select semap.requests_are_answered()").fetchone() == (False,)


WRITES = (
    "select 1; delete from semap.map",
    "delete from semap.map returning 1",
    "delete from semap.map",
    "with gone as (delete from semap.map returning *) select * from gone",
    "insert into semap.source (map_id, name) values (1, 'x') returning 1",
    "select * into semap.other from track",
    "select * from semap.map for update",
    "explain select 1",
    "explain analyze delete from semap.map",
    "do $x$ begin delete from semap.map; end $x$",
    "copy semap.map to stdout",
    "drop table semap.map",
    "commit",
    "",
    "-- nothing",
)


def test_anything_but_one_select_is_refused_at_once_and_not_run(
    world: World, writer: psycopg.Connection
) -> None:
    for text in WRITES:
        kind, message, hint = refused(writer, ASK, "bad", text)
        assert kind is errors.InvalidParameterValue, text
        assert message.startswith("A continuous query is one SELECT, which only reads"), text
        assert "ST_Contains" in hint
    assert world.rows("select name from semap.map") == [("world",)]
    assert states(writer) == []


def test_what_a_function_does_while_it_is_planned_is_done_by_the_caller_and_taken_back(
    world: World, writer: psycopg.Connection
) -> None:
    world.run("create table public.seen (who text)")
    world.run("grant all on public.seen to semap_api")
    world.run(
        "create function public.noting() returns integer language plpgsql immutable as $x$ begin"
        " perform public.note(); return 1; end $x$"
    )
    world.run(
        "create function public.note() returns void language plpgsql as $x$ begin"
        " insert into public.seen values (current_user); raise notice '%%', current_user; end $x$"
    )
    notices: list[str | None] = []
    writer.add_notice_handler(lambda each: notices.append(each.message_primary))
    writer.execute(ASK, ["noting", f"{IN_ROOM} and noting() = 1"])
    assert notices[0] == "semap_api"
    assert world.rows("select * from public.seen") == []
    assert answer_all(world.dsn) == 1
    assert states(writer) == [("noting", "refused")]
    assert world.rows("select * from public.seen") == []


def test_a_text_that_does_not_plan_is_refused_where_it_does_not(
    world: World, writer: psycopg.Connection
) -> None:
    with pytest.raises(errors.UndefinedColumn) as raised:
        writer.execute(ASK, ["bad", "select r.colour from room r"])
    assert raised.value.diag.internal_query == "select r.colour from room r"
    assert raised.value.diag.internal_position == "8"
    with pytest.raises(errors.UndefinedTable):
        writer.execute(ASK, ["bad", "select * from kitchen"])
    with pytest.raises(errors.SyntaxError):
        writer.execute(ASK, ["bad", "selct 1"])
    assert states(writer) == []


def test_each_text_that_can_be_kept_can_be_asked_for(world: World, writer: psycopg.Connection) -> None:
    world.run(
        "insert into semap.concept (name) select unnest(%s::text[]) on conflict do nothing", list(CONCEPTS)
    )
    for each in ACCEPTED:
        writer.execute("select semap.require_select(%s)", [each.sql])


WRONG = (
        ("select semap.create_continuous_query('track_in_room', %(sql)s)", errors.UniqueViolation, "already"),
        ("select semap.create_continuous_query('asked', %(sql)s)", errors.UniqueViolation, "waits for an answer"),
        ("select semap.create_continuous_query('x', %(sql)s, 'nowhere')", errors.NoDataFound, "no map nowhere"),
        ("select semap.create_continuous_query(' ', %(sql)s)", errors.InvalidParameterValue, "a name"),
        ("select semap.create_continuous_query(null, %(sql)s)", errors.InvalidParameterValue, "a name"),
        ("select semap.create_continuous_query('x', repeat(' ', 20001))", errors.InvalidParameterValue, "20,000"),
        ("call semap.await_continuous_query(17)", errors.NoDataFound, "no request 17"),
        ("select * from semap.continuous_query_state('x')", errors.NoDataFound, "no continuous query x"),
        ("select semap.drop_continuous_query('x')", errors.NoDataFound, "no continuous query x"),
        ("select semap.enable_continuous_query('x', true)", errors.NoDataFound, "no continuous query x"),
        ("select semap.drop_continuous_query('track_in_room')", errors.ForeignKeyViolation, "room_visits"),
        ("insert into semap.query_request (map_id, name, sql, asked_by) values (1, 'x', 'y', 'z')",
         errors.InsufficientPrivilege, "permission"),
)  # fmt: skip


def test_what_the_database_knows_is_refused_at_once(world: World, writer: psycopg.Connection) -> None:
    writer.execute(ASK, ["asked", IN_ROOM])
    for statement, kind, said in WRONG:
        with pytest.raises(kind, match=said):
            writer.execute(statement.encode(), {"sql": IN_ROOM})


def test_the_map_is_named_where_there_are_several(world: World, writer: psycopg.Connection) -> None:
    with closing(World(world.dsn, "other")) as other:
        assert "several maps" in refused(writer, ASK, "q", IN_ROOM)[1]
        writer.execute("select semap.create_continuous_query('q', %s, 'other')", [IN_ROOM])
        writer.execute("select set_config('semap.maps', %s, false)", [f"{{{world.map_id}}}"])
        writer.execute(ASK, ["q", IN_ROOM])
        assert world.rows("select map, name from semap.query_requests order by request_id") == [
            ("other", "q"), ("world", "q"),
        ]  # fmt: skip
        assert answer_all(world.dsn) == 2
        assert sorted(world.rows("select map_id from semap.continuous_query where name = 'q'")) == [
            (world.map_id,), (other.map_id,),
        ]  # fmt: skip


def test_a_query_rests_works_again_and_goes(world: World, writer: psycopg.Connection) -> None:
    world.add_room("Kitchen", shapely.box(0, 0, 4, 4))
    world.add_states([(world.add_track("anna"), 1, 1.0, 1.0, None)])
    writer.execute(ASK, ["in_room", IN_ROOM])
    assert answer_all(world.dsn) == 1
    holds = "select count(*) from semap.relation n join semap.continuous_query q using (query_id) where n.confirmed and q.name = 'in_room'"
    state = "select state from semap.continuous_query_state('in_room')"
    for enabled, said, count in ((False, "resting", 0), (True, "kept", 1)):
        writer.execute("select semap.enable_continuous_query('in_room', %s)", [enabled])
        assert writer.execute(state).fetchone() == (said,)
        assert world.one(holds) == count
    writer.execute("select semap.drop_continuous_query('in_room')")
    assert world.rows("select name from semap.continuous_query") == [("track_in_room",)]
    assert world.rows(
        "select kind::text, cause::text from semap.relation_change where query_name = 'in_room' order by change_id"
    ) == [("began", "map"), ("ended", "map"), ("began", "map"), ("ended", "map")]


def test_a_request_that_waits_is_taken_back(world: World, writer: psycopg.Connection) -> None:
    writer.execute(ASK, ["in_room", IN_ROOM])
    writer.execute("select semap.drop_continuous_query('in_room')")
    assert states(writer) == []
    assert answer_all(world.dsn) == 0


def test_of_many_workers_one_answers_each_request(world: World, writer: psycopg.Connection) -> None:
    for number in range(20):
        writer.execute(ASK, [f"q{number}", IN_ROOM])
    answered: list[int] = []
    threads = [threading.Thread(target=lambda: answered.append(answer_all(world.dsn))) for _ in range(4)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    assert sum(answered) == 20
    assert {state for _, state in states(writer)} == {"made"}
    assert world.one("select count(*) from semap.continuous_query where name like 'q%%'") == 20


def test_an_answer_that_is_cut_off_is_given_again(world: World, writer: psycopg.Connection) -> None:
    """The query is made in the transaction of the answer: without one there is not the other."""
    writer.execute(ASK, ["in_room", IN_ROOM])
    engine = open_engine(world.dsn, "semap_api", size=1)
    with (
        patch.object(answers.func, "pg_notify", side_effect=KeyboardInterrupt, create=True),
        pytest.raises(KeyboardInterrupt),
    ):
        answer_next(engine)
    assert states(writer) == [("in_room", "waiting")]
    assert world.rows("select name from semap.continuous_query") == [("track_in_room",)]
    assert answer_next(engine)
    engine.dispose()
    assert states(writer) == [("in_room", "made")]


def test_a_name_that_was_taken_meanwhile_and_a_fault_are_answers(
    world: World, writer: psycopg.Connection
) -> None:
    writer.execute(ASK, ["twice", IN_ROOM])
    writer.execute(ASK, ["fault", IN_ROOM])
    writer.execute("insert into semap.continuous_query (map_id, name) values (%s, 'twice')", [world.map_id])
    read = answers.declaration_from_sql

    def failing(connection, name, sql):
        if name == "fault":
            raise ZeroDivisionError("a fault")
        return read(connection, name, sql)

    with patch.object(answers, "declaration_from_sql", failing):
        assert answer_all(world.dsn) == 2
    rows = world.rows("select name, state, line, reason from semap.query_requests order by request_id")
    assert [row[:3] for row in rows] == [("twice", "refused", None), ("fault", "refused", None)]
    assert "twice" in rows[0][3]
    assert rows[1][3] == "semap failed on this text: a fault"
    kind, message, _ = refused(writer, "call semap.await_continuous_query(%s)", world.one(
        "select request_id from semap.query_requests where name = 'twice'"))  # fmt: skip
    assert (kind, message) == (errors.InvalidParameterValue, rows[0][3])


@pytest.mark.parametrize(
    "role", ["semap_read", "semap_ingest", "semap_worker", "semap_read_map", "semap_ingest_map"]
)
def test_who_may_make_no_queries_may_ask_for_none(world: World, role: str) -> None:
    with connect(world.dsn, role) as reader:
        reader.execute("select set_config('semap.maps', %s, false)", [f"{{{world.map_id}}}"])
        with pytest.raises(errors.InsufficientPrivilege):
            reader.execute(ASK, ["in_room", IN_ROOM])
        assert states(reader) == []


def test_a_writer_of_one_map_asks_for_this_map_and_sees_its_requests(world: World) -> None:
    with closing(World(world.dsn, "other")) as other, connect(world.dsn, "semap_api_map") as writer:
        assert "no map" in refused(writer, ASK, "q", IN_ROOM)[1]
        writer.execute("select set_config('semap.maps', %s, false)", [f"{{{world.map_id}}}"])
        writer.execute(ASK, ["q", IN_ROOM])
        other.run(
            "insert into semap.query_request (map_id, name, sql) values (%s, 'q', 'select 1')", other.map_id
        )
        assert writer.execute("select map, name, asked_by from semap.query_requests").fetchall() == [
            ("world", "q", "semap_api_map")
        ]
        assert "no map other" in refused(
            writer, "select semap.create_continuous_query('p', %s, 'other')", IN_ROOM
        )[1]  # fmt: skip
        with pytest.raises(errors.InsufficientPrivilege):
            writer.execute(
                "insert into semap.query_request (map_id, name, sql) values (%s, 'p', 'select 1')",
                [other.map_id],
            )
        with pytest.raises(errors.InsufficientPrivilege):
            writer.execute("update semap.query_request set query_id = 1, answered_at = now()")
        assert answer_all(world.dsn) == 2
        writer.execute("select semap.enable_continuous_query('q', false)")
        writer.execute("select semap.drop_continuous_query('q')")
        assert (
            world.rows("select map_id, name from semap.continuous_query where name <> 'track_in_room'") == []
        )


def test_answers_are_dropped_after_a_day_and_what_waits_stays(
    world: World, writer: psycopg.Connection
) -> None:
    for name in ("old", "new"):
        writer.execute(ASK, [name, IN_ROOM])
    assert answer_all(world.dsn) == 2
    writer.execute(ASK, ["waits", IN_ROOM])
    world.run(
        "update semap.query_request set asked_at = now() - interval '2 days',"
        " answered_at = case when name = 'waits' then null else answered_at - interval '25 h' end"
        " where name in ('old', 'waits')"
    )
    maintain(world.dsn)
    assert states(writer) == [("new", "made"), ("waits", "waiting")]


def test_the_process_of_the_rule_worker_answers(world: World, writer: psycopg.Connection) -> None:
    process = subprocess.Popen([sys.executable, "-m", "semap_service", "work", "--dsn", world.dsn])
    try:
        assert writer.execute(MAKE, ["in_room", IN_ROOM]).fetchone() is not None
    finally:
        process.terminate()
        assert process.wait(20) == 0
    assert states(writer) == [("in_room", "made")]
