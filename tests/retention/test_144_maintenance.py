"""Maintenance does what the settings say and nothing else, beside writers, and however often it is cut off."""

from __future__ import annotations

import re
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from datetime import date, timedelta
from threading import Event as Signal
from threading import Semaphore
from unittest.mock import patch

import psycopg
import pytest
import shapely
from past_days import bits, compact, make_partitions, midnight, retain, stored, write
from patience import PATIENCE_S
from rule_work import await_progress, running_worker
from world import SECOND_US, World

from semap.batch.recompute import Plan, recompute
from semap.errors import InvalidInput
from semap.rules.language.reading import parse_declaration
from semap.store.database.connection import connect, one_transaction
from semap.store.operate import maintenance
from semap.store.operate.maintenance import Maintained, maintain
from semap.store.operate.retention import Kind, Retention, change_retention, read_retention
from semap.timeline.stamp import to_us
from semap.worker.past import dry_run
from semap.worker.why import explain

VISITS = {"input": "track_in_room", "emit": {"began": "entered", "ended": "left"}}
PARTITIONS = "select of_table, day from semap.day_partitions() order by 1, 2"


def days(world: World, table: str = "state_chunk") -> list[date]:
    return [day for of_table, day in world.rows(PARTITIONS) if of_table == table]


def day(days_ago: int) -> date:
    return midnight(days_ago).date()


def some_states(days_ago: int, count: int = 50, track_id: int = 1) -> list[tuple]:
    """Each hour of a day two of a track, and so on."""
    return [
        (track_id, midnight(days_ago) + timedelta(minutes=27 * n, microseconds=n), 0.1 * n, n / 3, None, 0.2, False,
         None, 1.5, None, None)
        for n in range(count)
    ]  # fmt: skip


def settings(dsn: str) -> Mapping[Kind, Retention]:
    with one_transaction(dsn) as connection:
        return read_retention(connection)


def add_lines(world: World, *days_ago: int) -> None:
    world.run("set session_replication_role = replica")
    for each in days_ago:
        world.run(
            "insert into semap.line_observation values (%s, %s, 0, 0, 1, 1, null, 0.1, 0.1, 5)",
            world.source_id, midnight(each) + timedelta(hours=5),
        )  # fmt: skip
    world.run("set session_replication_role = origin")


def test_partitions_are_made_ahead_and_nothing_else_is_done(world: World) -> None:
    make_partitions(world.connection, 40)
    write(world.connection, rows := some_states(40))
    add_lines(world, 40)
    done = maintain(world.dsn)
    ahead = [day(-n) for n in range(4)]
    assert done == Maintained(made_days=ahead)
    assert days(world) == days(world, "line_observation") == [day(40), *ahead]
    assert stored(world.connection) == [bits(row) for row in rows]
    assert world.one("select count(*) from semap.line_observation") == 1
    assert maintain(world.dsn) == Maintained()


def test_each_kind_goes_at_its_own_age(world: World) -> None:
    make_partitions(world.connection, 1, 2, 5, 8, 9, 30)
    kept = {ago: some_states(ago) for ago in (1, 2, 5, 8, 9, 30)}
    outside = some_states(60, 7)
    write(world.connection, [row for rows in kept.values() for row in rows] + outside)
    add_lines(world, 1, 2, 9, 60)
    retain(world.connection, "states", drop="9 d")
    retain(world.connection, "lines", drop="1 d")

    planned = maintain(world.dsn, dry_run=True)
    assert world.one("select count(*) from semap.stored_state") == 6 * 50 + 7
    assert planned.dropped_rows == {"states": 7, "lines": 1}
    done = maintain(world.dsn)
    assert done.dropped_days["state_chunk"] == [day(30)]
    assert done.dropped_days["line_observation"] == [day(n) for n in (30, 9, 8, 5, 2)]
    assert done.dropped_rows == planned.dropped_rows
    assert stored(world.connection) == [bits(row) for ago in (9, 8, 5, 2, 1) for row in kept[ago]]
    assert world.one("select count(*) from semap.line_observation") == 1
    gone = {kind: each.gone_before for kind, each in settings(world.dsn).items()}
    assert gone == {"states": midnight(9), "lines": midnight(1), "changes": None, "events": None}
    assert maintain(world.dsn) == Maintained()

    retain(world.connection, "states", drop="3 d")
    compact(world.connection)
    assert maintain(world.dsn).dropped_days == {"state_chunk": [day(9), day(8), day(5)]}
    assert stored(world.connection) == [bits(row) for ago in (2, 1) for row in kept[ago]]


