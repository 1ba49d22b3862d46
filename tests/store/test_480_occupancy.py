"""How many were in a room over time: as a plain count at every moment at which anything changes would have it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta
from statistics import median
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import box
from world import World

from semap.errors import InvalidInput
from semap.store.database.connection import open_engine
from semap.store.relation.occupancy import Unit, occupancy

BERLIN = ZoneInfo("Europe/Berlin")
FIRST = datetime(2026, 3, 28, tzinfo=BERLIN)  # the next day has 23 hours
Stay = tuple[int, int, int, int]
"""Track, query, and from which quarter of an hour until which."""

STAYS = st.lists(
    st.tuples(st.integers(0, 3), st.integers(0, 1), st.integers(-9, 300), st.integers(1, 40)).map(
        lambda drawn: (drawn[0], drawn[1], drawn[2], drawn[2] + drawn[3])
    ),
    max_size=30,
)


def quarter(number: int) -> datetime:
    return FIRST.astimezone(UTC) + timedelta(minutes=15 * number)


def inside(stays: Sequence[Stay], number: int) -> set[int]:
    """Who is in it in a quarter."""
    return {track for track, _, since, until in stays if since <= number < until}


@settings(max_examples=60, deadline=None)
@given(
    stays=STAYS, first=st.integers(0, 60), count=st.integers(1, 250), each=st.sampled_from(["hour", "day"])
)
def test_it_is_what_a_count_of_each_quarter_says(
    stays: list[Stay], first: int, count: int, each: Unit
) -> None:
    room, tracks = PLAY.store(stays)
    last = first + count
    with PLAY.engine.connect() as connection:
        found = occupancy(connection, room, quarter(first), quarter(last), each=each, zone="Europe/Berlin")
    bounds = [first, *(n for n in range(first + 1, last) if begins(each, quarter(n))), last]
    assert [span.since for span in found.spans] == [quarter(n) for n in bounds[:-1]]
    for span, since, until in zip(found.spans, bounds, bounds[1:], strict=False):
        counts = [len(inside(stays, n)) for n in range(since, until)]
        assert span.until == quarter(until)
        assert span.mean == pytest.approx(sum(counts) / len(counts))
        assert span.peak == max(counts)
        at = quarter(since + counts.index(max(counts))) if max(counts) else None
        assert span.peak_at == at
        assert span.tracks == len(set().union(*(inside(stays, n) for n in range(since, until))))
    lengths: dict[int, list[int]] = defaultdict(list)
    for n in range(first, last):
        for track in inside(stays, n):
            if n > first and track in inside(stays, n - 1):
                lengths[track][-1] += 900
            else:
                lengths[track].append(900)
    every = [length for each in lengths.values() for length in each]
    assert (found.stays, found.tracks, found.total_s) == (len(every), len(lengths), sum(every))
    assert found.median_s == (pytest.approx(median(every)) if every else None)
    assert found.longest_s == max(every, default=None)
    told = [(each.track_id, each.stays, each.total_s) for each in found.visitors]
    by_time = sorted(lengths, key=lambda track: (-sum(lengths[track]), tracks[track]))
    assert told == [(tracks[track], len(lengths[track]), sum(lengths[track])) for track in by_time]


def begins(each: Unit, moment: datetime) -> bool:
    local = moment.astimezone(BERLIN)
    return local.minute == 0 and (each == "hour" or local.hour == 0)


class Play:
    """A room whose stays are told anew for each example, in a world that the fixture below gives."""

    def begin(self, world: World) -> None:
        self.world = world
        self.engine = open_engine(world.dsn)
        world.add_room("room", box(0, 0, 4, 4))
        self.room = world.one("select instance_id from semap.instance where name = 'room'")
        self.tracks = [world.add_track(f"{n}") for n in range(4)]
        self.query = world.one("select query_id from semap.continuous_query where not in_pairs limit 1")

    def store(self, stays: Sequence[Stay]) -> tuple[int, list[int]]:
        self.world.run("delete from semap.relation_past")
        for track, query, since, until in stays:
            self.world.run(
                "insert into semap.relation_past (map_id, query_id, query_name, track_id, track_name, instance_id,"
                " instance_name, since, until) values (%s, %s, 'q', %s, 't', %s, 'room', %s, %s)",
                self.world.map_id, self.query + 1000 * query, self.tracks[track], self.room,
                quarter(since), quarter(until),
            )  # fmt: skip
        return self.room, self.tracks


PLAY = Play()


@pytest.fixture(autouse=True)
def _play(world: World) -> Iterator[None]:
    PLAY.begin(world)
    yield
    PLAY.engine.dispose()


def test_who_is_in_it_now_is_so_until_now(world: World) -> None:
    """Until what was seen last, where that is ahead of the clock, and no longer."""
    at = datetime.now(UTC).replace(microsecond=0) + timedelta(days=1)
    world.add_states([(PLAY.tracks[0], int(at.timestamp()) * 10**6, 1, 1, None)])
    world.add_states([(PLAY.tracks[1], int(at.timestamp() + 60) * 10**6, 9, 9, None)])
    with PLAY.engine.connect() as connection:
        found = occupancy(
            connection, PLAY.room, at - timedelta(hours=1), at + timedelta(hours=1), each="hour"
        )
        assert (found.total_s, found.spans[0].peak) == (60, 0 if at.minute + at.second else 1)
        before = occupancy(connection, PLAY.room, at - timedelta(days=3), at - timedelta(days=2), each="day")
        assert (before.stays, {each.peak for each in before.spans}) == (0, {0})


def test_a_zone_that_is_none_is_refused(world: World) -> None:
    with PLAY.engine.connect() as connection, pytest.raises(InvalidInput, match="Mars"):
        occupancy(connection, PLAY.room, quarter(0), quarter(9), each="day", zone="Mars/Olympus")


def test_only_the_stays_of_the_room_and_the_time_are_read(world: World) -> None:
    world.run("set enable_seqscan = off")
    plan = "\n".join(row[0] for row in world.rows(
        "explain select * from semap.stays_in(%s, %s, %s)", PLAY.room, quarter(0), quarter(9)))  # fmt: skip
    assert "relation_past_instance" in plan
