"""How far a source is believed, and what its tracks are, said by REST."""

from __future__ import annotations

import pytest
import shapely
from running import Service
from scipy.special import ndtr

DEFAULTS = {"lateness_s": 0.0, "jump_m": 15.0, "jump_mps": 30.0}


def settings_of(document: dict) -> dict:
    return {name: document[name] for name in DEFAULTS}


@pytest.fixture
def walked(service: Service) -> Service:
    service.make_map()
    service.make_room("Room07", shapely.box(0, 0, 4, 3))
    service.walk([(1, 1), (2, 2)])
    return service


def only_source(service: Service) -> dict:
    (found,) = service.client.get("/sources", params={"map": "office"}).json()["sources"]
    return found


def test_what_is_changed_stays_and_the_rest_is_left(walked: Service) -> None:
    source = only_source(walked)
    assert settings_of(source) == DEFAULTS
    where = f"/sources/{source['id']}"
    wanted = dict(DEFAULTS)
    for change in ({"jump_m": 3.5}, {"lateness_s": 2.25}, {"jump_mps": 0.0}, {"jump_m": None}, {}):
        wanted |= change
        assert settings_of(walked.client.patch(where, json=change).raise_for_status().json()) == wanted
        assert settings_of(walked.client.get(where).json()) == wanted
    assert walked.plain.execute("select lateness::text, jump_m, jump_mps from semap.source").fetchone() == (
        "00:00:02.25", None, 0.0
    )  # fmt: skip


@pytest.mark.parametrize(
    "change",
    [{"jump_m": 0}, {"jump_m": -1}, {"jump_mps": None}, {"jump_mps": -1}, {"lateness_s": None},
     {"lateness_s": 1e6}, {"lateness_s": "NaN"}, {"name": "x"}],
)  # fmt: skip
def test_what_is_no_setting_is_refused(walked: Service, change: dict) -> None:
    where = f"/sources/{only_source(walked)['id']}"
    assert walked.client.patch(where, json=change).status_code == 422
    assert settings_of(walked.client.get(where).json()) == DEFAULTS


def test_the_gate_is_as_wide_as_it_is_said(walked: Service) -> None:
    """A step of 6 m in a second: one position that is believed, or one that waits for another."""
    source = only_source(walked)
    where = f"/sources/{source['id']}"
    found = []
    for jump_m, jump_mps in ((2.0, 3.0), (2.0, 4.5)):
        walked.client.patch(where, json={"jump_m": jump_m, "jump_mps": jump_mps}).raise_for_status()
        track = walked.walk([(1, 1), (1, 7), (1, 1)], f"at {jump_mps}")
        rows = walked.plain.execute(
            "select count(*) from semap.relation_change where track_id = %s", [track]
        ).fetchone()
        found.append((rows, walked.client.get(where).json()["outliers"]))
    assert [changes for (changes,), _ in found] == [1, 3]
    assert [outliers for _, outliers in found] == [1, 1]


def test_a_track_is_what_it_is_said_to_be(walked: Service) -> None:
    client = walked.client
    (track,) = client.get("/tracks").json()["tracks"]
    assert (track["concept"], track["attributes"]) == (None, {})
    where = f"/tracks/{track['id']}"
    schema = {"type": "object", "properties": {"load_kg": {"type": "number"}}, "required": ["load_kg"]}
    client.post("/concepts", json={"name": "Forklift", "attribute_schema": schema}).raise_for_status()
    client.post(
        "/queries", json={"map": "office", "name": "forklifts", "subject": {"concept": "Forklift"}}
    ).raise_for_status()
    for change, status in (
        ({"concept": "Unheard"}, 422), ({"concept": "Forklift"}, 422), ({"attributes": None}, 422),
        ({"attributes": {"load_kg": "much"}, "concept": "Forklift"}, 422), ({"name": "x"}, 422),
        ({"concept": "Forklift", "attributes": {"load_kg": 900}}, 200), ({"attributes": {}}, 422),
    ):  # fmt: skip
        assert client.patch(where, json=change).status_code == status, change
    told = client.get(where).json()
    assert (told["concept"], told["attributes"]) == ("Forklift", {"load_kg": 900})
    held = client.get("/relations", params={"query": "forklifts"}).json()["relations"]
    assert [each["track"] for each in held] == [track["name"]]
    assert client.patch(where, json={"concept": None}).json()["concept"] is None
    assert client.get("/relations", params={"query": "forklifts"}).json()["relations"] == []
    assert client.patch("/tracks/999", json={"concept": None}).status_code == 404


def test_a_relation_says_how_probable_it_is(walked: Service) -> None:
    client = walked.client
    for name, certainty in (("sure", {"enter": 0.9, "leave": 0.1}), ("plain", None)):
        asked = {"map": "office", "name": name, "concept": "Room", "certainty": certainty}
        client.post("/queries", json=asked).raise_for_status()
    (track,) = client.get("/tracks").json()["tracks"]
    walked.plain.execute("update semap.track_now set std_m = 1, x_m = 4")
    page = client.get("/relations").json()["relations"]
    told = {each["query"]: each["probability"] for each in page}
    # half of it beyond the wall at x = 4; in y from 0 to 3, around 2
    expected = (ndtr(0) - ndtr(-4)) * (ndtr(1) - ndtr(-2))
    assert told == {"sure": pytest.approx(expected, abs=1e-9), "plain": None, "track_in_room": None}
    assert client.get(f"/tracks/{track['id']}/rooms").json()["relations"] == page
