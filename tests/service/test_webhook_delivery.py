"""Events are sent to web addresses: each at least once, in their order, signed."""

import json
import threading
from collections.abc import Iterator
from dataclasses import replace

import pytest
from lasting import lasting_service
from patience import until
from receiving import Received, Receiver
from running import Service
from semap_service.webhooks.delivery import WebhookSettings
from semap_service.webhooks.retry import Retry
from standardwebhooks.webhooks import WebhookVerificationError

from semap.cluster import Cluster


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    made = Receiver()
    yield made
    made.close()


SETTINGS = WebhookSettings(look_s=0.05, retry=Retry(attempts=3, first_s=0.02, longest_s=0.05))


@pytest.fixture(scope="module")
def lasting(cluster: Cluster, template: str) -> Iterator[Service]:
    with lasting_service(cluster, template, webhook_settings=SETTINGS) as running:
        running.make_map()
        running.make_map("other")
        yield running


@pytest.fixture
def hurried(lasting: Service) -> Iterator[Service]:
    """A service that waits for little, and has no webhook and no event yet."""
    webhooks = lasting.app.state.webhooks
    allowed = webhooks.settings
    until(lambda: webhooks.working)
    yield lasting
    webhooks.settings = allowed
    for each in lasting.get("/webhooks")["webhooks"]:
        lasting.client.delete(f"/webhooks/{each['id']}").raise_for_status()


def happen(service: Service, count: int = 1, **more: str) -> list[int]:
    """So many new events; their numbers."""
    (newest,) = service.plain.execute("select coalesce(max(seq), 0) from semap.event").fetchone()
    service.happen(newest + 1, count, **more)
    return list(range(newest + 1, newest + count + 1))


def add(service: Service, receiver: Receiver, **document: object) -> dict:
    response = service.client.post("/webhooks", json={"url": receiver.url, **document})
    assert response.status_code == 201, response.text
    return response.json()


def seqs(receiver: Receiver) -> list[int]:
    return [int(json_of(each)["sequence"]) for each in receiver.received]


def json_of(message: Received) -> dict:
    return json.loads(message.body)


def test_events_come_in_order_signed_and_whole(hurried: Service, receiver: Receiver) -> None:
    happen(hurried, 3)
    made = add(hurried, receiver, description="the door opener")
    numbers = happen(hurried, 150)
    until(lambda: len(receiver.received) == 150)
    assert seqs(receiver) == numbers
    listed = hurried.get("/events", after=numbers[0] - 1, limit=1000)["events"]
    events = {each["seq"]: each for each in listed}
    for message in receiver.received:
        said = message.verified(made["secret"])
        assert message.headers["content-type"].startswith("application/cloudevents+json")
        assert said["data"] == events[int(said["sequence"])]
        assert message.headers["webhook-id"] == said["id"] == said["data"]["event_id"]
    where = f"/webhooks/{made['id']}"
    until(lambda: hurried.get(where)["delivered"] == 150)
    after = hurried.get(where)
    assert "secret" not in after
    assert {key: after[key] for key in ("cursor", "failed", "dead_letters", "attempts", "state")} == {
        "cursor": numbers[-1],
        "failed": 0,
        "dead_letters": 0,
        "attempts": 0,
        "state": "active",
    }


def test_only_what_is_wanted_is_sent(hurried: Service, receiver: Receiver) -> None:
    wanted = "cause = 'moved' AND type IN ('left', 'entered')"
    add(hurried, receiver, maps=["office"], type="left", filter=wanted)
    unfit = add(hurried, receiver, maps=["office"], filter="map = 'other'")
    happen(hurried, 2, map_name="other", kind="left")
    happen(hurried, 2, kind="entered")
    numbers = happen(hurried, 2, kind="left")
    until(lambda: len(receiver.received) == 2)
    assert seqs(receiver) == numbers
    assert hurried.get(f"/webhooks/{unfit['id']}")["delivered"] == 0


def test_what_is_not_taken_is_tried_again_then_set_aside_and_sent_again(
    hurried: Service, receiver: Receiver
) -> None:
    refused: set[int] = set()
    receiver.answer = lambda message: (500 if int(json_of(message)["sequence"]) in refused else 200, {})
    where = f"/webhooks/{add(hurried, receiver)['id']}"
    hurried.client.patch(where, json={"state": "paused"}).raise_for_status()
    a, b, c, d, e, f = happen(hurried, 6)
    refused |= {b, c, d}
    hurried.client.patch(where, json={"state": "active"}).raise_for_status()
    until(lambda: hurried.get(where)["cursor"] == f)
    # three tries of the first, one of each that follows, until one is taken
    assert seqs(receiver) == [a, b, b, b, c, d, e, f]
    letters = hurried.get(f"{where}/dead-letters")
    assert [(each["seq"], each["attempts"], each["status"]) for each in letters["dead_letters"]] == [
        (b, 3, 500),
        (c, 1, 500),
        (d, 1, 500),
    ]
    assert "500" in hurried.get(where)["last_error"]
    first = receiver.received[1]
    receiver.received.clear()
    refused.clear()
    two, *_ = letters["dead_letters"]
    again = hurried.client.post(f"{where}/dead-letters/{two['id']}/resend")
    assert (again.status_code, again.json()) == (202, {"requested": 1})
    until(lambda: hurried.get(where)["dead_letters"] == 2)
    (resent,) = receiver.received
    assert resent.body == first.body
    assert resent.headers["webhook-id"] == first.headers["webhook-id"]
    assert hurried.client.post(f"{where}/dead-letters/resend").json() == {"requested": 2}
    until(lambda: hurried.get(where)["dead_letters"] == 0)
    assert seqs(receiver) == [b, c, d]
    assert hurried.client.post(f"{where}/dead-letters/resend").json() == {"requested": 0}
    assert hurried.client.post(f"{where}/dead-letters/{two['id']}/resend").status_code == 404
    assert hurried.get(where)["delivered"] == 6


