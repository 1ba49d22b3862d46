"""Where a query follows amendments, its relations are those of the same states, written under the right tracks at once."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from uuid import uuid4

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from stateful_oracle import Asked, Sample
from test_132_stateful import asked, walk
from test_139_late_state import PAST, STANDING, WAITING
from test_oracle import BANDS, SHAPES
from world import SECOND_US, World

from semap.timeline.stamp import to_datetime

QUICK = settings(
    max_examples=12,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
HELD = """
    select q.name, t.name, i.name, n.since
    from semap.relation n join semap.continuous_query q using (query_id) join semap.track t using (track_id)
    join semap.instance i using (instance_id) where n.map_id = %s and n.confirmed order by 1, 2, 3
"""
SAID = (
    "select query_name, track_name, instance_name, kind::text, cause::text, stamp, since, amendment"
    " from semap.relation_change where map_id = %s and query_name = 'as told' order by change_id"
)
AMEND = "insert into semap.track_amendment (track_id, other_track_id, kind, since, found) values (%s, %s, %s, %s, %s)"


@dataclass(frozen=True)
class Told:
    """A state of a track, and of whom it is; None: of a person of whom a state is told at that stamp already."""

    track: str
    person: str | None
    sample: Sample


@dataclass(frozen=True)
class Amendment:
    track: str
    other: str
    kind: str
    since_us: int
    found_us: int


class Tracker:
    """Follows persons, and mistakes them: it loses some and finds them again, switches them, sees some twice."""

    def __init__(self, dice: random.Random, persons: int, steps: int) -> None:
        self.dice, self.names = dice, 0
        self.told: list[Told] = []
        self.amendments: list[Amendment] = []
        self.track = [self.new_track() for _ in range(persons)]
        self.person = list(self.track)
        self.last: dict[int, int] = {}
        for sample, number in sorted(
            ((replace(each, stamp_us=each.stamp_us * 8 + number), number)
             for number in range(persons) for each in walk(dice, steps)),
            key=lambda due: due[0].stamp_us,
        ):  # fmt: skip
            self.mistake(number, sample)
            self.last[number] = len(self.told)
            self.told.append(Told(self.track[number], self.person[number], sample))
            if dice.random() < 0.1:
                self.see_twice(number, sample)

    def new_track(self) -> str:
        self.names += 1
        return f"t{self.names}"

    def lives(self, number: int) -> bool:
        """Whether the person's track was seen as his, and is not over."""
        before = self.told[self.last[number]] if number in self.last else None
        return before is not None and before.track == self.track[number] and not before.sample.is_last

    def mistake(self, number: int, sample: Sample) -> None:
        found_us = sample.stamp_us + self.dice.choice([0, 3, 30]) * SECOND_US
        chance, other = self.dice.random(), self.dice.randrange(len(self.track))
        if not self.lives(number):
            return
        if chance < 0.1:
            place, old, new = self.last[number], self.track[number], self.new_track()
            over = self.told[place]
            self.told[place] = replace(over, sample=replace(over.sample, is_last=True))
            self.amendments.append(Amendment(new, old, "merged", sample.stamp_us, found_us))
            self.track[number] = new
        elif chance < 0.25 and other != number and self.lives(other):
            one, two = self.track[number], self.track[other]
            pair = self.dice.choice([(one, two), (two, one)])
            self.amendments.append(Amendment(*pair, "switched", sample.stamp_us, found_us))
            self.track[number], self.track[other] = two, one

    def see_twice(self, number: int, sample: Sample) -> None:
        """A second track of a person: at his stamp, and at some between that and the next ones of all."""
        twin, first_us = self.new_track(), sample.stamp_us
        since_us = first_us + self.dice.choice([0, 4, 8])
        stamps_us = [first_us, *(first_us + offset for offset in (4, 6, 9) if self.dice.random() < 0.7)]
        for stamp_us in stamps_us:
            whose = twin if stamp_us < since_us else None if stamp_us == first_us else self.person[number]
            seen = replace(sample, stamp_us=stamp_us, x_m=sample.x_m + self.dice.choice([0, 0.5]),
                           is_last=stamp_us == stamps_us[-1])  # fmt: skip
            self.told.append(Told(twin, whose, seen))
        self.amendments.append(Amendment(twin, self.track[number], "merged", since_us, since_us + SECOND_US))

    def truth(self) -> dict[str, list[Sample]]:
        """The states of each person. Who goes on as another track was not over; a second track is, with its own."""
        found: dict[str, list[Told]] = {}
        for each in sorted(self.told, key=lambda each: each.sample.stamp_us):
            if each.person is not None:
                found.setdefault(each.person, []).append(each)
        truth = {}
        for name, states in found.items():
            samples = [
                replace(one.sample, is_last=one.sample.is_last and one.track == after.track)
                for one, after in pairwise(states)
            ]
            samples.append(replace(states[-1].sample, is_last=self.is_over(name)))
            truth[name] = samples
        return truth

    def is_over(self, name: str) -> bool:
        """Whether nobody is there under that name: of a second track, or of a person whose track is over."""
        if name not in self.person:
            return True
        track = self.track[self.person.index(name)]
        newest = max(
            (each for each in self.told if each.track == track), key=lambda each: each.sample.stamp_us
        )
        return newest.sample.is_last


