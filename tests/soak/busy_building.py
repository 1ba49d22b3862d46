"""Processes that write, hand tracks over, edit and read one map at once, each until a moment; for test_soak."""

from __future__ import annotations

import random
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Barrier
from threading import Event as Signal

import numpy as np
import psycopg
import shapely
from semap_ingest.replay import Plan, replay
from semap_ingest.track_file import Tracks
from world import SECOND_US, keep_where

from semap.store.database.connection import connect

MAP = "world"
FASTER = 4
"""So many seconds of event time pass in one."""
PERIOD_US = SECOND_US // 5
ROOMS = 24
QUERIES = {
    "plain": {},
    "debounced": {"enter_margin_m": 0.3, "leave_margin_m": 0.3, "enter_confirm": "1 s", "leave_confirm": "2 s"},
    "by the way": {"longest_gap": "3 s", "fastest_mps": 10, "leave_confirm": "0.5 s"},
    "of the first": {"subject_where": {"op": "like", "args": [{"property": "source"}, "w1%"]}},
    "likely": {"enter_probability": 0.9, "leave_probability": 0.1, "widest_std_m": 2},
    "near each other": {"predicate": "within_distance", "distance_m": 0.5, "leave_margin_m": 0.2, "object_kind": "track"},
    "near the first": {"predicate": "nearest", "count": 1, "distance_m": 1, "object_kind": "track",
                       "subject_where": {"op": "like", "args": [{"property": "source"}, "w1%"]}},
}  # fmt: skip


MAY_WAIT = ("plain", "debounced", "of the first", "likely")
"""Queries of maps whose states may stay frames for a while."""


