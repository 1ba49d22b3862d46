"""Looking back over a long history: a map at a moment, a track over an hour, pages of features.

Fifty tracks are seen ten times a second for some hours, each a minute in one room after the other. What they
leave is written as it would lie there, past the triggers, which have benchmarks of their own.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta

import numpy as np
from sqlalchemy import Connection, text

from bench import operators
from bench.figure import percentiles, timed_ms
from semap.store.database.connection import connect, open_engine
from semap.store.features.collection import get_collection
from semap.store.features.page import Box, Cursor, SortKey, Wanted, read_page
from semap.store.features.placing import CRS84, MAP_FRAME, placing_of
from semap.store.map.maps import create_map
from semap.store.motion import moment, track_history

TRACKS = 50
HOURS = 4
ROOMS = 30
ROUNDS = 5
QUESTIONS = 50
START = datetime(2026, 1, 31, 22, tzinfo=UTC)

DAYS = "select semap.ensure_partitions(array(select generate_series(%s::date, %s::date, '1 day')::date))"
ROOM = "select sum(pg_total_relation_size(relid)) from pg_partition_tree('semap.state_chunk') where isleaf"
LEAVE = (
    """
    insert into semap.source (map_id, name) select map_id, 'tracker' from semap.map where name = 'history'
    """,
    """
    insert into semap.track (uid, source_id, map_id, name)
    select gen_random_uuid(), s.source_id, s.map_id, 'person ' || n
    from semap.source s cross join generate_series(1, %(tracks)s::int) n
    """,
    """
    insert into semap.state_chunk (
      source_id, from_stamp, to_stamp, states, track_ids, x_m, y_m, heading_rad, speed_mps)
    select t.source_id, a.stamp, a.stamp, count(*), array_agg(t.track_id),
           array_agg(mod(tick / 600 + t.track_id, %(rooms)s) * 5 + mod(tick, 50) / 10.0),
           array_agg(mod(t.track_id, 5)), array_agg(0::real), array_agg(1::real)
    from generate_series(0, %(ticks)s::bigint - 1) tick cross join semap.track t
    cross join lateral (select %(start)s::timestamptz + tick * interval '0.1 s' as stamp) a
    group by t.source_id, a.stamp
    """,
    """
    insert into semap.relation_change (uid, map_id, query_id, query_name, track_id, track_name,
                                       instance_id, instance_name, kind, cause, stamp, since)
    select gen_random_uuid(), t.map_id, 1, 'track_in_room', t.track_id, t.name,
           mod(minute + t.track_id, %(rooms)s), 'room', k.kind::semap.change_kind, 'moved',
           %(start)s::timestamptz + (minute + (k.kind = 'ended')::int) * interval '1 min',
           %(start)s::timestamptz + minute * interval '1 min'
    from generate_series(0, %(ticks)s::bigint / 600 - 1) minute cross join semap.track t
    cross join (values ('began'), ('ended')) k (kind)
    """,
    "update semap.track_now set live = true, first_stamp = %(start)s, stamp = %(end)s, x_m = 0, y_m = 0",
)


def measure(dsn: str, hours: float = HOURS, things: int = operators.THINGS) -> list[dict[str, object]]:
    """One row for each question: times [ms]."""
    states, room = leave(dsn, hours)
    operators.build(dsn, things)
    dice = np.random.default_rng(1)
    engine = open_engine(dsn, "semap_read")
    rows: list[dict[str, object]] = [
        {"question": f"states of {TRACKS} tracks, {room} bytes each", "rows": states}
    ]
    with engine.connect() as connection:
        questions = {**_looking_back(connection, dice, hours), **_pages(connection, dice)}
        rows += [{"question": name, **_timed(ask)} for name, ask in questions.items()]
    engine.dispose()
    return rows


def leave(dsn: str, hours: float) -> tuple[int, int]:
    """A history of so many hours; how many states it has, and the room of one [bytes]."""
    ticks = int(hours * 36_000)
    end = START + timedelta(hours=hours)
    values = {"tracks": TRACKS, "start": START, "end": end, "ticks": ticks, "rooms": ROOMS}
    engine = open_engine(dsn)
    with engine.begin() as made:
        create_map(made, "history")
    engine.dispose()
    with connect(dsn) as connection:
        connection.execute(DAYS, [START, end])
        for n, statement in enumerate(LEAVE):
            connection.execute(f"set session_replication_role = {'replica' if n > 1 else 'origin'}")
            connection.execute(statement, values if "%(" in statement else None)
        connection.execute("set session_replication_role = origin")
        connection.execute("select semap.compact_all(array(select source_id from semap.source))")
        connection.execute("vacuum full semap.state_chunk")
        connection.execute("vacuum analyze semap.state_chunk, semap.relation_change, semap.track")
        (room,) = connection.execute(ROOM).fetchone() or (0,)
    return ticks * TRACKS, round(room / (ticks * TRACKS))


def _looking_back(
    connection: Connection, dice: np.random.Generator, hours: float
) -> dict[str, Callable[[], object]]:
    track_ids = connection.scalars(text("select track_id from semap.track")).all()

    def some() -> datetime:
        return START + timedelta(hours=float(dice.uniform(0.01, hours - 1)))

    def hour_of_a_track() -> object:
        start = some()
        end = start + timedelta(hours=1)
        return track_history.history(
            connection, int(dice.choice(track_ids)), start, end, after=start, limit=1000
        )

    def stays() -> object:
        start = some()
        return moment.stays(connection, "history", start, start + timedelta(minutes=10), 1000)

    return {
        "moment, trails of 10 s": lambda: moment.moment(connection, "history", some()),
        "moment, no trails": lambda: moment.moment(connection, "history", some(), trail_s=0, within_s=1),
        "1000 states of a track": hour_of_a_track,
        "stays of 10 minutes": stays,
        "extent in time": lambda: moment.extent(connection, "history"),
    }


def _pages(connection: Connection, dice: np.random.Generator) -> dict[str, Callable[[], object]]:
    collection = get_collection(connection, "many things.Thing")
    placing = placing_of(connection, collection.map_id, collection.map)

    def page(wanted: Wanted, **more: object) -> Callable[[], object]:
        return lambda: read_page(connection, collection, placing, wanted, limit=100, **more)  # type: ignore[arg-type]

    def box() -> object:
        x, y = (float(each) for each in dice.uniform(0, 390, 2))
        return page(Wanted(boxes=(Box((x, y, x + 10, y + 10)),), box_system=MAP_FRAME))()

    return {
        "first 100 features": page(Wanted()),
        "100 features, from the middle by cursor": page(Wanted(), cursor=Cursor(("50000",))),
        "100 features, from the middle by offset": page(Wanted(), offset=50_000),
        "100 features by name": page(Wanted(sort=(SortKey("name"),))),
        "100 features of a box": box,
        "100 features, map frame": page(Wanted(system=MAP_FRAME)),
        "100 features, CRS84": page(Wanted(system=CRS84)),
    }


def _timed(ask: Callable[[], object]) -> dict[str, object]:
    return dict(percentiles([[timed_ms(ask) for _ in range(QUESTIONS)] for _ in range(ROUNDS)]))