def test_what_is_not_taken_again_stays_a_dead_letter(hurried: Service, receiver: Receiver) -> None:
    receiver.answer = lambda _: (404, {})
    where = f"/webhooks/{add(hurried, receiver)['id']}"
    numbers = happen(hurried, 3)
    until(lambda: hurried.get(where)["dead_letters"] == 3)
    tried = len(receiver.received)
    hurried.client.post(f"{where}/dead-letters/resend").raise_for_status()

    def settled() -> bool:
        letters = hurried.get(f"{where}/dead-letters")["dead_letters"]
        return len(receiver.received) > tried and all(each["resend_requested_at"] is None for each in letters)

    until(settled)
    assert len(receiver.received) == tried + 1, "the first that is not taken ends it"
    assert hurried.get(where)["dead_letters"] == 3
    page = hurried.get(f"{where}/dead-letters", limit=2)
    rest = hurried.get(f"{where}/dead-letters", limit=2, after=page["next"])
    assert [each["seq"] for each in (*page["dead_letters"], *rest["dead_letters"])] == numbers
    assert hurried.client.delete(f"{where}/dead-letters").status_code == 204
    assert hurried.get(f"{where}/dead-letters")["dead_letters"] == []


def test_a_dead_receiver_holds_nobody_else_up(hurried: Service, receiver: Receiver) -> None:
    never = threading.Event()
    hanging = Receiver(lambda _: (never.wait(), (200, {}))[1])
    try:
        add(hurried, hanging)
        gone = hurried.client.post("/webhooks", json={"url": "http://127.0.0.1:9/"}).json()
        add(hurried, receiver)
        numbers = happen(hurried, 20)
        until(lambda: len(receiver.received) == 20)
        assert seqs(receiver) == numbers
        until(lambda: hurried.get(f"/webhooks/{gone['id']}")["dead_letters"] == 20)
        assert len(hanging.received) == 1
    finally:
        never.set()
        hanging.close()


def test_a_receiver_that_is_gone_for_good_is_disabled(hurried: Service, receiver: Receiver) -> None:
    receiver.answer = lambda _: (410, {})
    where = f"/webhooks/{add(hurried, receiver)['id']}"
    a, b = happen(hurried, 2)
    until(lambda: hurried.get(where)["state"] == "disabled")
    assert "410" in hurried.get(where)["state_reason"]
    receiver.answer = lambda _: (200, {})
    assert hurried.client.patch(where, json={"state": "active"}).json()["state_reason"] == ""
    until(lambda: hurried.get(where)["delivered"] == 2)
    assert seqs(receiver) == [a, a, b]


def test_retry_after_is_heeded(hurried: Service, receiver: Receiver) -> None:
    webhooks = hurried.app.state.webhooks
    webhooks.settings = replace(webhooks.settings, retry=Retry(attempts=5, first_s=0.01, longest_s=3600))
    receiver.answer = lambda _: (429, {"Retry-After": "1800"})
    where = f"/webhooks/{add(hurried, receiver)['id']}"
    happen(hurried)
    until(lambda: hurried.get(where)["attempts"] == 1)
    (left_s,) = hurried.plain.execute(
        "select extract(epoch from next_attempt_at - clock_timestamp()) from semap.webhook"
    ).fetchone()
    assert 1790 < left_s <= 1800
    receiver.answer = lambda _: (200, {})
    hurried.client.patch(where, json={"url": f"{receiver.url}/other"}).raise_for_status()
    until(lambda: hurried.get(where)["delivered"] == 1)
    assert [each.path for each in receiver.received] == ["/hook", "/hook/other"]


def test_what_happens_while_it_is_paused_is_sent_later(hurried: Service, receiver: Receiver) -> None:
    where = f"/webhooks/{add(hurried, receiver)['id']}"
    hurried.client.patch(where, json={"state": "paused"}).raise_for_status()
    numbers = happen(hurried, 5)
    other = add(hurried, receiver, after=numbers[0] - 1)
    until(lambda: hurried.get(f"/webhooks/{other['id']}")["delivered"] == 5)
    assert hurried.get(where)["delivered"] == 0
    hurried.client.patch(where, json={"state": "active"}).raise_for_status()
    until(lambda: hurried.get(where)["delivered"] == 5)
    assert seqs(receiver) == numbers * 2
    assert hurried.client.delete(where).status_code == 204
    assert hurried.client.get(where).status_code == 404