def scene(database: str, question: Asked, rooms: Sequence[tuple], follows: bool) -> World:
    """A map with a stateful and a stateless query that follow amendments, and one that does not."""
    world = World(database, f"map {uuid4()}")
    for name in ("plain", "as told"):
        world.run(
            "insert into semap.continuous_query (map_id, name, object_concept_id)"
            " select %s, %s, concept_id from semap.concept where name = 'Room'", world.map_id, name,
        )  # fmt: skip
    world.ask(question)
    world.run(
        "update semap.continuous_query set follows_amendments = %s where map_id = %s and name <> 'as told'",
        follows, world.map_id,
    )  # fmt: skip
    for number, (shape, band) in enumerate(rooms):
        world.add_room(f"r{number}", shape, band)
    world.run("update semap.source set jump_m = null where source_id = %s", world.source_id)
    return world


def known(world: World) -> dict[str, list[tuple]]:
    """What is known by the queries that follow amendments."""
    return {
        name: [row for row in world.rows(statement, world.map_id) if row[0] != "as told"]
        for name, statement in (("log", STANDING), ("past", PAST), ("held", HELD), ("waiting", WAITING))
    }


def send(world: World, tracker: Tracker, seed: int, reach_us: int, amends: bool) -> None:
    """States and amendments as they come, some states late by up to `reach_us`."""
    dice = random.Random(seed)
    ids = {name: world.add_track(name) for name in sorted({each.track for each in tracker.told})}
    coming: list[tuple[int, Told | Amendment]] = [
        (each.sample.stamp_us + dice.randint(0, reach_us), each) for each in tracker.told
    ]
    coming += [(each.found_us, each) for each in tracker.amendments if amends]
    for _, each in sorted(coming, key=lambda one: one[0]):
        if isinstance(each, Amendment):
            world.run(
                AMEND, ids[each.track], ids[each.other], each.kind, to_datetime(each.since_us),
                to_datetime(each.found_us),
            )  # fmt: skip
            if dice.random() < 0.5:
                world.correct()
        else:
            world.add_samples(ids[each.track], [each.sample])
    world.correct()


@QUICK
@given(
    question=asked,
    rooms=st.lists(st.tuples(st.sampled_from(SHAPES), st.sampled_from(BANDS)), min_size=1, max_size=2),
    reach_us=st.sampled_from([0, 0, 200 * SECOND_US]),
    seed=st.integers(0, 2**32),
)
def test_amended_tracks_have_the_relations_of_the_right_ones(
    database: str, question: Asked, rooms: list, reach_us: int, seed: int
) -> None:
    tracker = Tracker(random.Random(seed), 3, 14)
    right, healed, raw = (scene(database, question, rooms, follows) for follows in (False, True, True))
    try:
        for name, samples in tracker.truth().items():
            track_id = right.add_track(name)
            for sample in samples:
                right.add_samples(track_id, [sample])
        send(healed, tracker, seed, reach_us, amends=True)
        send(raw, tracker, seed, reach_us, amends=False)
        assert known(healed) == known(right)
        assert healed.rows(SAID, healed.map_id) == raw.rows(SAID, raw.map_id)
    finally:
        for world in (right, healed, raw):
            world.close()
