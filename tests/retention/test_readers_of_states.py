"""Whoever reads states is told the same before and after they are compacted, and what plain Python says."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from dataclasses import astuple
from datetime import UTC, datetime, timedelta

import psycopg
import pytest
import shapely
from past_days import compact, make_partitions, midnight, stored
from rule_work import await_progress, running_worker
from sqlalchemy import Connection
from world import SECOND_US, State, World

from semap.batch.recompute import Plan, recompute
from semap.batch.stored_tracks import read_states, read_tracks
from semap.intake import enrichment
from semap.store.database.connection import connect, open_engine
from semap.store.event import events
from semap.store.features.collection import get_collection
from semap.store.features.page import Wanted, read_page
from semap.store.features.placing import placing_of
from semap.store.motion import moment, plan, track_history
from semap.timeline.stamp import to_datetime, to_us

ROOMS = {"west": shapely.box(0, 0, 4, 4), "east": shapely.box(4, 0, 8, 4)}
LIMIT = 700
Told = dict[str, object]


class Story:
    """Four people who walk through two rooms on a day that is past, some of them for hours, with pauses and jumps."""

    def __init__(self, world: World) -> None:
        dice = random.Random(7)
        self.world = world
        self.begin_us = to_us(midnight(3)) + 9 * 3600 * SECOND_US
        for name, shape in ROOMS.items():
            world.add_room(name, shape)
        self.states: dict[int, list[State]] = {}
        for name, count, pace_us in (
            ("a", 2600, 700_000),
            ("b", 900, 100_000),
            ("c", 40, 90_000_000),
            ("d", 1, 1),
        ):
            track_id = world.add_track(name)
            stamp_us, x_m, states = self.begin_us + dice.randrange(10**6), 2.0, []
            for n in range(count):
                stamp_us += dice.choice([pace_us, pace_us, pace_us + dice.randrange(-500, 500), 3 * pace_us])
                x_m = min(max(x_m + dice.gauss(0, 0.3), -1), 9)
                height = dice.choice([None, 0.5]) if name == "b" else None
                states.append((track_id, stamp_us, x_m, dice.uniform(1, 3), height, name == "c" and n == 39))
            self.states[track_id] = states
        self.every = sorted(
            (each for states in self.states.values() for each in states), key=lambda each: each[1]
        )
        for start in range(0, len(self.every), 500):
            world.add_states(self.every[start : start + 500])
        world.run("update semap.source set watermark = %s, ended = true", to_datetime(self.every[-1][1]))
        self.dice = dice

    def some(self) -> datetime:
        return to_datetime(self.dice.randint(self.begin_us, self.every[-1][1]))


def questions(story: Story) -> Mapping[str, Callable[[Connection, psycopg.Connection], object]]:
    """What the readers of states are asked; the same whenever they are asked again."""
    world, name = story.world, story.world.name
    first, last = to_datetime(story.begin_us), to_datetime(story.every[-1][1])
    asked: dict[str, Callable[[Connection, psycopg.Connection], object]] = {
        "all": lambda _, plain: stored(plain),
        "extent": lambda c, _: moment.extent(c, name),
        "ways": lambda c, _: [(way.name, way.points_m.tolist()) for way in plan.ways(c, name, first, last)],
        "events": lambda c, _: events.list_events(c, limit=1000),
        "features": lambda c, _: read_page(
            c, e := get_collection(c, f"{name}.events"), placing_of(c, e.map_id, e.map), Wanted(), limit=1000
        ),
        "recompute": lambda *_: recompute(world.dsn, Plan(name, first, last), dry_run=True).counts(),
    }
    for n in range(25):
        at, until, track_id = story.some(), story.some(), story.dice.choice(list(story.states))
        around = [story.some() for _ in range(3)]
        start, end = sorted([at, until])
        asked |= {
            f"moment {n}": lambda c, _, at=at: moment.moment(c, name, at, trail_s=60),
            f"history {n}": lambda c, _, t=track_id, s=start, e=end: track_history.history(
                c, t, s, e, after=s - timedelta(seconds=1), limit=LIMIT
            ),
            f"state {n}": lambda c, _, t=track_id, at=at: track_history.state_at(c, t, at),
            f"around {n}": lambda c, _, t=track_id, a=around: track_history.states_around(c, t, a),
            f"span {n}": lambda c, _, t=track_id: track_history.span(c, t),
            f"ways {n}": lambda c, _, s=start, e=end: [
                (way.name, way.points_m.tolist()) for way in plan.ways(c, name, s, e, ["a", "b"])
            ],
            f"batch {n}": lambda _, plain, s=start, e=end: [
                each.tobytes() for each in astuple(read_states(plain, world.map_id, s, e))
            ],
            f"tracks {n}": lambda _, plain, s=start, e=end: read_tracks(plain, list(story.states), s, e),
        }
    told = story.dice.sample(story.every, 50)
    columns = [list(range(50)), [to_datetime(each[1]) for each in told], [each[0] for each in told]]
    rooms = [row[0] for row in world.rows("select instance_id from semap.instance order by 1")]
    asked["positions"] = lambda _, plain: sorted(plain.execute(enrichment.POSITIONS, columns).fetchall())
    asked["candidates"] = lambda _, plain: sorted(
        plain.execute(
            enrichment.CANDIDATES, [columns[0], columns[1], rooms * 25, [20.0] * 50, world.map_id]
        ).fetchall()
    )
    return asked


@pytest.fixture
def story(world: World) -> Story:
    make_partitions(world.connection, 3)
    with running_worker(world.dsn):
        made = Story(world)
        await_progress(world.dsn)
    return made


def answers(story: Story, asked: Mapping[str, Callable[[Connection, psycopg.Connection], object]]) -> Told:
    engine = open_engine(story.world.dsn, "semap_read")
    with engine.connect() as connection, connect(story.world.dsn, "semap_worker") as plain:
        told = {name: ask(connection, plain) for name, ask in asked.items()}
    engine.dispose()
    return told


def test_all_readers_are_told_the_same(story: Story) -> None:
    asked = questions(story)
    before = answers(story, asked)
    compact(story.world.connection)
    after = answers(story, asked)
    assert [name for name in asked if str(before[name]) != str(after[name])] == []
    # half and half: what comes late is compacted later
    some = sorted(story.states)[0]
    late = [(some, us + 1, 1.0, 1.0, None) for _, us, *_ in story.states[some][::10]]
    story.world.add_states(late)
    mixed = answers(story, asked)
    compact(story.world.connection)
    packed = answers(story, asked)
    assert [name for name in asked if str(mixed[name]) != str(packed[name])] == []
    assert str(mixed["all"]) != str(after["all"])
    story.states[some] = sorted([*story.states[some], *late])
    compare_with_lists(story)


def compare_with_lists(story: Story) -> None:
    """What histories and states at a moment say, against the states that were written."""
    engine = open_engine(story.world.dsn)
    with engine.connect() as connection:
        for _ in range(40):
            track_id = story.dice.choice(list(story.states))
            known = story.states[track_id]
            start, end = sorted([story.some(), story.some()])
            limit = story.dice.choice([1, 10, 400, 3000])
            wanted = [us for _, us, *_ in known if to_us(start) <= us <= to_us(end)][:limit]
            found = track_history.history(
                connection, track_id, start, end, after=datetime(1900, 1, 1, tzinfo=UTC), limit=limit
            )
            assert [to_us(each.stamp) for each in found] == wanted
            newest = max(
                (each for each in known if each[1] <= to_us(end)), default=None, key=lambda each: each[1]
            )
            state = track_history.state_at(connection, track_id, end)
            assert (state and (to_us(state.stamp), state.x_m)) == (newest and newest[1:3])
    engine.dispose()
