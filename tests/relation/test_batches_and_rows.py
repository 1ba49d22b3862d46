"""The same states as track batches and as rows, on two maps, whatever happens between them: nothing that is known differs."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence

import psycopg
import pytest
import shapely
from world import SECOND_US, World

from semap.store.operate.doctor.verification import verify
from semap.timeline.stamp import to_datetime

STEP_US = 100_000
ROOMS = {"r0": (0, 0, 4, 4), "r1": (4, 0, 8, 4), "r2": (0, 4, 8, 7)}
QUERIES = {
    "gap": "longest_gap, fastest_mps) select '1 s', 20",
    "plain": "enabled) select true",
    "confirmed": "enter_confirm, leave_confirm, leave_margin_m) select '300 ms', '200 ms', 0.2",
    "likely": "enter_probability, leave_probability, widest_std_m) select 0.9, 0.2, 2",
}
ADD_PAIRS = """
    insert into semap.continuous_query (map_id, name, predicate, object_kind, distance_m)
    values (%s, %s, 'within_distance', 'track', 1.5)
"""
COLUMNS = ("x_m", "y_m", "z_m", "std_m", "heading_rad")
TYPES = ("float8", "float8", "float8", "real", "real")
KNOWN = {
    "log": "select query_name, track_name, instance_name, object_track_name, kind, cause, stamp, transition_at, since,"
    " x_m, y_m, amendment from semap.relation_change where map_id = %s",
    "relations": "select query, track, instance, since from semap.relation_now where map_id = %s",
    "past": "select query_name, track_name, instance_name, since, until from semap.relation_past where map_id = %s",
    "places": "select k.name, p.live, p.stamp::text, p.first_stamp::text, p.x_m, p.y_m, p.z_m, p.std_m, p.heading_rad"
    " from semap.track_place p join semap.track k using (track_id) where p.map_id = %s",
    "states": "select k.name, s.stamp, s.x_m, s.y_m, s.z_m, s.std_m, s.heading_rad, s.is_last"
    " from semap.stored_state s join semap.track k using (track_id) where k.map_id = %s",
    "counts": "select s.name, s.late_states, s.outliers, c.track_states"
    " from semap.source s left join semap.source_count c using (source_id) where s.map_id = %s",
}

Seen = tuple[str, float, float, float | None, float | None, float | None]


class Side:
    """A map with two sources, whose states come as track batches or as rows. Mutable."""

    def __init__(self, dsn: str, name: str, in_batches: bool) -> None:
        self.world = World(dsn, name)
        self.in_batches = in_batches
        self.sources = [self.world.source_id, self.world.add_source("second")]
        self.tracks: dict[str, int] = {}

    def send(self, source: int, stamp_us: int, seen: Sequence[Seen], *, whole: bool = True) -> None:
        ids = [self.tracks[name] for name, *_ in seen]
        values = list(zip(*(each[1:] for each in seen), strict=True))
        arrays = [None if set(each) == {None} else list(each) for each in values]
        named = list(zip(COLUMNS, TYPES, strict=True))
        casts = ", ".join(f"%s::{each}[]" for each in TYPES)
        if self.in_batches and whole:
            self.world.run(
                f"select semap.add_states(%s, %s, %s, {', '.join(f'{name} => %s::{of}[]' for name, of in named)})",
                self.sources[source], to_datetime(stamp_us), ids, *arrays,
            )  # fmt: skip
            return
        self.world.run(
            f"insert into semap.track_state (track_id, stamp, {', '.join(COLUMNS)})"
            f" select n.id, %s, n.x_m, n.y_m, n.z_m, n.std_m, n.heading_rad"
            f" from unnest(%s::bigint[], {casts}) n (id, {', '.join(COLUMNS)})",
            to_datetime(stamp_us), ids, *arrays,
        )  # fmt: skip
        if whole:
            self.world.complete(self.sources[source])

    def compact(self) -> None:
        self.world.run("select semap.compact_all(%s)", self.sources)

    def known(self) -> dict[str, list[tuple]]:
        return {
            what: sorted(self.world.rows(statement, self.world.map_id), key=repr)
            for what, statement in KNOWN.items()
        }


class Play:
    """Random doings on both sides. Mutable."""

    def __init__(self, database: str, seed: int) -> None:
        self.dice = random.Random(seed)
        self.sides = (Side(database, "as rows", False), Side(database, "in batches", True))
        self.now_us = SECOND_US
        self.places: dict[str, list[float]] = {}
        self.source_of: dict[str, int] = {}
        self.ended: set[str] = set()
        self.unflushed = 0
        for name, box in ROOMS.items():
            self.both(lambda side, name=name, box=box: side.world.add_room(name, shapely.box(*box)))
        jump_m = self.dice.choice([None, 15.0])
        self.both(lambda side: side.world.run("update semap.source set jump_m = %s", jump_m))
        for number in range(6):
            self.appear(f"t{number}", number % 2)

    def both(self, do: Callable[[Side], object]) -> None:
        """The same on both maps, with the same error or none."""
        said = []
        for side in self.sides:
            try:
                do(side)
                said.append("")
            except psycopg.Error as error:
                said.append(f"{type(error).__name__}: {str(error).split('Key')[0]}")
        assert said[0] == said[1]

    def appear(self, name: str, source: int) -> None:
        self.source_of[name] = source
        self.places[name] = [self.dice.uniform(0, 8), self.dice.uniform(0, 7)]
        self.both(lambda side: side.tracks.update({name: side.world.add_track(name, side.sources[source])}))

    def seen(self, names: Sequence[str]) -> list[Seen]:
        dice, found = self.dice, []
        for name in names:
            place = self.places[name]
            place[:] = [x + dice.gauss(0, 0.2) for x in place]
            if dice.random() < 0.15:
                place[:] = [dice.uniform(-1, 9), dice.uniform(-1, 8)]
            out_m = 40.0 if dice.random() < 0.01 else 0.0
            height_m, std_m, heading_rad = (
                dice.choice([None, 1.0]), dice.choice([None, None, 0.3]), dice.choice([None, 0.5])
            )  # fmt: skip
            found.append((name, place[0] + out_m, place[1], height_m, std_m, heading_rad))
        return found

    def step(self) -> None:
        dice, run = self.dice, World.run
        source = dice.randrange(2)
        names = sorted(name for name, of in self.source_of.items() if of == source and name not in self.ended)
        name = dice.choice(names) if names else ""
        what = dice.random()
        if what < 0.74 and names:
            self.now_us += dice.choice([STEP_US] * 9 + [5 * STEP_US, 11 * SECOND_US])
            seen = self.seen(
                names if dice.random() < 0.92 else dice.sample(names, dice.randint(1, len(names)))
            )
            self.both(lambda side: side.send(source, self.now_us, seen))
            self.unflushed += self.sides[1].world.one(
                "select count(*) from semap.source_count where unflushed > 0"
            )
        elif what < 0.79 and names:
            seen, late_us = self.seen([name]), self.now_us - dice.randint(1, 30) * STEP_US + 1
            self.both(lambda side: side.send(source, late_us, seen, whole=False))
        elif what < 0.82:
            room = shapely.box(0, 0, dice.uniform(2, 5), 4)
            self.both(lambda side: side.world.edit_room("r0", room))
        elif what < 0.85:
            self.other_query()
        elif what < 0.88 and names:
            self.source_of[name] = 1 - source
            self.both(lambda side: run(side.world, "select semap.hand_over_tracks(%s, %s)",
                                       [side.tracks[name]], side.sources[1 - source]))  # fmt: skip
        elif what < 0.90 and len(names) > 1:
            del self.source_of[name]
            self.both(
                lambda side: run(side.world, "delete from semap.track where track_id = %s", side.tracks[name])
            )
        elif what < 0.92 and names:
            self.ended.add(name)
            at_us = self.now_us + dice.choice([-5 * STEP_US, 0, STEP_US])
            self.both(lambda side: side.world.end_track(side.tracks[name], at_us))
        elif what < 0.94:
            self.ended -= {dice.choice(sorted(self.ended))} if self.ended else set()
            self.appear(f"n{self.now_us}-{len(self.places)}", source)
        else:
            dice.choice(self.sides).compact()

    def other_query(self) -> None:
        kind, name = (
            self.dice.choice([*QUERIES, "pairs", "none", "other"]),
            f"q{len(self.places)} {self.now_us}",
        )
        if kind == "none":
            statement = (
                "delete from semap.continuous_query where map_id = %s and name <> %s and name like 'q%%'"
            )
        elif kind == "other":
            statement = (
                "update semap.continuous_query set enabled = not enabled where map_id = %s and name <> %s"
            )
        elif kind == "pairs":
            statement = ADD_PAIRS
        else:
            columns, values = QUERIES[kind].split(") select ")
            statement = (
                f"insert into semap.continuous_query (map_id, name, object_concept_id, {columns})"
                f" select %s, %s, concept_id, {values} from semap.concept where name = 'Room'"
            )
        self.both(lambda side: side.world.run(statement, side.world.map_id, name))

    def compare(self) -> None:
        rows, batches = (side.known() for side in self.sides)
        for what in KNOWN:
            assert batches[what] == rows[what], what


@pytest.mark.parametrize("seed", range(6))
def test_whatever_happens_nothing_that_is_known_differs(database: str, seed: int) -> None:
    play = Play(database, seed)
    try:
        for number in range(140):
            play.step()
            if number % 5 == 0:
                play.compare()
        play.compare()
        play.sides[1].compact()
        play.compare()
        verification = verify(database, lambda said: None)
        with verification.connection:
            assert [each for each in verification.look(None) if each.differ] == []
        assert play.unflushed > 3
    finally:
        for side in play.sides:
            side.world.close()
