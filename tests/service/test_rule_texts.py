"""Rules as texts over HTTP: checked as they are written, given out to be edited, and ready ones."""

from __future__ import annotations

import re

import pytest
import shapely
from running import Service

from semap.rules.language.reading import read_declaration

VISITS = "name: visits\ninput: track_in_room\nemit: {began: entered}\n"


@pytest.fixture
def office(service: Service) -> Service:
    service.make_map()
    return service


def check(service: Service, text: str, **more: object) -> dict:
    answer = service.client.post("/maps/office/rules/check", json={"text": text, **more})
    assert answer.status_code == 200, answer.text
    return answer.json()


def fault(service: Service, text: str, **more: object) -> tuple[str, int | None, int | None]:
    answer = check(service, text, **more)
    # only what other rules say against a text leaves it a declaration, and has no place in it
    assert answer["declaration"] is None or answer["fault"]["line"] is None
    assert answer["fault"]["remedy"]
    return tuple(answer["fault"][key] for key in ("message", "line", "column"))


def test_what_is_right_is_as_it_can_be_added(office: Service) -> None:
    found = check(office, VISITS)
    assert found == {
        "name": "visits",
        "declaration": {"input": "track_in_room", "emit": {"began": "entered"}},
        "sentence": "It makes entered when track_in_room begins.",
        "diagram": {
            "kind": "sequence",
            "label": "",
            "text": "",
            "joint": "",
            "parts": [
                {"kind": "step", "label": "", "text": "track_in_room begins", "joint": "", "parts": []},
                {"kind": "event", "label": "entered", "text": "", "joint": "", "parts": []},
            ],
        },
        "like": {"template": "visits", "values": None, "differs": ["emit"]},
        "fault": None,
    }
    assert office.get("/rules")["rules"][0]["name"] == "room_visits"
    made = office.client.post(
        "/rules", json={"map": "office", "name": found["name"], "declaration": found["declaration"]}
    )
    assert made.status_code == 201


@pytest.mark.parametrize(
    ("text", "line", "column", "message"),
    [
        ("", None, None, "the text is empty"),
        ("name: visits\ninput: [track_in_room\n", 3, 1, "not YAML"),
        ("name: visits\ninput: track_in_room\nemits: {began: entered}\n", 3, 1, "there is no such clause"),
        (f"{VISITS}where: type = = 'began'\n", 4, 15, ""),
        (VISITS.replace("track_in_room", "track_in_rom"), 2, 8, "there is no query or rule track_in_rom"),
        (VISITS.replace("track_in_room", "{query: nothing}"), 2, 1, "there is no query nothing on this map"),
        (VISITS.replace("visits", "room_visits", 1), None, None, "There is a rule room_visits on this map"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(
    office: Service, text: str, line: int | None, column: int | None, message: str
) -> None:
    said, *where = fault(office, text)
    assert where == [line, column]
    assert message in said


def test_a_rule_may_have_the_name_of_the_one_that_it_replaces(office: Service) -> None:
    (visits,) = office.get("/rules")["rules"]
    named = VISITS.replace("visits", "room_visits", 1)
    assert check(office, named, replaces=visits["id"])["fault"] is None
    assert check(office, named.partition("\n")[2], replaces=visits["id"])["name"] == "room_visits"


def test_what_others_read_keeps_its_name_and_no_circle_is_made(office: Service) -> None:
    (visits,) = office.get("/rules")["rules"]
    pair = "name: pair\ninput: [room_visits, door]\npattern: A B\nwithin: 2 s\nemit: pair\n"
    found = check(office, pair)
    declared = {"map": "office", "name": "pair", "declaration": found["declaration"]}
    assert office.client.post("/rules", json=declared).status_code == 201
    said, *_ = fault(office, VISITS, replaces=visits["id"])
    assert said == "Rules read the events of room_visits: pair."
    said, *where = fault(
        office, "name: room_visits\ninput: {rule: pair}\nemit: {pair: a}\n", replaces=visits["id"]
    )
    assert "in a circle" in said
    assert where == [2, 1]


def test_a_check_is_of_a_map_and_its_rules(office: Service) -> None:
    assert office.client.post("/maps/none/rules/check", json={"text": VISITS}).status_code == 404
    unknown = office.client.post("/maps/office/rules/check", json={"text": VISITS, "replaces": 99})
    assert unknown.status_code == 404
    office.make_map("other")
    (visits,) = office.get("/rules", map="other")["rules"]
    elsewhere = office.client.post(
        "/maps/office/rules/check", json={"text": VISITS, "replaces": visits["id"]}
    )
    assert elsewhere.status_code == 404


def test_the_text_of_a_rule_and_of_what_it_once_declared(office: Service) -> None:
    (visits,) = office.get("/rules")["rules"]
    where = f"/rules/{visits['id']}"
    first = office.client.get(f"{where}/text")
    assert first.headers["content-type"] == "application/yaml"
    read = read_declaration(first.text)
    assert (read.name, read.as_json()) == ("room_visits", visits["declaration"])
    other = {"input": "track_in_room", "emit": {"began": "came"}}
    assert office.client.patch(where, json={"declaration": other}).status_code == 200
    assert read_declaration(office.client.get(f"{where}/text").text).as_json() == other
    assert office.client.get(f"{where}/text", params={"version": 1}).text == first.text
    for unknown in (f"{where}/text?version=3", "/rules/99/text"):
        assert office.client.get(unknown).status_code == 404


def test_a_template_can_be_used_as_it_is(office: Service) -> None:
    templates = office.get("/rule-templates")["templates"]
    assert [each["name"] for each in templates][:3] == ["visits", "dwell", "absence"]
    assert len(templates) >= 10
    for each in templates:
        found = check(office, each["text"])
        assert found["fault"] is None
        values = {parameter["name"]: parameter["default"] for parameter in each["parameters"]}
        assert found["like"] == {"template": each["name"], "values": values, "differs": []}
        named = [parameter["name"] for parameter in each["parameters"]]
        assert set(re.findall(r"\{(\w+)\}", each["phrase"])) <= set(named)


def test_a_template_is_filled_and_known_again(office: Service) -> None:
    values = {"room": "O'Brien's \"den\"", "person": "ann", "duration": "90 s", "name": "lingers"}
    made = office.client.post("/rule-templates/dwell/text", json={"values": values})
    found = check(office, made.json()["text"])
    assert found["like"]["values"] == {**values, "query": "track_in_room"}
    wrong = office.client.post("/rule-templates/dwell/text", json={"values": {"duration": "soon"}})
    assert wrong.status_code == 422
    assert wrong.json()["remedy"]
    assert office.client.post("/rule-templates/nothing/text", json={}).status_code == 404


def test_the_words_of_a_map_are_those_that_rules_of_it_may_use(office: Service) -> None:
    office.make_room("Room07", shapely.box(0, 0, 4, 3))
    office.walk([(1, 1)])
    words = office.get("/maps/office/rule-words")
    assert (words["room"], words["door"], words["query"]) == (["Room07"], [], ["track_in_room"])
    assert words["rule"] == ["room_visits"]
    assert {"Room", "Door"} <= set(words["concept"])
    assert words["person"] == [each["name"] for each in office.get("/tracks")["tracks"]]
    assert {"where", "pattern"} <= set(words["clauses"])
    assert {"track", "occupants"} <= set(words["properties"])
    assert {"first", "seconds_between", "isA"} <= set(words["functions"])
    assert office.client.get("/maps/nowhere/rule-words").status_code == 404
