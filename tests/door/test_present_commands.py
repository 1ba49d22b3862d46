"""Doors, tracks and amendments on the command line."""

from __future__ import annotations

import json
import math

import pytest
from door_plan import SCAN_US, Door, DoorPlan
from semap_service.cli import commands
from typer.testing import CliRunner
from world import World

from semap.errors import NotFound


@pytest.fixture
def plan(world: World) -> DoorPlan:
    return DoorPlan(world)


def run(world: World, *arguments: str) -> str:
    ran = CliRunner().invoke(commands(), [*arguments, "--dsn", world.dsn], catch_exceptions=False)
    assert ran.exit_code == 0
    return ran.output


def test_doors_are_shown_with_state_and_angle(plan: DoorPlan) -> None:
    assert "leaf: left" in run(plan.world, "door", "list")
    gate = plan.add(Door("gate", 1.0, 2.0))
    plan.observe(gate.seen(n * SCAN_US, math.radians(85)) for n in (1, 2))
    title, line = run(plan.world, "door", "list", "--map", "world").splitlines()
    assert title.split() == ["map", "instance_id", "door", "state", "since", "stamp", "angle_deg", "angle_std_deg",
                             "width_m", "max_deg", "rooms"]  # fmt: skip
    assert line.split()[2:4] == ["gate", "open"]
    assert line.split()[8:10] == ["85.0", "0.6"]
    (told,) = json.loads(run(plan.world, "door", "list", "--json"))
    assert (told["door"], told["state"], told["angle_deg"]) == ("gate", "open", pytest.approx(85))
    with pytest.raises(NotFound, match=r"There is no map elsewhere\."):
        run(plan.world, "door", "list", "--map", "elsewhere", "--json")


def test_tracks_and_their_amendments_are_shown(world: World) -> None:
    assert "No amendments" in run(world, "track", "amendments")
    a, b, ended = (world.add_track(name) for name in ("ann", "bob", "eve"))
    world.run(
        "insert into semap.track_state (track_id, stamp, x_m, y_m, heading_rad, length_m, width_m)"
        " values (%s, '2026-01-31T12:00:00Z', 1.23456, 2, 0.5, 0.5, 0.3)", a,
    )  # fmt: skip
    world.end_track(ended, SCAN_US)
    for kind in ("merged", "switched"):
        world.run(
            "insert into semap.track_amendment (track_id, other_track_id, kind, since, found)"
            " values (%s, %s, %s, '2026-01-31T12:00:01Z', '2026-01-31T12:00:02Z')", b, a, kind,
        )  # fmt: skip
    title, line = run(world, "track", "list").splitlines()
    assert dict(zip(title.split(), ["id", *line.split()[1:4]], strict=False))["track"] == "ann"
    assert "1.235" in line
    assert len(json.loads(run(world, "track", "list", "--all", "--json"))) == 3
    merged, switched = run(world, "track", "amendments", "--map", "world").splitlines()
    assert merged.endswith("2026-01-31 12:00:02.000  bob is ann since 2026-01-31 12:00:01.000")
    assert switched.endswith("bob and ann had changed places since 2026-01-31 12:00:01.000")
    first = json.loads(run(world, "track", "amendments", "--json").splitlines()[0])
    assert (first["track"], first["other_track"], first["kind"]) == ("bob", "ann", "merged")
    after = str(first["track_amendment_id"])
    assert run(world, "track", "amendments", "--after", after).splitlines() == [switched]
