"""Who is left out of the watermark for being silent, second by second."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta

import psycopg
import pytest
from door_scene import PAPER, DoorScene
from hypothesis import given, settings
from hypothesis import strategies as st
from rule_work import await_event_of, await_progress, running_worker
from server import fresh_database
from world import SECOND_US, World

from semap.cluster import Cluster
from semap.intake import stretch
from semap.intake.idleness import Idleness
from semap.intake.inputs import SourceChange, source_change
from semap.replication.pgoutput import Change
from semap.rules.engine.step import NEVER_US
from semap.store.database.connection import connect
from semap.timeline.stamp import to_datetime, to_us
from semap.worker.progress import note_idle

EARLIEST, LATEST = datetime(1800, 1, 1), datetime(9998, 12, 31)  # noqa: DTZ001

STAYED = {
    "input": "track_in_room", "partition_by": ["track", "room"], "pattern": "B not followed by L",
    "define": {"B": "type = 'began'", "L": "type = 'ended'"}, "within": "3 s", "emit": "stayed",
}  # fmt: skip


def heard(
    idleness: Idleness,
    source_id: int,
    at_s: float,
    map_id: int = 1,
    is_awaited: bool = True,
    said_s: float | None = None,
) -> None:
    said_us = round((at_s if said_s is None else said_s) * SECOND_US)
    source = SourceChange(map_id, source_id, said_us, said_us, is_awaited)
    idleness.hear(source, round(at_s * SECOND_US), at_s)


def test_a_source_is_silent_while_others_go_on_without_it() -> None:
    idleness = Idleness({}, 0, 10)
    heard(idleness, 7, 0)
    heard(idleness, 8, 0)
    assert idleness.silent(30) == {}
    heard(idleness, 8, 31)
    assert idleness.silent(31) == {7: 0}
    assert idleness.silent(50) == {7: 0}
    heard(idleness, 7, 50, is_awaited=False, said_s=0)
    assert idleness.silent(50) == {}
    heard(idleness, 7, 51)
    assert idleness.silent(55) == {8: 31 * SECOND_US}
    heard(idleness, 8, 56, is_awaited=False, said_s=31)
    assert idleness.silent(70) == {}


def test_what_is_noted_of_a_source_is_not_said_by_it() -> None:
    """That it is idle, or that its newest stamp is whole: it has spoken before the other one all the same."""
    idleness = Idleness({}, 0, 10)
    heard(idleness, 7, 0)
    heard(idleness, 8, 0.5)
    heard(idleness, 7, 1.5, said_s=0)
    assert idleness.silent(10.5) == {7: 0}


def test_one_that_is_awaited_again_by_hand_gets_its_time_anew() -> None:
    idleness = Idleness({}, 0, 10)
    heard(idleness, 7, 0)
    heard(idleness, 8, 1)
    heard(idleness, 7, 11, is_awaited=False, said_s=0)
    heard(idleness, 7, 30, said_s=0)
    assert idleness.silent(39) == {}
    assert idleness.silent(40) == {7: 0}


def test_sources_of_other_maps_and_those_that_are_gone_count_for_nothing() -> None:
    idleness = Idleness({}, 0, 10)
    for map_id, source_id, at_s in ((1, 7, 0), (2, 8, 20), (3, 9, 0), (3, 10, 20), (4, 11, 0), (4, 12, 20)):
        heard(idleness, source_id, at_s, map_id)
    idleness.forget(10)
    idleness.forget_map(4)
    assert idleness.silent(100) == {}
    assert set(idleness.heard) == {7, 8, 9}


def test_one_that_ended_is_not_silent_but_has_gone_on_without_the_others() -> None:
    idleness = Idleness({}, 0, 10)
    heard(idleness, 7, 0)
    heard(idleness, 8, 1)
    heard(idleness, 8, 1, is_awaited=False)
    assert idleness.silent(9) == {}
    assert idleness.silent(10) == {7: 0}


def test_begun_again_a_worker_knows_who_spoke_last() -> None:
    """At 100 s another worker begins; all get their time anew."""
    before = Idleness({}, 0, 10)
    for source_id, at_s in ((7, 50), (8, 51), (9, 2)):
        heard(before, source_id, at_s, is_awaited=source_id != 9)
    idleness = Idleness(before.heard, 100, 10)
    assert idleness.silent(109) == {}
    assert idleness.silent(110) == {7: 50 * SECOND_US}
    heard(idleness, 9, 111)
    assert set(idleness.silent(115)) == {7, 8}


@pytest.fixture(scope="module")
def one_source(cluster: Cluster, template: str) -> Iterator[psycopg.Connection]:
    with fresh_database(cluster, template) as dsn:
        world = World(dsn)
        yield world.connection
        world.close()


@settings(max_examples=300)
@given(
    watermark=st.none() | st.just("-infinity") | st.datetimes(EARLIEST, LATEST, timezones=st.just(UTC)),
    newest=st.none() | st.datetimes(EARLIEST, LATEST, timezones=st.just(UTC)),
    lateness=st.timedeltas(timedelta(0), timedelta(days=400)),
    late_from=st.none() | st.datetimes(EARLIEST, LATEST, timezones=st.just(UTC)),
    is_whole=st.booleans(), ended=st.booleans(), idle=st.booleans(),
)  # fmt: skip
def test_a_source_is_complete_as_far_as_the_database_says(
    one_source: psycopg.Connection, watermark, newest, lateness, late_from, is_whole, ended, idle
) -> None:
    """The worker reads of a row of the log what `semap.complete_through` gives of it."""
    with one_source.transaction(force_rollback=True):
        row = one_source.execute(
            "update semap.source s set watermark = %s, newest_stamp = %s, lateness = %s, late_from = %s,"
            " newest_is_whole = %s, ended = %s, idle = %s"
            " returning s.source_id::text, s.map_id::text, s.watermark::text, s.newest_stamp::text,"
            " s.lateness::text, s.late_from::text, s.newest_is_whole::text, s.ended::text, s.idle::text",
            [watermark, newest, lateness, late_from, is_whole, ended, idle],
        ).fetchone()  # fmt: skip
        complete, is_awaited = one_source.execute(
            "select nullif(semap.complete_through(s), '-infinity'), not s.ended and not s.idle from semap.source s"
        ).fetchone()
    columns = (
        "source_id",
        "map_id",
        "watermark",
        "newest_stamp",
        "lateness",
        "late_from",
        "newest_is_whole",
        "ended",
        "idle",
    )
    told = {
        name: {"true": "t", "false": "f"}.get(text, text) for name, text in zip(columns, row, strict=True)
    }
    found = source_change(Change("source", "update", told))
    assert found.complete_us == (NEVER_US if complete is None else to_us(complete))
    assert found.is_awaited == is_awaited


def test_a_silent_source_holds_nobody_up_until_it_speaks_again(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The door's source said something once; the tracks go on, and what they do is not kept waiting for it."""
    scene = DoorScene(world)
    scene.add_rule("stayed", STAYED)
    scene.add_rule("opened_then_entered", PAPER["opened_then_entered"])
    with running_worker(world.dsn):
        scene.watermark(90)
        scene.passage(101)
        scene.watermark(150, world.source_id)
        await_progress(world.dsn)
    assert scene.events("stayed") == []
    with monkeypatch.context() as patched:
        patched.setattr(stretch, "IDLE_AFTER_S", 0.0)
        with running_worker(world.dsn):
            await_event_of(world.dsn, "bob", "stayed")
    assert {row[1:3] for row in scene.events("stayed")} == {("ann", "west"), ("ann", "east"), ("bob", "east")}
    noted = "select name, idle from semap.source order by name"
    assert world.rows(noted) == [("doors", True), ("tracker", False)]

    # a worker that begins knows it of the row; then it speaks, and is waited for
    with running_worker(world.dsn):
        scene.watermark(300, world.source_id)
        scene.walk("ann", [(310, 1, 1), (320, 1, 1)])
        await_event_of(world.dsn, "ann", "entered")
        scene.watermark(160, scene.door_source_id)
        assert world.rows(noted) == [("doors", False), ("tracker", False)]
        scene.walk("ann", [(330, 5, 1), (340, 5, 1)])
        await_progress(world.dsn)
        assert ("stayed", "ann", "east", 333.0) not in scene.events("stayed")
        scene.watermark(340, scene.door_source_id)
        await_progress(world.dsn)
        assert ("stayed", "ann", "east", 333.0) in scene.events("stayed")


