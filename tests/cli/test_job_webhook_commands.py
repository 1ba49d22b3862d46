"""`semap job` and `semap webhook`, in one process."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator

import psycopg
import pytest
from semap_service.cli import main
from standardwebhooks.webhooks import Webhook

from semap.store.database.connection import connect

Semap = Callable[..., tuple[int, str, str]]
JOB = """
    insert into semap.job (kind, file, state, progress, message, problem, created_by, finished_at)
    values ('map_import', 'a.ifc', 'running', 0.25, '1 of 4 objects read', null, 'ann', null),
           ('map_import', 'b.ifc', 'waiting', 0, '', null, 'ann', null),
           ('map_import', 'c.ifc', 'failed', 0, '', '{"detail": "It is cut off.", "remedy": "Copy it."}', 'ben', now())
"""
LETTER = """
    insert into semap.webhook_dead_letter (webhook_id, seq, event_id, map, type, body, attempts, error, status)
    values (1, 7, gen_random_uuid(), 'office', 'entered', '{}', 10, 'answered 500', 500)
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


def test_jobs(semap: Semap, plain: psycopg.Connection) -> None:
    assert "respond-async" in semap("job", "list")[1]
    plain.execute(JOB)
    status, listed, _ = semap("job", "list")
    assert (status, [line.split()[1] for line in listed.splitlines()[1:]]) == (0, ["c.ifc", "b.ifc", "a.ifc"])
    assert "25% 1 of 4 objects read" in semap("job", "show", 1)[1]
    assert "What to do: Copy it." in semap("job", "show", 3)[1]
    assert "stops within seconds" in semap("job", "cancel", 1)[1]
    assert "is cancelled" in semap("job", "cancel", 2)[1]
    status, _, told = semap("job", "cancel", 3)
    assert (status, "has ended: failed" in told) == (2, True)
    assert semap("job", "show", 99)[0] == 2
    states = {each["job_id"]: each["state"] for each in json.loads(semap("job", "list", "--json")[1])}
    assert states == {1: "running", 2: "cancelled", 3: "failed"}
    assert plain.execute("select cancel_requested from semap.job where job_id = 1").fetchone() == (True,)


def test_webhooks(semap: Semap, plain: psycopg.Connection) -> None:
    assert "semap webhook add URL" in semap("webhook", "list")[1]
    for wrong in (
        ("ftp://example.org",),
        ("https://example.org", "--filter", "seq >"),
        ("https://u:p@example.org",),
    ):
        status, _, told = semap("webhook", "add", *wrong)
        assert (status, "What to do" in told) == (2, True)
    assert semap("webhook", "add", "https://example.org", "--map", "nowhere")[0] == 2
    status, secret, told = semap("webhook", "add", "https://example.org/hook", "--type", "entered")
    assert (status, "not shown again" in told) == (0, True)
    Webhook(secret.strip())
    plain.execute(LETTER)
    (listed,) = json.loads(semap("webhook", "list", "--json")[1])
    assert {key: listed[key] for key in ("url", "event_type", "state", "dead_letters")} == {
        "url": "https://example.org/hook",
        "event_type": "entered",
        "state": "active",
        "dead_letters": 1,
    }
    assert secret.strip() not in semap("webhook", "list", "--json")[1]
    assert "is paused" in semap("webhook", "pause", 1)[1]
    assert "is active" in semap("webhook", "resume", 1)[1]
    assert "answered 500" in semap("webhook", "dead-letters", 1)[1]
    assert semap("webhook", "resend", 1)[1] == "1 to be sent again.\n"
    assert semap("webhook", "resend", 1, "--letter", 9)[0] == 2
    assert "is removed" in semap("webhook", "remove", 1)[1]
    assert semap("webhook", "pause", 1)[0] == 2
