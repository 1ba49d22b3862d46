"""Dry runs, and what is learnt from history: the same events as live, and the parameters that made the gaps."""

from __future__ import annotations

import numpy as np
import pytest
from door_scene import PAPER, DoorScene, stamp
from rule_work import await_progress, running_worker
from world import World

from semap.errors import InvalidInput, NotFound
from semap.rules.language.reading import parse_declaration
from semap.store.database.connection import connect
from semap.worker.past import dry_run, learnt


def test_a_dry_run_makes_the_events_that_live_rules_made(world: World) -> None:
    scene = DoorScene(world)
    for name, document in PAPER.items():
        scene.add_rule(name, document)
    with running_worker(world.dsn):
        for number in range(4):
            scene.passage(100 + 40 * number, *(("ann", "bob") if number % 2 else ("bob", "ann")))
        scene.watermark(300)
        await_progress(world.dsn)
    before = world.rows("select count(*), max(seq) from semap.event")
    live = world.rows(
        "select event_id::text, rule_name from semap.event where rule_name = any (%s)", list(PAPER)
    )
    with connect(world.dsn, "semap_read") as connection:
        dry = [
            (str(event.event_id), name)
            for name, document in PAPER.items()
            for event in dry_run(connection, "world", parse_declaration(document, name))
        ]
        part = dry_run(
            connection, "world", parse_declaration(PAPER["left_then_closed"], "x"), stamp(140), stamp(200)
        )
    assert sorted(dry) == sorted(live)
    assert len(dry) == 12
    assert [(event.track_name, event.stamp) for event in part] == [("ann", stamp(144)), ("bob", stamp(184))]
    assert world.rows("select count(*), max(seq) from semap.event") == before


def test_a_map_that_is_not_there(world: World) -> None:
    with connect(world.dsn, "semap_read") as connection, pytest.raises(NotFound):
        dry_run(connection, "nowhere", parse_declaration(PAPER["left_then_closed"], "x"))


def test_the_parameters_of_a_confidence_are_learnt_from_gaps(world: World) -> None:
    """Stays in a room, lognormal: the likeliest parameters are mean and deviation of the logarithms."""
    DoorScene(world)
    dice = np.random.default_rng(3)
    stays_s = np.round(np.exp(dice.normal(np.log(5), 0.5, 40)), 3)
    states = []
    for number, stay_s in enumerate(stays_s):
        start_us = (100 + 200 * number) * 1_000_000
        track = world.add_track(f"p{number}")
        states += [(track, start_us, 1, 1, None), (track, start_us + round(stay_s * 1e6), 20, 1, None)]
    world.add_states(sorted(states, key=lambda state: state[1]))
    document = {
        "input": "track_in_room", "partition_by": ["track", "room"], "pattern": "A B",
        "define": {"A": "type = 'began'", "B": "type = 'ended'"}, "within": "1 h", "emit": "stay",
        "confidence": {"gap": ["A", "B"], "distribution": "lognormal", "median_s": 0.01, "sigma": 0.1, "at_least": 0.5},
    }  # fmt: skip
    with connect(world.dsn, "semap_read") as connection:
        fitted = learnt(connection, "world", parse_declaration(document, "stays"))
        with pytest.raises(InvalidInput, match="no confidence"):
            learnt(connection, "world", parse_declaration(PAPER["left_then_closed"], "x"))
        with pytest.raises(InvalidInput):
            learnt(connection, "world", parse_declaration(document, "stays"), stamp(10**6))
    assert fitted.confidence is not None
    logs = np.log(stays_s)
    assert fitted.confidence.parameters["median_s"] == pytest.approx(float(np.exp(logs.mean())))
    assert fitted.confidence.parameters["sigma"] == pytest.approx(float(logs.std()))
    assert fitted.confidence.at_least == 0.5
    assert fitted.as_json()["pattern"] == "A B"
