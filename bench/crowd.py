"""A floor of rooms and a crowd that moves on it: the load of the benchmarks, the same at every run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import psycopg
import shapely
from numpy.typing import NDArray
from semap_ingest.state_copy import pack_states
from semap_ingest.track_batch import pack_batch

ROOM_X_M, ROOM_Y_M = 5.0, 4.0
SPEED_MPS = 1.4
RATE_HZ = 15.0


@dataclass(frozen=True)
class Floor:
    """Rooms side by side, each with a corner cut out (concave)."""

    columns: int
    rows: int

    def rooms(self) -> list[shapely.Polygon]:
        outline = np.array([(0, 0), (5, 0), (5, 3), (4, 3), (4, 4), (0, 4)], dtype=np.float64)
        return [
            shapely.Polygon(outline + np.array([column * ROOM_X_M, row * ROOM_Y_M]))
            for row in range(self.rows)
            for column in range(self.columns)
        ]

    def size_m(self) -> NDArray[np.float64]:
        return np.array([self.columns * ROOM_X_M, self.rows * ROOM_Y_M])


def walk(floor: Floor, tracks: int, frames: int, pause_s: float, seed: int = 1) -> NDArray[np.float64]:
    """Positions of people who walk to a place up to two rooms away, pause, and walk on.

    pause_s  the longest pause; pauses are uniform from 0
    returns  (frames, tracks, 2) [m]
    """
    dice = np.random.default_rng(seed)
    size = floor.size_m()
    place = dice.uniform(0, 1, (tracks, 2)) * size
    goal = place.copy()
    rest = dice.uniform(0, pause_s, tracks)
    places = np.empty((frames, tracks, 2))
    for frame in range(frames):
        way = goal - place
        left = np.hypot(*way.T)
        step = SPEED_MPS / RATE_HZ
        arrived = left <= step
        rest[arrived] -= 1 / RATE_HZ
        place = np.where(arrived[:, None], goal, place + way * (step / np.maximum(left, step))[:, None])
        leaves = arrived & (rest <= 0)
        goal[leaves] = np.clip(place + dice.normal(0, 4, (tracks, 2)), 0.01, size - 0.01)[leaves]
        rest[leaves] = dice.uniform(0, pause_s, tracks)[leaves]
        places[frame] = place
    return places


def frame_stamps(frames: int, first_us: int) -> NDArray[np.int64]:
    """(frames,) [us]"""
    return first_us + np.rint(np.arange(frames) * 1e6 / RATE_HZ).astype(np.int64)


def batches(track_ids: NDArray[np.int64], places: NDArray[np.float64], first_us: int) -> list[bytes]:
    """One COPY a frame, of one state of every track."""
    tracks = len(track_ids)
    return [
        pack_states(
            track_ids, np.full(tracks, stamp_us), x_m, y_m,
            np.full(tracks, 1.0), np.full(tracks, 0.05), np.zeros(tracks, dtype=np.bool_),
        )
        for stamp_us, (x_m, y_m) in zip(
            frame_stamps(len(places), first_us), places.transpose(0, 2, 1), strict=True
        )
    ]  # fmt: skip


def framed(
    source_id: int, track_ids: NDArray[np.int64], places: NDArray[np.float64], first_us: int
) -> list[Sequence[object]]:
    """The same states, as track batches."""
    tracks = len(track_ids)
    return [
        pack_batch(
            source_id, stamp_us, track_ids, x_m, y_m, np.full(tracks, 1.0), std_m=np.full(tracks, 0.05)
        )
        for stamp_us, (x_m, y_m) in zip(
            frame_stamps(len(places), first_us).tolist(), places.transpose(0, 2, 1), strict=True
        )
    ]


def source_of(connection: psycopg.Connection, track_ids: NDArray[np.int64]) -> int:
    row = connection.execute(
        "select source_id from semap.track where track_id = %s", [int(track_ids[0])]
    ).fetchone()
    return int(row[0]) if row else 0


@dataclass(frozen=True)
class Crowd:
    """Where everybody is in each frame, and the rooms that they may be in.

    track_ids  (tracks,)
    places     (frames, tracks, 2) [m]
    first_us   the stamp of the first frame [us]
    """

    rooms: Sequence[shapely.Polygon]
    track_ids: NDArray[np.int64]
    places: NDArray[np.float64]
    first_us: int

    @cached_property
    def stamps_us(self) -> NDArray[np.int64]:
        """(frames,) [us]"""
        return frame_stamps(len(self.places), self.first_us)

    @cached_property
    def batches(self) -> list[bytes]:
        """One COPY a frame, of one state of every track."""
        return batches(self.track_ids, self.places, self.first_us)

    def frames(self, connection: psycopg.Connection) -> list[Sequence[object]]:
        """The same as track batches."""
        return framed(source_of(connection, self.track_ids), self.track_ids, self.places, self.first_us)


def build_map(
    connection: psycopg.Connection,
    name: str,
    rooms: Sequence[shapely.Polygon],
    tracks: int,
    per_source: int | None = None,
) -> tuple[int, NDArray[np.int64]]:
    """A map of rooms with its query and rule, and tracks; its id and the tracks' ids.

    per_source  so many tracks are of one source, the next as many of another; None: all are of one
    """
    map_id = import_rooms(connection, name, rooms)
    return map_id, add_tracks(connection, map_id, tracks, per_source or tracks)


def import_rooms(connection: psycopg.Connection, name: str, rooms: Sequence[shapely.Polygon]) -> int:
    """A map of rooms with its query and rule; its id."""
    from uuid import uuid4  # noqa: PLC0415

    from semap.model.building import Building, HeightBand, Item  # noqa: PLC0415
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.building import import_building  # noqa: PLC0415
    from semap.store.map.maps import create_map  # noqa: PLC0415

    items = tuple(
        Item(uid=uuid4(), name=f"room {i}", concept="Room", footprint=room, band=HeightBand(0, 3))
        for i, room in enumerate(rooms)
    )
    with one_transaction(connection.info.dsn) as c:
        map_id = create_map(c, name).map_id
        import_building(c, name, Building((), items))
    return map_id


def add_tracks(
    connection: psycopg.Connection, map_id: int, tracks: int, per_source: int
) -> NDArray[np.int64]:
    """Tracks of as many sources as it takes; their ids, in the order of their sources."""
    connection.execute(
        "insert into semap.source (map_id, name)"
        " select %s, case when n = 1 then 'crowd' else 'crowd ' || n end from generate_series(1, %s) n",
        [map_id, -(-tracks // per_source)],
    )
    connection.execute(
        "insert into semap.track (uid, source_id, map_id, name)"
        " select gen_random_uuid(), s.ids[(n - 1) / %s + 1], %s, 'track ' || n"
        " from (select array_agg(source_id order by source_id) as ids from semap.source where map_id = %s) s,"
        "      generate_series(1, %s) n order by n",
        [per_source, map_id, map_id, tracks],
    )
    ids = connection.execute(
        "select track_id from semap.track where map_id = %s order by 1", [map_id]
    ).fetchall()
    return np.array([track_id for (track_id,) in ids], dtype=np.int64)
