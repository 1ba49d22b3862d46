"""How far a source is believed, and what tracks are, on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from test_map_commands import Semap, semap

__all__ = ["semap"]

WALK = "track,stamp,x,y\nann,2026-01-31T12:00:00Z,1,1\nann,2026-01-31T12:00:01Z,2,2\n"


@pytest.fixture
def office(semap: Semap, tmp_path: Path) -> Semap:
    (tmp_path / "office.yaml").write_text(
        "map: office\nrooms: {lab: {footprint: [[0, 0], [4, 0], [4, 3]]}}\n"
    )
    assert semap("map", "import", tmp_path / "office.yaml")[0] == 0
    (tmp_path / "walk.csv").write_text(WALK)
    described = ("--concept", "Thing", "--attributes", '{"kind": "person"}')
    assert semap("ingest", "tracks", tmp_path / "walk.csv", "--map", "office", *described)[0] == 0
    return semap


def settings(shown: str) -> list[tuple[str, float, float | None, float]]:
    return [
        (each["source"], each["lateness_s"], each["jump_m"], each["jump_mps"]) for each in json.loads(shown)
    ]


def test_sources_are_believed_as_far_as_is_said(office: Semap) -> None:
    of_it = ("--map", "office", "--json")
    assert settings(office("source", "list", *of_it)[1]) == [("walk", 0, 15, 30)]
    change = ("--jump", "3.5", "--jump-speed", "2", "--lateness", "1.5")
    assert settings(office("source", "set", "walk", *change, *of_it)[1]) == [("walk", 1.5, 3.5, 2)]
    assert settings(office("source", "set", "walk", "--jump", "none", *of_it)[1]) == [("walk", 1.5, None, 2)]
    for wrong, said in (("far", "'far' is no length"), ("0", "a jump of 0 m"), ("nan", "a jump of nan m")):
        status, _, told = office("source", "set", "walk", "--jump", wrong, *of_it)
        assert (status, said in told) == (2, True), told
    status, _, told = office("source", "set", "nobody", *of_it)
    assert (status, "There is no source nobody." in told) == (2, True)
    assert settings(office("source", "list", *of_it)[1]) == [("walk", 1.5, None, 2)]
    status, _, told = office("source", "list", "--map", "nowhere")
    assert (status, "There is no map nowhere." in told) == (2, True)


def test_tracks_are_what_is_said(office: Semap) -> None:
    (track,) = json.loads(office("track", "list", "--all", "--json")[1])
    assert track["concept"] == "Thing"
    change = ("track", "set", track["id"], "--json")
    told = {"id": track["id"], "track": "ann", "concept": "Thing", "attributes": {"kind": "person"}}
    assert json.loads(office(*change)[1]) == [told]
    told |= {"concept": None}
    assert json.loads(office(*change, "--concept", "none")[1]) == [told]
    told |= {"attributes": {"kind": "forklift"}}
    assert json.loads(office(*change, "--attributes", '{"kind": "forklift"}')[1]) == [told]
    for wrong in ("{", "[1]", '{"a": NaN}'):
        status, _, complaint = office(*change, "--attributes", wrong)
        assert (status, "--attributes" in complaint) == (2, True), complaint
    assert json.loads(office(*change)[1]) == [told]