def test_a_source_that_never_spoke_holds_up_no_recording_that_ended(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The doors were made known and gave nothing; the tracks are over; another worker goes on meanwhile."""
    scene = DoorScene(world)
    scene.add_rule("stayed", STAYED)
    with running_worker(world.dsn):
        scene.walk("ann", [(100, 1, 1), (120, 1, 1)])
        world.run("update semap.source set ended = true where source_id = %s", world.source_id)
        await_progress(world.dsn)
    assert scene.events("stayed") == []
    monkeypatch.setattr(stretch, "IDLE_AFTER_S", 0.0)
    with running_worker(world.dsn):
        await_event_of(world.dsn, "ann", "stayed")
    assert scene.events("stayed") == [("stayed", "ann", "west", 103.0)]


def test_the_last_rows_of_a_source_that_ended_are_taken_whatever_its_lateness(world: World) -> None:
    scene = DoorScene(world)
    world.run("delete from semap.source where source_id = %s", scene.door_source_id)
    world.run("update semap.source set lateness = '1 h'")
    with running_worker(world.dsn):
        scene.walk("ann", [(100, 1, 1), (120, 5, 1)])
        await_progress(world.dsn)
        assert scene.events() == []
        world.run("update semap.source set ended = true")
        await_progress(world.dsn)
    assert [row[0] for row in scene.events()] == ["entered", "left", "entered"]
    assert world.one("select count(*) from semap.pending_row") == 0


def test_whoever_speaks_meanwhile_is_not_noted_and_nobody_waits_for_a_writer(world: World) -> None:
    said_us, idle = 50 * SECOND_US, "select idle from semap.source"
    world.say(world.source_id, said_us)
    with connect(world.dsn, "semap_worker") as worker, connect(world.dsn, autocommit=False) as writer:
        writer.execute("select from semap.source for no key update")
        note_idle(worker, {world.source_id: said_us})
        assert world.rows(idle) == [(False,)]
        writer.execute("update semap.source set watermark = %s", [to_datetime(said_us + 1)])
        writer.commit()
        note_idle(worker, {world.source_id: said_us})
        assert world.rows(idle) == [(False,)]
        note_idle(worker, {world.source_id: said_us + 1})
        assert world.rows(idle) == [(True,)]
        world.run("update semap.source set idle = false, watermark = null")
        note_idle(worker, {world.source_id: NEVER_US})
        assert world.rows(idle) == [(True,)]
        world.say(world.source_id, said_us)
        assert world.rows(idle) == [(False,)]
