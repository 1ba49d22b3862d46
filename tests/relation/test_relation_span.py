"""Who was related to what: history as one view, and what held at a moment, against plain comparisons."""

from __future__ import annotations

import random
from dataclasses import dataclass
from datetime import timedelta

import pytest
import shapely
from made_relations import KINDS, Thing, at, hold, pair_query, past
from world import SECOND_US, World

from semap.store.database import one_transaction
from semap.store.relation_spans import Chosen, list_spans
from semap.store.relations import START, Wanted, list_relations


@dataclass(frozen=True)
class Span:
    query: str
    subject: Thing
    object: Thing
    since_s: float
    until_s: float | None

    def held_at(self, moment_s: float) -> bool:
        return self.since_s <= moment_s and (self.until_s is None or moment_s < self.until_s)

    def row(self) -> tuple:
        until = None if self.until_s is None else at(self.until_s)
        return self.query, self.subject[2], self.object[2], at(self.since_s), until


@pytest.fixture
def spans(world: World) -> list[Span]:
    """Of all kinds of pairs, over and holding, some of no length; and tracks in rooms, which the triggers noted."""
    dice = random.Random(7)
    rooms = [world.add_room(f"room {n}", shapely.box(9 * n, 0, 9 * n + 8, 8)) for n in range(3)]
    tracks = [world.add_track(f"track {n}") for n in range(4)]
    things: dict[str, list[Thing]] = {
        "track": [("track", number, f"track {n}") for n, number in enumerate(tracks)],
        "instance": [("instance", number, f"room {n}") for n, number in enumerate(rooms)],
    }
    found = []
    for subject, object_ in KINDS:
        name = f"{subject} {object_}"
        query_id = pair_query(world, name, subject, object_)
        for a in things[subject]:
            for b in things[object_]:
                if a == b:
                    continue
                for _ in range(6):
                    since_s = dice.randrange(100)
                    until_s = since_s + dice.choice([0, 0.5, 3, 20])
                    past(world, query_id, name, a, b, since_s, until_s)
                    found.append(Span(name, a, b, since_s, until_s))
                if dice.random() < 0.6:
                    since_s = dice.randrange(100)
                    hold(world, query_id, a, b, since_s)
                    found.append(Span(name, a, b, since_s, None))
    for second, room in enumerate([0, 1, 2, 0]):
        world.add_states([(tracks[0], second * 10 * SECOND_US, 9.0 * room + 4, 4.0, None)])
        track, thing = things["track"][0], things["instance"][room]
        until_s = 10.0 * second + 10 if second < 3 else None
        found.append(Span("track_in_room", track, thing, 10 * second, until_s))
    return found


def test_all_of_it_is_one_view(world: World, spans: list[Span]) -> None:
    rows = world.rows("select query, subject, object, since, until, duration from semap.relation_span")
    assert sorted(map(str, rows)) == sorted(
        str((*row, None if row[4] is None else row[4] - row[3])) for row in (span.row() for span in spans)
    )
    now = world.rows("select query, subject, object, since, null from semap.relation_now")
    assert sorted(map(str, now)) == sorted(str(span.row()) for span in spans if span.until_s is None)
    held = world.one("select count(*) from semap.relation_held")
    assert held == len(now)


def test_what_held_at_a_moment(world: World, spans: list[Span]) -> None:
    for moment_s in (-1, 0, 5, 10, 33.25, 50, 99, 200):
        wanted = sorted(str(span.row()) for span in spans if span.held_at(moment_s))
        found = world.rows(
            "select query, subject, object, since, until from semap.relations_as_of(%s)", at(moment_s)
        )
        assert sorted(map(str, found)) == wanted
        assert sorted(map(str, listed(world, at(moment_s)))) == wanted
    assert sorted(map(str, listed(world, None))) == sorted(
        str(span.row()) for span in spans if span.until_s is None
    )


def listed(world: World, as_of: object, wanted: Wanted = Wanted()) -> list[tuple]:  # noqa: B008
    """As the service pages through it, seven at a time."""
    found: list[tuple] = []
    after = START
    with one_transaction(world.dsn) as connection:
        while True:
            page = list_relations(connection, wanted, as_of=as_of, after=after, limit=7)  # type: ignore[arg-type]
            for each in page:
                subject, object_ = each.track or each.subject_instance, each.instance or each.object_track
                found.append((each.query, subject, object_, each.since, each.until))
            if len(page) < 7:
                return found
            after = page[-1].place


def test_a_track_an_instance_or_a_query_of_them(world: World, spans: list[Span]) -> None:
    def held(**wanted: str) -> list[str]:
        return sorted(map(str, listed(world, at(33), Wanted(**wanted))))

    def expected(query: str | None = None, name: str | None = None) -> list[str]:
        return sorted(
            str(span.row())
            for span in spans
            if span.held_at(33)
            and query in (None, span.query)
            and name in (None, span.subject[2], span.object[2])
        )

    assert held(track="track 1") == expected(name="track 1") != []
    assert held(instance="room 2") == expected(name="room 2") != []
    assert held(query="track track") == expected("track track") != []
    assert held(query="track track", track="track 0") == expected("track track", "track 0") != []
    assert held(map="world") == expected()
    assert held(map="elsewhere") == []


def test_what_held_between_two_moments(world: World, spans: list[Span]) -> None:
    for start_s, end_s in ((-1, None), (10, 20), (None, 3), (95, None), (20, 20.5)):
        start, end = (None if each is None else at(each) for each in (start_s, end_s))
        with one_transaction(world.dsn) as connection:
            rows = [tuple(row.values()) for row in list_spans(connection, Chosen(start=start, end=end))]
        wanted = [
            span.row()
            for span in spans
            if (end_s is None or span.since_s < end_s)
            and (start_s is None or span.until_s is None or span.until_s > start_s)
        ]
        assert sorted(str(row[1:6]) for row in rows) == sorted(map(str, wanted))


def test_a_moment_is_looked_up_in_the_index(world: World) -> None:
    room, track = world.add_room("room", shapely.box(0, 0, 1, 1)), world.add_track("t")
    world.run(
        "insert into semap.relation_past (map_id, query_id, query_name, track_id, track_name, instance_id,"
        " instance_name, since, until) select %s, %s, 'track_in_room', %s, 't', %s, 'room',"
        " %s::timestamptz + n * interval '2 s', %s::timestamptz + n * interval '2 s' + interval '1 s'"
        " from generate_series(1, 20000) n",
        world.map_id, world.query_id, track, room, at(0), at(0),
    )  # fmt: skip
    world.run("analyze semap.relation_past")
    moment = at(20_000) + timedelta(seconds=0.5)
    plan = "\n".join(row for (row,) in world.rows("explain select * from semap.relations_as_of(%s)", moment))
    assert "relation_past_stay" in plan
    assert len(world.rows("select from semap.relations_as_of(%s)", moment)) == 1
