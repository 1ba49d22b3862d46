"""The plan and the trajectories: what the store finds is what was drawn, and pictures say it."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
import shapely
from semap_service.cli import commands
from typer.testing import CliRunner
from world import SECOND_US, World

from semap.errors import InvalidInput, NotFound, TooLarge
from semap.model.plan import Kind, Person, Thing, Way
from semap.picture.plan import draw_plan, draw_trajectories
from semap.store.database.connection import one_transaction
from semap.store.motion import plan

DAY_US = 1_767_225_600 * SECOND_US
RING = shapely.Polygon([(0, 0), (9, 0), (9, 6), (0, 6)], [[(3, 2), (6, 2), (6, 4), (3, 4)]])
ROOM = Thing(1, "den & co", Kind.ROOM, RING)
DOOR = Thing(2, "gate", Kind.DOOR, shapely.LineString([(0, 1), (0, 2)]))
POST = Thing(3, "post", Kind.THING, shapely.Point(12, 1))


def at(second: float) -> datetime:
    return datetime(2026, 1, 1, tzinfo=UTC) + timedelta(seconds=second)


@pytest.fixture
def scene(world: World) -> World:
    """Two rooms; ann walks from the one to the other, bob stands outside."""
    world.add_room("den", shapely.box(0, 0, 4, 4))
    world.add_room("hall", shapely.box(4, 0, 8, 4))
    ann, bob = world.add_track("ann"), world.add_track("bob")
    world.add_states([(ann, DAY_US + n * SECOND_US, 1.0 + n, 1.0, None) for n in range(6)])
    world.add_states([(bob, DAY_US + n * SECOND_US, -3.0, 9.0, None) for n in range(3)])
    return world


def test_things_and_ways_are_those_of_the_database(scene: World) -> None:
    with one_transaction(scene.dsn, "semap_read") as connection:
        found = {each.name: each for each in plan.things(connection, scene.name)}
        assert {name: each.kind for name, each in found.items()} == {"den": Kind.ROOM, "hall": Kind.ROOM}
        assert found["hall"].shape.equals(shapely.box(4, 0, 8, 4))
        ways = {each.name: each.points_m for each in plan.ways(connection, scene.name, at(1), at(4))}
        np.testing.assert_array_equal(ways["ann"], [[2, 1], [3, 1], [4, 1]])
        np.testing.assert_array_equal(ways["bob"], [[-3, 9], [-3, 9]])
        (only,) = plan.ways(connection, scene.name, at(0), at(9), ["bob"])
        assert only.name == "bob"
        assert plan.ways(connection, scene.name, at(60), at(90)) == ()
        with pytest.raises(NotFound):
            plan.things(connection, "nowhere")


def test_windows_are_openings_and_yet_no_doors(scene: World) -> None:
    for name, concept in (("gate", "Door"), ("pane", "Window"), ("hole", "Opening")):
        scene.add_room(name, shapely.box(3, 0, 4, 0.2))
        scene.run(
            "update semap.instance set concept_id = semap.concept_named(%s) where name = %s", concept, name
        )
    with one_transaction(scene.dsn, "semap_read") as connection:
        kinds = {each.name: each.kind for each in plan.things(connection, scene.name)}
    assert (kinds["gate"], kinds["pane"], kinds["hole"]) == (Kind.DOOR, Kind.THING, Kind.DOOR)


def test_more_states_than_a_picture_shows_are_refused(scene: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan, "MOST_POINTS", 8)
    with one_transaction(scene.dsn, "semap_read") as connection:
        assert len(plan.ways(connection, scene.name, at(0), at(4.5))) == 2
        with pytest.raises(TooLarge):
            plan.ways(connection, scene.name, at(0), at(9))


def texts(path: Path) -> str:
    """What an SVG says; matplotlib writes each text as a comment beside its outlines."""
    ElementTree.fromstring(path.read_text())
    return path.read_text()


def test_a_picture_names_what_is_in_it_and_is_the_same_each_time(tmp_path: Path) -> None:
    persons = [
        Person("ann", 1, 1, 0.5, 0.2, [(0.0, 1.0), (1.0, 1.0)]),
        Person("<bob>", 20, 1, None, None, []),
        Person("cyd", 3, 1, None, 0.5, [], 0.1, 0.7),
    ]
    for name in ("one.svg", "two.svg"):
        draw_plan([ROOM, DOOR, POST], persons, {1: 2}, {2: "open"}, "home", tmp_path / name)
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "two.svg").read_bytes()
    said = texts(tmp_path / "one.svg")
    assert all(
        name in said for name in ("den &amp; co", "2 inside", "ann", "&lt;bob&gt;", "door open", "home")
    )
    for suffix, start in ((".png", b"\x89PNG"), (".pdf", b"%PDF")):
        draw_plan([ROOM], persons, {}, {}, "home", tmp_path / f"plan{suffix}")
        assert (tmp_path / f"plan{suffix}").read_bytes().startswith(start)


def test_an_empty_map_and_a_track_that_stood_still_can_be_drawn(tmp_path: Path) -> None:
    draw_plan([], [], {}, {}, "nothing", tmp_path / "empty.svg")
    still = Way("still", np.zeros((1, 2)))
    draw_trajectories(
        [], [still, Way("moved", np.array([[0.0, 0.0], [5.0, 5.0]]))], "two", tmp_path / "two.svg"
    )
    assert "moved" in texts(tmp_path / "two.svg")
    with pytest.raises(InvalidInput, match=r"\.svg"):
        draw_plan([], [], {}, {}, "nothing", tmp_path / "plan.gif")
    with pytest.raises(InvalidInput, match="20001 things"):
        draw_plan([POST] * 20_001, [], {}, {}, "much", tmp_path / "much.svg")


def run(*arguments: str) -> tuple[int, str]:
    ran = CliRunner().invoke(commands(), ["plot", *arguments])
    return ran.exit_code, ran.output or repr(ran.exception)


def test_the_commands(scene: World, tmp_path: Path) -> None:
    here = ("--map", scene.name, "--dsn", scene.dsn)
    assert (
        run("plan", str(tmp_path / "a.svg"), *here)[1]
        == f"2 things and 2 tracks drawn to {tmp_path}/a.svg.\n"
    )
    assert "1 inside" in texts(tmp_path / "a.svg")
    assert "2026-01-01 00:00:05.000 UTC" in texts(tmp_path / "a.svg")
    early = run("plan", str(tmp_path / "b.svg"), *here, "--at", "2025-01-01T00:00:00Z")
    assert early[1] == f"2 things and 0 tracks drawn to {tmp_path}/b.svg.\n"
    drawn = run("trajectories", str(tmp_path / "c.png"), *here, "--track", "ann")
    assert drawn[1] == f"1 track drawn to {tmp_path}/c.png.\n"
    assert "no track was there" in run("trajectories", str(tmp_path / "d.svg"), *here, "--from", "2027-01-01T00:00:00Z", "--to", "2027-01-02T00:00:00Z")[1]  # fmt: skip
    assert "no such picture" in run("plan", str(tmp_path / "e.gif"), *here)[1]
    assert not (tmp_path / "d.svg").exists()
