"""`semap db size`, `retention` and `maintain`, in one process."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta

import psycopg
import pytest
from semap_service.cli import main

from semap.store.database import connect

Semap = Callable[..., tuple[int, str, str]]
STATES = """
    insert into semap.track_state (track_id, stamp, x_m, y_m, std_m, speed_mps)
    select track, %s::timestamptz + n * interval '0.1 s', random() * 10, random() * 10, random(), random()
    from generate_series(1, 4) track, generate_series(1, 5000) n
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
        plain.execute(f"comment on table semap.track_state_{noon(each):%Y%m%d} is null")  # made long ago
    plain.execute("set session_replication_role = origin")
    plain.execute("analyze semap.track_state")


def test_retention_is_shown_and_changed(semap: Semap) -> None:
    status, shown, _ = semap("db", "retention")
    assert (status, shown.count("never")) == (0, 5)
    status, changed, _ = semap("db", "retention", "--pack-states-after", "7d", "--drop-states-after", "90 d",
                               "--drop-lines-after", "12h")  # fmt: skip
    assert status == 0
    assert changed == semap("db", "retention")[1]
    lines = [line.split("  ") for line in changed.splitlines()]
    assert [[cell.strip() for cell in line if cell.strip()] for line in lines] == [
        ["what", "packed after", "dropped after", "dropped up to"],
        ["states of tracks", "7 d", "90 d"],
        ["lines", "-", "12 h"],
        ["changes of relations", "-", "never"],
        ["events", "-", "never"],
    ]
    assert semap("db", "retention", "--drop-states-after", "never")[0] == 0
    told = json.loads(semap("db", "retention", "--json")[1])
    assert [(each["kind"], each["pack_after_s"], each["drop_after_s"]) for each in told] == [
        ("states", 604800.0, None), ("lines", None, 43200.0), ("changes", None, None), ("events", None, None),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("age", "said"),
    [("0d", "too short"), ("-3d", "no duration"), ("7", "no unit"), ("soon", "no duration"), ("200000d", "hundred years")],
)  # fmt: skip
def test_an_age_that_is_none_is_refused(semap: Semap, age: str, said: str) -> None:
    status, _, told = semap("db", "retention", "--drop-events-after", age)
    assert (status, said in told, "--drop-events-after" in told) == (2, True, True)
    assert semap("db", "retention")[1].count("never") == 5


def test_to_drop_before_packing_is_refused(semap: Semap) -> None:
    status, _, told = semap("db", "retention", "--pack-states-after", "7d", "--drop-states-after", "7d")
    assert (status, "before they are packed" in told) == (2, True)


def test_sizes_tell_where_bytes_go(semap: Semap, plain: psycopg.Connection) -> None:
    assert "No states are kept." in semap("db", "size")[1]
    leave_states(plain, 9, 3)
    semap("db", "retention", "--pack-states-after", "7d", "--drop-states-after", "30d")
    assert "states of" in semap("db", "size")[1]
    semap("db", "maintain")
    plain.execute("analyze semap.track_state_packed")
    told = json.loads(semap("db", "size", "--json")[1])

    parts = {part["name"]: part for part in told["parts"]}
    (database,) = plain.execute("select pg_database_size(current_database())").fetchone()
    assert sum(
        part["bytes"] for name, part in parts.items() if name != "log kept for slots"
    ) == pytest.approx(database, rel=0.05)
    assert (parts["states of tracks"]["rows"], parts["states, packed"]["rows"]) == (20_000, 20_000)
    days = {(each["day"], each["is_packed"]): each for each in told["days"] if each["states"]}
    old, new = days[str(noon(9).date()), True], days[str(noon(3).date()), False]
    assert (old["states"], new["states"]) == (20_000, 20_000)
    (packed,) = plain.execute("select pg_total_relation_size('semap.track_state_packed')").fetchone()
    assert old["bytes"] == pytest.approx(packed, abs=2)
    assert new["bytes"] / old["bytes"] > 3
    assert told["growth_states_a_day"] == 20_000 // 7
    assert told["due"] == [
        f"states of {noon(3).date()} are packed from {noon(-5).date()} 00:00 UTC on",
        f"states of {noon(9).date()} are dropped from {noon(-22).date()} 00:00 UTC on",
    ]

    shown = semap("db", "size")[1].splitlines()
    first = {line.split("  ")[0]: line for line in shown}
    assert "20000" in first["states, packed"]
    assert any(str(noon(9).date()) in line and "packed" in line for line in shown)
    assert shown[-3].startswith("A day brings about")
    assert "2857 states" in shown[-3]


def test_maintenance_says_what_it_does(semap: Semap, plain: psycopg.Connection) -> None:
    leave_states(plain, 9)
    semap("db", "retention", "--pack-states-after", "2d")
    status, planned, _ = semap("db", "maintain", "--dry-run")
    assert (status, planned.splitlines()[1]) == (0, f"20000 states of {noon(9).date()} would be packed.")
    assert plain.execute("select count(*) from semap.stored_state").fetchone() == (20_000,)
    status, done, told = semap("db", "maintain")
    assert done.splitlines() == [
        "4 days ahead were made.", f"20000 states of {noon(9).date()} were packed.",
        f"The partition of states of {noon(9).date()} was dropped.",
    ]  # fmt: skip
    assert f"packing the states of {noon(9).date()}" in told
    assert json.loads(semap("db", "maintain", "--json")[1])["packed"] == {}
    assert semap("db", "maintain")[1] == "Nothing is due.\n"
    assert plain.execute("select sum(states) from semap.track_state_packed").fetchone() == (20_000,)
