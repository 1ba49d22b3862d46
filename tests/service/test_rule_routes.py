"""Rules over HTTP: what they read, their versions, backfill, and what reads what."""

from __future__ import annotations

import httpx
import pytest
from running import Service

VISITS = {"input": "track_in_room", "emit": {"began": "entered", "ended": "left"}}
PAIR = {"input": ["room_visits", "door"], "pattern": "A B", "within": "2 s", "emit": "pair"}


def add(service: Service, name: str, declaration: dict, **more: object) -> httpx.Response:
    return service.client.post(
        "/rules", json={"map": "office", "name": name, "declaration": declaration, **more}
    )


@pytest.fixture
def office(service: Service) -> Service:
    service.make_map()
    return service


def test_a_rule_and_its_versions(office: Service) -> None:
    made = add(office, "pairs", PAIR)
    rule = made.json()
    assert (made.status_code, made.headers["location"]) == (201, f"/rules/{rule['id']}")
    assert rule == {
        "id": rule["id"], "map": "office", "name": "pairs", "version": 1, "queries": [], "declaration": PAIR, "given_up": None,
        "enabled": True, "backfill_from": None,
    }  # fmt: skip
    where = made.headers["location"]
    other = {**PAIR, "input": ["track_in_room", "door"]}
    changed = office.client.patch(where, json={"declaration": other}).json()
    assert changed == {**rule, "version": 2, "queries": ["track_in_room"], "declaration": other}
    assert office.client.patch(where, json={"declaration": other}).json() == changed
    versions = office.get(f"{where}/versions")["versions"]
    assert [(each["version"], each["name"], each["declaration"]) for each in versions] == [
        (1, "pairs", PAIR), (2, "pairs", other),
    ]  # fmt: skip
    assert office.client.get("/rules/99/versions").status_code == 404


def test_a_rule_may_begin_in_the_past(office: Service) -> None:
    assert (
        add(office, "all", PAIR, backfill_from="all").json()["backfill_from"] == "1800-01-01T00:00:00.000000Z"
    )
    since = "2026-01-31T12:00:00+01:00"
    rule = add(office, "some", PAIR, backfill_from=since).json()
    assert rule["backfill_from"] == "2026-01-31T11:00:00.000000Z"
    where = f"/rules/{rule['id']}"
    assert office.client.patch(where, json={"declaration": VISITS}).json()["backfill_from"] is None
    refused = office.client.patch(where, json={"backfill_from": "all"})
    assert (refused.status_code, refused.json()["detail"]) == (
        422, "backfill_from: a stamp without a declaration",
    )  # fmt: skip
    for wrong in ("yesterday", "2026-01-31T12:00:00", "1700-01-01T00:00:00Z"):
        assert add(office, "none", PAIR, backfill_from=wrong).status_code == 422


def test_what_others_read_stays_under_its_name(office: Service) -> None:
    (visits,) = office.get("/rules")["rules"]
    reader = add(office, "pairs", PAIR).json()
    where = f"/rules/{visits['id']}"
    for refused in (
        office.client.delete(where),
        office.client.patch(where, json={"declaration": {"name": "visits", **VISITS}}),
    ):
        assert refused.status_code == 409
        assert refused.json()["detail"] == "Rules read the events of room_visits: pairs."
    assert office.get(where) == visits
    assert office.client.delete(f"/rules/{reader['id']}").status_code == 204
    assert office.client.delete(where).status_code == 204


def test_a_circle_is_refused_and_nothing_is_changed(office: Service) -> None:
    (visits,) = office.get("/rules")["rules"]
    assert add(office, "pairs", PAIR).status_code == 201
    assert add(office, "more", {**PAIR, "input": ["pairs", "door"]}).status_code == 201
    before = office.get("/rules")
    refused = office.client.patch(
        f"/rules/{visits['id']}", json={"declaration": {"input": {"rule": "more"}, "emit": {"pair": "p"}}}
    )
    assert refused.status_code == 422
    assert "circle" in refused.json()["detail"]
    itself = add(office, "self", {**PAIR, "input": ["self", "door"]})
    assert (itself.status_code, "circle" in itself.json()["detail"]) == (422, True)
    assert office.get("/rules") == before
    # the name of a query is the query's, also where a rule has it
    assert add(office, "track_in_room", {**PAIR, "input": ["track_in_room", "door"]}).status_code == 201


def test_a_declaration_that_cannot_be_is_told_by_its_clause(office: Service) -> None:
    for declaration, where in (
        ({**PAIR, "within": "2 years"}, "within"),
        ({**PAIR, "define": {"A": "type = "}}, "define.A"),
        ({**PAIR, "input": [{"query": "door"}]}, "input"),
        ({**PAIR, "inputs": []}, "inputs"),
    ):
        refused = add(office, "r", declaration)
        assert refused.status_code == 422
        assert refused.json()["detail"].startswith(where), refused.json()
        assert refused.json()["remedy"]
