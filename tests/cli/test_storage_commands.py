"""`semap db size`, `retention` and `maintain`, in one process."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta

import psycopg
import pytest
from semap_service.cli import main

from semap.store.database.connection import connect

Semap = Callable[..., tuple[int, str, str]]
STATES = """
    insert into semap.state_chunk
    select c.* from (
      select stamp, array_agg(track) as ids, array_agg(random() * 10) as x_m, array_agg(random()::real) as std_m
      from generate_series(1, 4) track, generate_series(1, 5000) n,
           lateral (select %s::timestamptz + n * interval '0.1 s' as stamp) t
      group by stamp) s
    cross join lateral semap.new_chunk(
      source_id => 0, from_stamp => stamp, to_stamp => stamp, track_ids => ids, x_m => s.x_m, y_m => s.x_m, z_m => null,
      std_m => s.std_m, is_last => null, heading_rad => null, speed_mps => s.std_m, length_m => null, width_m => null,
      std_across_m => null, std_yaw_rad => null) c
"""


@pytest.fixture
def semap(database: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Semap:
    """Runs a command; gives its status, what it printed, and what it complained about."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["semap", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return int(ended.value.code or 0), printed.out, printed.err

    monkeypatch.setenv("SEMAP_DSN", database)
    return run


@pytest.fixture
def plain(database: str) -> Iterator[psycopg.Connection]:
    with connect(database) as connection:
        yield connection


def noon(days_ago: int) -> datetime:
    today = datetime.now(UTC).replace(hour=12, minute=0, second=0, microsecond=0)
    return today - timedelta(days=days_ago)


def leave_states(plain: psycopg.Connection, *days_ago: int) -> None:
    plain.execute("set session_replication_role = replica")
    plain.execute("select semap.ensure_partitions(%s::date[])", [[noon(each).date() for each in days_ago]])
    for each in days_ago:
        plain.execute(STATES, [noon(each)])
        plain.execute(f"comment on table semap.state_chunk_{noon(each):%Y%m%d} is null")  # made long ago
    plain.execute("set session_replication_role = origin")
    plain.execute("analyze semap.state_chunk")


def test_retention_is_shown_and_changed(semap: Semap) -> None:
    status, shown, _ = semap("db", "retention")
    assert (status, shown.count("never")) == (0, 4)
    status, changed, _ = semap("db", "retention", "--drop-states-after", "90 d", "--drop-lines-after", "12h")
    assert status == 0
    assert changed == semap("db", "retention")[1]
    lines = [line.split("  ") for line in changed.splitlines()]
    assert [[cell.strip() for cell in line if cell.strip()] for line in lines] == [
        ["what", "dropped after", "dropped up to"],
        ["states of tracks", "90 d"],
        ["lines", "12 h"],
        ["changes of relations", "never"],
        ["events", "never"],
    ]
    assert semap("db", "retention", "--drop-states-after", "never")[0] == 0
    told = json.loads(semap("db", "retention", "--json")[1])
    assert [(each["kind"], each["drop_after_s"]) for each in told] == [
        ("states", None), ("lines", 43200.0), ("changes", None), ("events", None),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("age", "said"),
    [("0d", "too short"), ("-3d", "no duration"), ("7", "no unit"), ("soon", "no duration"), ("200000d", "hundred years")],
)  # fmt: skip
def test_an_age_that_is_none_is_refused(semap: Semap, age: str, said: str) -> None:
    status, _, told = semap("db", "retention", "--drop-events-after", age)
    assert (status, said in told, "--drop-events-after" in told) == (2, True, True)
    assert semap("db", "retention")[1].count("never") == 4


def test_sizes_tell_where_bytes_go(semap: Semap, plain: psycopg.Connection) -> None:
    assert "No states are kept." in semap("db", "size")[1]
    leave_states(plain, 9, 3)
    semap("db", "retention", "--drop-states-after", "30d")
    told = json.loads(semap("db", "size", "--json")[1])

    parts = {part["name"]: part for part in told["parts"]}
    (database,) = plain.execute("select pg_database_size(current_database())").fetchone()
    assert sum(
        part["bytes"] for name, part in parts.items() if name != "log kept for slots"
    ) == pytest.approx(database, rel=0.05)
    assert parts["states of tracks"]["rows"] == 40_000
    days = {each["day"]: each for each in told["days"] if each["states"]}
    assert {day: each["states"] for day, each in days.items()} == {
        str(noon(n).date()): 20_000 for n in (9, 3)
    }
    (room,) = plain.execute(f"select pg_total_relation_size('semap.state_chunk_{noon(9):%Y%m%d}')").fetchone()
    assert days[str(noon(9).date())]["bytes"] == room
    assert told["growth_states_a_day"] == 20_000 // 7
    assert told["due"] == [f"states of {noon(9).date()} are dropped from {noon(-22).date()} 00:00 UTC on"]

    shown = semap("db", "size")[1].splitlines()
    assert any(str(noon(9).date()) in line and "20000" in line for line in shown)
    assert shown[-2].startswith("A day brings about")
    assert "2857 states" in shown[-2]


def test_maintenance_says_what_it_does(semap: Semap, plain: psycopg.Connection) -> None:
    leave_states(plain, 9)
    semap("db", "retention", "--drop-states-after", "2d")
    status, planned, _ = semap("db", "maintain", "--dry-run")
    partition = f"The partition of states of {noon(9).date()}"
    assert (status, planned.splitlines()[1]) == (0, f"{partition} would be dropped.")
    assert plain.execute("select count(*) from semap.stored_state").fetchone() == (20_000,)
    status, done, _ = semap("db", "maintain")
    assert (status, f"{partition} was dropped." in done.splitlines()) == (0, True)
    assert semap("db", "maintain")[1] == "Nothing is due.\n"
    assert plain.execute("select count(*) from semap.stored_state").fetchone() == (0,)