def test_an_empty_day_of_the_past_goes_but_not_one_that_was_just_made(world: World) -> None:
    make_partitions(world.connection, 7)
    world.run("select semap.ensure_partitions(%s::date[])", [day(8)])
    done = maintain(world.dsn)
    assert done.dropped_days == {"state_chunk": [day(7)], "line_observation": [day(7)]}
    assert days(world)[0] == day(8)


class Cut(Exception):
    """As if the process had died here."""


def test_cut_off_anywhere_nothing_is_lost_or_doubled(world: World) -> None:
    """After each step, committed or not: whoever reads is told the same, and the next run ends it."""
    kept, old = some_states(4, 20) + some_states(3, 20), some_states(20, 20)
    asked, steps, whole = maintenance._Maintenance._patiently, 0, None
    for cut_at in range(200):
        world.run("truncate semap.state_chunk")
        world.run("update semap.retention set gone_before = null")
        make_partitions(world.connection, 3, 4, 20)
        retain(world.connection, "states", drop="10 d")
        write(world.connection, [*kept, *old])
        steps = 0

        def cut(self, what, statement, parameters, cut_at=cut_at):
            nonlocal steps
            steps += 1
            if steps > cut_at:
                raise Cut
            if steps == cut_at:  # the server dies before it commits
                with one_transaction(world.dsn, maintenance.ROLE) as dying:
                    dying.execute(statement, parameters)
                    raise Cut
            return asked(self, what, statement, parameters)

        with patch.object(maintenance._Maintenance, "_patiently", cut):
            try:
                whole = maintain(world.dsn)
            except Cut:
                whole = None
        assert {row[:2] for row in stored(world.connection)} >= {row[:2] for row in kept}
        there = stored(world.connection)
        assert len(there) == len(set(there))
        gone = settings(world.dsn)["states"].gone_before
        assert (len(there) == len(kept)) == (gone == midnight(10) or gone == midnight(19))
        maintain(world.dsn)
        assert stored(world.connection) == [bits(row) for row in kept]
        assert days(world) == [*(day(n) for n in (4, 3)), *(day(-n) for n in range(4))]
        if whole is not None:
            break
    assert cut_at > 5


def test_two_at_once_one_passes(world: World) -> None:
    with connect(world.dsn) as other:
        other.execute("select pg_advisory_lock(%s, 0)", [maintenance.MAINTENANCE_LOCK])
        assert maintain(world.dsn) == Maintained(is_busy=True)
        assert maintain(world.dsn, dry_run=True).made_days
        other.execute("select pg_advisory_unlock(%s, 0)", [maintenance.MAINTENANCE_LOCK])
    assert not maintain(world.dsn).is_busy


