"""Whoever delivers may be killed at any moment: another goes on where its commits end, and nothing is lost."""

from __future__ import annotations

import json

import httpx
import pytest
from lasting import answers, serving
from patience import until
from receiving import Receiver
from standardwebhooks.webhooks import Webhook

from semap.store.database.connection import connect

EVENTS, KILLED_AT = 400, 150
HELD = "select count(*) from pg_locks where locktype = 'advisory' and classid = 7371 and granted"
EVENT = """
    insert into semap.event (seq, event_id, map_id, rule_name, rule_version, type, stamp, cause, since)
    select seq, gen_random_uuid(), map_id, 'room_visits', 1, 'entered', now(), 'moved', now()
    from semap.map, generate_series(1, %s) seq
"""


@pytest.mark.slow
def test_another_goes_on_when_the_deliverer_is_killed(database: str) -> None:
    receiver = Receiver()
    with connect(database) as plain, serving(database) as (first, _):
        until(lambda: plain.execute(HELD).fetchone() == (1,))
        with serving(database) as (_, url):
            until(lambda: answers(url))
            httpx.post(f"{url}/maps", json={"name": "office"}).raise_for_status()
            made = httpx.post(f"{url}/webhooks", json={"url": receiver.url}).raise_for_status().json()
            plain.execute(EVENT, [EVENTS])
            until(lambda: len(receiver.received) >= KILLED_AT)
            first.kill()
            where = f"{url}/webhooks/{made['id']}"
            until(lambda: httpx.get(where).json()["delivered"] == EVENTS)
    receiver.close()
    messages = [Webhook(made["secret"]).verify(each.body, each.headers) for each in receiver.received]
    numbers = [int(each["sequence"]) for each in messages]
    assert numbers == sorted(numbers), "in order, also what comes twice"
    assert set(numbers) == set(range(1, EVENTS + 1)), "nothing is lost"
    assert len(numbers) <= EVENTS + 1, "only what was under way comes twice"
    ids = {
        (each["sequence"], message.headers["webhook-id"])
        for each, message in zip(messages, receiver.received, strict=True)
    }
    assert len(ids) == EVENTS, "under the same id"
    assert json.loads(receiver.received[0].body)["specversion"] == "1.0"