def room(number: int, shift_m: float = 0.0) -> shapely.Geometry:
    """A concave room of 4 m, six in a row."""
    x, y = 4 * (number % 6) + shift_m, 4 * (number // 6)
    return shapely.Polygon([(x, y), (x + 4, y), (x + 4, y + 3), (x + 2, y + 3), (x + 2, y + 4), (x, y + 4)])


@dataclass(frozen=True)
class Shift:
    """What a process needs to know: where, for how long [s], its name, its dice and which queries there may be, and when it
    began [s, time.time()]."""

    dsn: str
    seconds: float
    name: str
    seed: int
    queries: tuple[str, ...]
    started_s: float = 0.0

    def is_over(self) -> bool:
        return time.time() >= self.started_s + self.seconds

    def now_us(self) -> int:
        """Event time."""
        return int((time.time() - self.started_s) * FASTER * SECOND_US) + 1_000_000_000 * SECOND_US


@dataclass
class Done:
    """What a process did, by name; or how it failed."""

    name: str
    counts: dict[str, int] = field(default_factory=dict)
    failed: str = ""


def at_work(
    work: Callable[[Shift, random.Random, dict[str, int]], None],
    shift: Shift,
    gate: Barrier,
    told: Queue[Done],
) -> None:
    """Run it when all are there, and tell of it, as the process that is started."""
    done = Done(shift.name)
    try:
        gate.wait(120)
        shift = replace(shift, started_s=time.time())
        work(shift, random.Random(shift.seed), done.counts)
    except BaseException:
        done.failed = traceback.format_exc()
    told.put(done)


def count(counts: dict[str, int], name: str, by: int = 1) -> None:
    counts[name] = counts.get(name, 0) + by


def write(
    shift: Shift, dice: random.Random, counts: dict[str, int], tracks: int = 12, most: int = 60
) -> None:
    """Recording after recording of the tracks that are this source's now; at the end of some, tracks end or go on at
    another source."""
    own = [f"{shift.name}-{n}" for n in range(tracks)]
    number = 0
    while not shift.is_over():
        with connect(shift.dsn) as connection:
            rows = connection.execute(
                "select k.name, extract(epoch from p.stamp)::float8, p.x_m, p.y_m from semap.present_places((select map_id"
                " from semap.map where name = %s)) p join semap.track k using (track_id) join semap.source s"
                " on s.source_id = p.source_id where s.name = %s", [MAP, shift.name],
            ).fetchall()  # fmt: skip
        known = {name: (stamp_s, x, y) for name, stamp_s, x, y in rows}
        names = sorted(known) if number else own
        if names:
            recorded = walk(shift, dice, names, known)
            number += 1
            is_end = dice.random() < 0.15
            plan = Plan(
                MAP,
                shift.name,
                "",
                f"{shift.name} {number}",
                dice.choice([1, 7, len(names), most, most]),
                keep_open=not is_end,
            )
            count(counts, "states", replay(shift.dsn, plan, recorded).states)
        if names and dice.random() < 0.7:
            hand_over(shift, dice, counts, dice.sample(names, min(len(names), dice.randint(1, 3))))


def write_frames(shift: Shift, dice: random.Random, counts: dict[str, int]) -> None:
    """Whole frames of many tracks, whose places are written late where that may be."""
    write(shift, dice, counts, tracks=220, most=220)


def walk(shift: Shift, dice: random.Random, names: list[str], known: dict[str, tuple]) -> Tracks:
    now_us = shift.now_us() // PERIOD_US * PERIOD_US
    steps = 5 if len(names) > 100 else 20
    rng = np.random.default_rng(dice.getrandbits(32))
    columns = []
    for number, name in enumerate(names):
        stamp_s, x, y = known.get(name, (None, None, None))
        start = np.array([x, y]) if x is not None else rng.uniform(0, 20, 2)
        way = np.clip(start + np.cumsum(rng.normal(0, 0.25, (steps, 2)), axis=0), [-2, -2], [26, 18])
        stamps_us = now_us + np.arange(1, steps + 1) * PERIOD_US
        is_new = stamps_us > (stamp_s * SECOND_US if stamp_s is not None and np.isfinite(stamp_s) else 0)
        columns.append(np.column_stack([np.full(steps, number), stamps_us, way])[is_new])
    rows = np.concatenate(columns)
    # some come three steps late
    is_late = (rng.random(len(rows)) < 0.03) & (rows[:, 1] < rows[:, 1].max(initial=0) - 4 * PERIOD_US)
    rows = rows[np.argsort(rows[:, 1] + 3 * PERIOD_US * is_late, kind="stable")]
    nothing = np.full(len(rows), np.nan)
    exact = np.where(np.arange(len(rows)) % 3 == 0, np.nan, 0.1)
    is_slanting = np.arange(len(rows)) % 2 == 0
    return Tracks(
        tuple(names),
        rows[:, 0].astype(np.int64),
        rows[:, 1].astype(np.int64),
        rows[:, 2],
        rows[:, 3],
        nothing,
        exact,
        np.where(is_slanting, exact / 4, np.nan),
        np.where(is_slanting & ~np.isnan(exact), rng.uniform(-1.5, 1.5, len(rows)), np.nan),
    )


def hand_over(shift: Shift, dice: random.Random, counts: dict[str, int], names: list[str]) -> None:
    with connect(shift.dsn, "semap_ingest") as connection:
        others = [
            name
            for (name,) in connection.execute(
                "select name from semap.source where name <> %s and name like 'w%%'", [shift.name]
            )
        ]
        if others:
            connection.execute(
                "select semap.hand_over_tracks(array(select track_id from semap.track join semap.source s using (source_id)"
                " where s.name = %s and track.name = any (%s)), (select source_id from semap.source where name = %s))",
                [shift.name, names, dice.choice(sorted(others))],
            )  # fmt: skip
            count(counts, "handed over", len(names))


def edit(shift: Shift, dice: random.Random, counts: dict[str, int]) -> None:
    """Rooms move, come and go; queries change, come and go; tracks are described anew, ended and deleted."""
    edits: list[Callable[[psycopg.Connection, random.Random], None]] = [move_room, move_room, move_room, other_rooms,
             partial(other_query, names=shift.queries), partial(other_query, names=shift.queries),
             change_query, describe_track, end_track]  # fmt: skip
    with connect(shift.dsn) as connection:
        while not shift.is_over():
            chosen = dice.choice(edits)
            with connection.transaction():
                chosen(connection, dice)
                if dice.random() < 0.2 and chosen not in (describe_track, end_track):
                    move_room(connection, dice)
            count(counts, "edits")
            Signal().wait(dice.uniform(0.05, 0.6))


def move_room(connection: psycopg.Connection, dice: random.Random) -> None:
    number = dice.randrange(ROOMS)
    connection.execute(
        "update semap.abstraction a set geometry = %s from semap.instance i where i.name = %s"
        " and a.description_id = i.absolute_description_id",
        [shapely.to_wkb(room(number, dice.choice([-1.0, -0.25, 0.0, 0.5])), hex=True), f"r{number}"],
    )


def other_rooms(connection: psycopg.Connection, dice: random.Random) -> None:
    """One goes, or all that went come back."""
    if dice.random() < 0.6:
        connection.execute("delete from semap.instance where name = %s", [f"r{dice.randrange(ROOMS)}"])
        return
    there = {name for (name,) in connection.execute("select name from semap.instance")}
    for number in range(ROOMS):
        if f"r{number}" not in there:
            add_room(connection, number)


def add_room(connection: psycopg.Connection, number: int) -> None:
    connection.execute("select semap.lock_regions_exclusive()")
    connection.execute(
        "with d as (insert into semap.description (map_id) select map_id from semap.map returning description_id, map_id),"
        " i as (insert into semap.instance (map_id, name, concept_id, frame_id, absolute_description_id)"
        "  select d.map_id, %s, c.concept_id, f.frame_id, d.description_id from d, semap.concept c, semap.frame f"
        "  where c.name = 'Room' returning instance_id, absolute_description_id)"
        " insert into semap.abstraction (description_id, instance_id, type, geometry)"
        " select absolute_description_id, instance_id, 'Footprint', %s from i",
        [f"r{number}", shapely.to_wkb(room(number), hex=True)],
    )


def other_query(connection: psycopg.Connection, dice: random.Random, names: Sequence[str]) -> None:
    """One that is there goes, one that is not comes."""
    name = dice.choice(names)
    gone = connection.execute("delete from semap.continuous_query where name = %s", [name]).rowcount
    if not gone:
        add_query(connection, name)


def add_query(connection: psycopg.Connection, name: str) -> None:
    values = QUERIES[name]
    columns = "".join(f", {column}" for column in values)
    with connection.transaction():
        (map_id,) = connection.execute("select map_id from semap.map").fetchone()
        said = [
            keep_where(connection, map_id, each) if isinstance(each, dict) else each
            for each in values.values()
        ]
        connection.execute(
            f"insert into semap.continuous_query (map_id, name, object_concept_id{columns})"
            f" select %s, %s, case when %s then concept_id end{', %s' * len(values)} from semap.concept c"
            " where c.name = 'Room'",
            [map_id, name, values.get("object_kind") != "track", *said],
        )


def change_query(connection: psycopg.Connection, dice: random.Random) -> None:
    connection.execute(
        "update semap.continuous_query set enter_margin_m = %s where name = 'debounced'",
        [dice.choice([0.1, 0.3, 0.5])],
    )


def describe_track(connection: psycopg.Connection, dice: random.Random) -> None:
    connection.execute(
        "update semap.track set attributes = jsonb_build_object('n', %s::int) where track_id ="
        " (select track_id from semap.track order by random() limit 1)", [dice.randrange(9)],
    )  # fmt: skip


def end_track(connection: psycopg.Connection, dice: random.Random) -> None:
    connection.execute("select semap.lock_regions_exclusive()")
    connection.execute(
        "update semap.track k set ended_at = t.stamp from semap.track_now t where k.track_id = t.track_id"
        " and t.track_id = (select track_id from semap.track_now where live order by random() limit 1)"
    )


def read(shift: Shift, dice: random.Random, counts: dict[str, int]) -> None:
    """Relations and presents, each in one snapshot: who is in a region lives, who is in a pair where pairs are."""
    with connect(shift.dsn, "semap_read") as connection:
        connection.isolation_level = psycopg.IsolationLevel.REPEATABLE_READ
        while not shift.is_over():
            with connection.transaction():
                strange = connection.execute(
                    "select track_id from semap.relation where not in_pairs"
                    " except select track_id from semap.track_now where live"
                ).fetchall()
                strange += connection.execute(
                    "select key from semap.relation cross join unnest(array[subject_key, object_key]) key"
                    " where in_pairs and key > 0"
                    " except select track_id from semap.followed_state"
                ).fetchall()
            assert strange == []
            count(counts, "read")
            Signal().wait(dice.uniform(0.02, 0.2))