def test_a_table_in_use_holds_up_a_drop_and_that_nobody(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(maintenance, "PAUSE_S", 0.02)
    make_partitions(world.connection, 9)
    write(world.connection, some_states(9))
    retain(world.connection, "states", drop="3 d")
    track = world.add_track("t")
    maintain(world.dsn, stop=_after_days_ahead())
    with connect(world.dsn) as holder, ThreadPoolExecutor() as pool:
        holder.execute("begin")
        holder.execute("select count(*) from semap.state_chunk")
        with monkeypatch.context() as hurried:
            hurried.setattr(maintenance, "ATTEMPTS", 2)
            assert re.match(f"states of tracks of {day(9)}", maintain(world.dsn).put_off[0])
        maintaining = pool.submit(maintain, world.dsn)
        world.run("set statement_timeout = '2s'")
        for n in range(30):
            world.add_states([(track, to_us(midnight(0)) + n * SECOND_US, 1, 1, None)])
        assert not maintaining.done()
        holder.execute("commit")
        assert maintaining.result(timeout=PATIENCE_S).dropped_days == {"state_chunk": [day(9)]}
    assert world.one("select count(*) from semap.stored_state") == 30


def _after_days_ahead() -> Signal:
    """Ends maintenance after its first step."""

    class AfterOne(Signal):
        def is_set(self) -> bool:
            asked, self._flag = self._flag, True
            return asked

    return AfterOne()


def test_a_writer_of_the_very_day_is_not_lost(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """It holds a state that is not committed yet; the empty partition stays until it has, and then for good."""
    monkeypatch.setattr(maintenance, "ATTEMPTS", 2)
    monkeypatch.setattr(maintenance, "PAUSE_S", 0.02)
    make_partitions(world.connection, 5)
    maintain(world.dsn, stop=_after_days_ahead())
    with connect(world.dsn) as writer:
        track = world.add_track("t")
        writer.execute("begin")
        writer.execute("insert into semap.track_state values (%s, %s, 1, 1)", [track, midnight(5)])
        assert maintain(world.dsn).put_off == [f"states of tracks of {day(5)}"]
        writer.execute("commit")
    assert "state_chunk" not in maintain(world.dsn).dropped_days
    assert world.one("select count(*) from semap.stored_state") == 1


def test_writers_of_late_states_go_on_while_others_are_compacted(world: World) -> None:
    make_partitions(world.connection, 3)
    tracks = [world.add_track(name) for name in "abc"]
    begin_us, rounds = to_us(midnight(3)), Semaphore(0)
    states = [(tracks[n % 3], begin_us + n * 7_000_000, 0.1 * n, 1.0, None) for n in range(9000)]
    dealt = states[::3] + states[1::3] + states[2::3]

    def write_all() -> None:
        late = World.__new__(World)
        with connect(world.dsn) as late.connection:
            for start in range(0, len(dealt), 150):
                late.add_states(dealt[start : start + 150])
                if start % 1500 == 0:  # nine times it goes on in the middle of a round
                    rounds.acquire()

    with ThreadPoolExecutor() as pool:
        writing = pool.submit(write_all)
        while not writing.done():
            world.run("select semap.compact_states(%s, 0)", world.source_id)
            rounds.release()
        writing.result()
    compact(world.connection)
    found = world.rows("select track_id, stamp, x_m from semap.stored_state order by 2")
    assert [(track, to_us(stamp), x_m) for track, stamp, x_m in found] == [each[:3] for each in states]
    assert world.one("select sum(track_states) from semap.source_count") == len(states)


def test_changes_and_events_go_only_where_somebody_says_so(world: World) -> None:
    world.add_room("den", shapely.box(0, 0, 4, 4))
    track = world.add_track("t")
    make_partitions(world.connection, 30, 2)
    begin = {ago: to_us(midnight(ago)) for ago in (30, 2)}
    with running_worker(world.dsn):
        for ago in (30, 2):
            world.add_states(
                [(track, begin[ago] + n * SECOND_US, x, 1, None) for n, x in enumerate((1, 9, 1, 9))]
            )
        world.run("update semap.source set watermark = %s", midnight(1))
        await_progress(world.dsn)
        assert world.one("select count(*) from semap.event") == 8
        retain(world.connection, "changes", drop="10 d")
        retain(world.connection, "events", drop="10 d")
        assert maintain(world.dsn).dropped_rows == {"events": 4}  # the rules might want those changes again
        world.run("update semap.relation_change set received_at = received_at - interval '2 h'")
        assert maintain(world.dsn).dropped_rows == {"changes": 4}
        await_progress(world.dsn)
        world.add_states([(track, to_us(midnight(1)) + SECOND_US, 1, 1, None)])
        world.run("update semap.source set watermark = %s", midnight(1) + timedelta(hours=1))
        await_progress(world.dsn)
    assert world.rows("select type, stamp >= %s from semap.event order by seq", midnight(10)) == [
        ("entered", True), ("left", True), ("entered", True), ("left", True), ("entered", True),
    ]  # fmt: skip
    assert world.one("select count(*) from semap.event_evidence") == 5
    assert [change[2:4] for change in world.changes()][-1] == ("began", "moved")


def test_what_reads_what_is_gone_says_so(world: World, caplog: pytest.LogCaptureFixture) -> None:
    world.add_room("den", shapely.box(0, 0, 4, 4))
    track = world.add_track("t")
    make_partitions(world.connection, 12, 2)
    with running_worker(world.dsn):
        for ago in (12, 2):
            begin_us = to_us(midnight(ago)) + 12 * 3600 * SECOND_US
            world.add_states(
                [(track, begin_us + n * SECOND_US, x, 1, None) for n, x in enumerate((1, 9, 1, 9))]
            )
        world.run("update semap.source set watermark = %s", midnight(1))
        await_progress(world.dsn)
        world.run("update semap.relation_change set received_at = received_at - interval '2 h'")
        retain(world.connection, "states", drop="5 d")
        retain(world.connection, "changes", drop="5 d")
        maintain(world.dsn)
        told = f"before {day(5):%Y-%m-%d} were dropped"
        visits = parse_declaration(VISITS, "visits")
        with pytest.raises(InvalidInput, match=f"states of tracks before {day(11):%Y-%m-%d} were dropped"):
            recompute(world.dsn, Plan(world.name, midnight(13), midnight(1)))
        with pytest.raises(InvalidInput, match=f"changes of relations {told}"):
            dry_run(world.connection, world.name, visits, midnight(13))
        with pytest.raises(InvalidInput, match=told):
            explain(world.connection, world.name, visits, midnight(12), {"track": "t", "room": "den"})
        counts = recompute(world.dsn, Plan(world.name, midnight(3), midnight(1))).counts()
        assert counts["confirmed"] + counts["amended"] == 4
        assert len(dry_run(world.connection, world.name, visits, midnight(3))) == 4
        assert len(dry_run(world.connection, world.name, visits)) == 4
        world.run(
            "insert into semap.rule (map_id, name, queries, declaration, backfill_from)"
            " select map_id, 'again', queries, declaration, %s from semap.rule", midnight(20),
        )  # fmt: skip
        await_progress(world.dsn)
    assert any(told in record.getMessage() and "again" in record.getMessage() for record in caplog.records)
    assert world.one("select count(*) from semap.event where rule_name = 'again'") == 4


@pytest.mark.parametrize(
    ("ages", "said"),
    [
        ({"states": timedelta(0)}, "to drop states"),
        ({"events": timedelta(days=-1)}, "to drop events"),
        ({"states": timedelta(days=99_999)}, "to drop states"),
    ],
)  # fmt: skip
def test_an_age_that_cannot_be_is_refused(world: World, ages: dict, said: str) -> None:
    before = settings(world.dsn)
    with one_transaction(world.dsn) as connection, pytest.raises(InvalidInput, match=said):
        change_retention(connection, ages)
    assert settings(world.dsn) == before


def test_ages_are_changed_one_by_one(world: World) -> None:
    with one_transaction(world.dsn, "semap_admin") as admin:
        change_retention(admin, {"states": timedelta(days=90)})
        change_retention(admin, {"lines": timedelta(days=7)})
        change_retention(admin, {"states": None})
    ages = {kind: each.drop_after for kind, each in settings(world.dsn).items()}
    assert (ages["states"], ages["lines"]) == (None, timedelta(days=7))


@pytest.mark.parametrize("role", ["semap_read", "semap_ingest", "semap_api", "semap_read_map"])
def test_others_may_not_drop(world: World, role: str) -> None:
    with connect(world.dsn, role) as connection:
        for call in ("drop_day('state_chunk', current_date)", "compact_states(1)", "drop_rows('states', 1)"):  # fmt: skip
            with pytest.raises(psycopg.errors.InsufficientPrivilege):
                connection.execute(f"select semap.{call}")
        with pytest.raises(psycopg.errors.InsufficientPrivilege):
            connection.execute("update semap.retention set drop_after = '1 d'")
