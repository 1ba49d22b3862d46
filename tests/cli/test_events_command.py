"""`semap events`: what it selects, and that following survives the loss of its connections."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from datetime import UTC, datetime

import pytest
from semap_service.cli import commands, events
from typer.testing import CliRunner
from world import World

from semap.errors import InvalidInput, NotFound
from semap.store.database.connection import connect

PATIENCE_S = 60.0


@pytest.fixture
def logged(world: World) -> World:
    """Events 1 to 1200, ann's and bob's in turn."""
    happen(world, 1, 1200)
    return world


def happen(world: World, first: int, last: int) -> None:
    world.run(
        "insert into semap.event (seq, event_id, map_id, rule_name, rule_version, type, stamp, since, track_name, measures)"
        " select seq, gen_random_uuid(), %s, 'visits', 1, 'entered', '2026-01-31Z', '2026-01-31Z',"
        " case when seq %% 2 = 0 then 'ann' else 'bob' end, jsonb_build_object('gap_s', seq)"
        " from generate_series(%s::int, %s::int) seq",
        world.map_id, first, last,
    )  # fmt: skip
    world.run("notify semap_event")


def shown(world: World, *arguments: str) -> list[int]:
    ran = CliRunner().invoke(commands(), ["events", "--json", "--dsn", world.dsn, *arguments])
    if ran.exception is not None and not isinstance(ran.exception, SystemExit):
        raise ran.exception
    return [json.loads(line)["seq"] for line in ran.stdout.splitlines()]


def test_all_events_come_page_by_page(logged: World) -> None:
    assert shown(logged) == list(range(1, 1201))
    assert shown(logged, "--after", "1190", "--limit", "3") == [1191, 1192, 1193]


def test_a_filter_takes_what_it_says(logged: World) -> None:
    assert shown(logged, "--filter", "track = 'ann' AND measures.gap_s > 1190") == [
        1192,
        1194,
        1196,
        1198,
        1200,
    ]
    assert shown(logged, "--filter", "track = 'ann'", "--limit", "2", "--after", "700") == [702, 704]
    assert shown(logged, "--map", logged.name, "--type", "left") == []
    with pytest.raises(InvalidInput, match="filter"):
        shown(logged, "--filter", "track =")
    with pytest.raises(NotFound):
        shown(logged, "--map", "nowhere")


def test_following_goes_on_after_its_connections_were_lost(logged: World) -> None:
    follower = subprocess.Popen(
        [sys.executable, "-m", "semap_service", "events", "--follow", "--json", "--after", "1190", "--limit", "20"],
        env={**os.environ, "SEMAP_DSN": logged.dsn}, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert follower.stdout is not None
    seen = [json.loads(follower.stdout.readline())["seq"] for _ in range(10)]
    with connect(logged.dsn) as connection:
        ended = connection.execute(
            "select count(pg_terminate_backend(pid)) from pg_stat_activity"
            " where datname = current_database() and application_name like 'semap events%'"
        ).fetchone()
    assert ended is not None
    assert ended[0] >= 1
    happen(logged, 1201, 1210)
    rest, said = follower.communicate(timeout=PATIENCE_S)
    assert [*seen, *(json.loads(line)["seq"] for line in rest.splitlines())] == list(range(1191, 1211))
    assert "nothing will be missed" in said


def test_a_line_is_in_colour_only_for_a_terminal_that_wants_it(monkeypatch: pytest.MonkeyPatch) -> None:
    row = {"seq": 1, "stamp": datetime(2026, 1, 31, tzinfo=UTC), "track": "ann", "type": "entered", "instance": "den",
           "key": {}, "cause": "appeared", "measures": {}, "confidence": None, "amended_by": None, "verdict": None}  # fmt: skip
    plain = "     1  2026-01-31 00:00:00.000  ann entered den (first seen there)"
    assert events.sentence(row) == plain
    monkeypatch.setattr(events.sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert "\x1b[" in events.sentence(row)
    monkeypatch.setenv("NO_COLOR", "1")
    assert events.sentence(row) == plain