def test_a_secret_is_replaced_without_a_gap(hurried: Service, receiver: Receiver) -> None:
    made = add(hurried, receiver)
    where = f"/webhooks/{made['id']}"
    secrets = [made["secret"]]

    def valid() -> list[bool]:
        """Of each secret, whether it verifies the next message."""
        receiver.received.clear()
        hurried.client.post(f"{where}/ping").raise_for_status()
        (message,) = receiver.received
        found = []
        for secret in secrets:
            try:
                message.verified(secret)
                found.append(True)
            except WebhookVerificationError:
                found.append(False)
        return found

    for keep_s, expected in ((3600, [True, True]), (3600, [False, True, True]), (0, [False] * 3 + [True])):
        rotated = hurried.client.post(f"{where}/secret", json={"keep_s": keep_s})
        secrets.append(rotated.json()["secret"])
        assert valid() == expected


def test_a_ping_says_what_came_of_it(hurried: Service, receiver: Receiver) -> None:
    where = f"/webhooks/{add(hurried, receiver)['id']}"
    said = hurried.client.post(f"{where}/ping").json()
    assert (said["taken"], said["status"], said["error"]) == (True, 204, "")
    (message,) = receiver.received
    assert json_of(message)["type"] == "org.semap.ping"
    assert message.headers["webhook-id"] == said["message_id"] == json_of(message)["id"]
    receiver.answer = lambda _: (302, {"Location": receiver.url})
    said = hurried.client.post(f"{where}/ping").json()
    assert (said["taken"], said["status"], "not followed" in said["error"]) == (False, 302, True)
    assert len(receiver.received) == 2
    hurried.client.patch(where, json={"url": "http://nowhere.invalid/"}).raise_for_status()
    said = hurried.client.post(f"{where}/ping").json()
    assert (said["taken"], said["status"], bool(said["error"])) == (False, None, True)


def test_what_cannot_be_is_refused(hurried: Service, receiver: Receiver) -> None:
    for wrong, status in (
        ({"url": "ftp://example.org"}, 422),
        ({"url": receiver.url, "filter": "seq >"}, 422),
        ({"url": receiver.url, "filter": "nothing = 1"}, 422),
        ({"url": receiver.url, "maps": ["nowhere"]}, 404),
        ({"url": receiver.url, "maps": []}, 422),
        ({"url": receiver.url, "after": 10**9}, 409),
        ({"url": receiver.url, "secret": "mine"}, 422),
        ({}, 422),
    ):
        refused = hurried.client.post("/webhooks", json=wrong)
        assert (refused.status_code, bool(refused.json()["remedy"])) == (status, True), refused.text
    made = add(hurried, receiver)
    where = f"/webhooks/{made['id']}"
    for change in ({"url": None}, {"state": "disabled"}, {"filter": "("}, {"url": "http://u:p@example.org/"}):
        assert hurried.client.patch(where, json=change).status_code == 422
    assert hurried.client.patch(where, json={}).json()["url"] == receiver.url
    assert hurried.client.patch("/webhooks/99", json={}).status_code == 404
    assert hurried.client.post("/webhooks/99/ping").status_code == 404
    assert hurried.client.post("/webhooks/99/secret", json={}).status_code == 404
    assert hurried.client.get("/webhooks/99/dead-letters").status_code == 404
    more = add(hurried, receiver)
    page = hurried.get("/webhooks", limit=1)
    rest = hurried.get("/webhooks", after=page["next"])["webhooks"]
    assert [each["id"] for each in (*page["webhooks"], *rest)] == [made["id"], more["id"]]


def test_a_lost_connection_is_made_again(hurried: Service, receiver: Receiver) -> None:
    where = f"/webhooks/{add(hurried, receiver)['id']}"
    for _ in range(3):
        ended = hurried.plain.execute(
            "select count(pg_terminate_backend(pid)) from pg_stat_activity"
            " where application_name = 'semap webhooks' and datname = current_database()"
        ).fetchone()
        assert ended[0] >= 1
        until(lambda: not hurried.app.state.webhooks.working)
        numbers = happen(hurried, 5)
        until(lambda last=numbers[-1]: hurried.get(where)["cursor"] == last)
    assert len(receiver.received) == 15
    assert seqs(receiver) == sorted(set(seqs(receiver)))


def test_nobody_else_reads_the_secrets(hurried: Service, receiver: Receiver) -> None:
    add(hurried, receiver)
    for role in (
        "semap_read",
        "semap_ingest",
        "semap_worker",
        "semap_api",
        "semap_read_map",
        "semap_api_map",
    ):
        for table in ("webhook", "webhook_secret", "webhook_dead_letter"):
            (may,) = hurried.plain.execute(
                "select has_any_column_privilege(%s, %s, 'select, insert, update')", [role, f"semap.{table}"]
            ).fetchone()
            assert not may, (role, table)
