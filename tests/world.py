"""A map, tracks and their states, written by plain SQL: for tests below the store."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from datetime import timedelta
from uuid import NAMESPACE_URL, uuid5

import psycopg
import shapely
from stateful_oracle import Asked, Sample

from semap.model.predicate import Kind
from semap.store.database.connection import connect
from semap.store.relation.conditions import compiled
from semap.timeline.stamp import to_datetime

SECOND_US = 1_000_000
INTERVALS = ("enter_confirm", "leave_confirm", "longest_gap")

State = tuple[int, int, float, float, float | None] | tuple[int, int, float, float, float | None, bool]


def keep_where(
    connection: psycopg.Connection, map_id: int, where: Mapping[str, object], kind: Kind = "track"
) -> str:
    """A condition as a plain statement may then store it."""
    made = compiled(where, kind)
    connection.execute(
        "select semap.keep_condition(%s, %s, %s, %s, %s)",
        [map_id, kind, json.dumps(where), made.sql, list(made.said)],
    )
    return json.dumps(where)


@dataclass
class World:
    """One map with the query track_in_room and the rule room_visits, and one source of tracks."""

    dsn: str
    name: str = "world"
    connection: psycopg.Connection = field(init=False)

    def __post_init__(self) -> None:
        self.connection = connect(self.dsn)
        uid = uuid5(NAMESPACE_URL, self.name)
        self.map_id = self.one(
            "insert into semap.map (name, uid) values (%s, %s) returning map_id", self.name, uid
        )
        self.frame_id = self.one(
            "insert into semap.frame (map_id, name) values (%s, 'map') returning frame_id", self.map_id
        )
        self.run("insert into semap.frame_pose (frame_id) values (%s)", self.frame_id)
        self.query_id = self.one(
            "insert into semap.continuous_query (map_id, name, object_concept_id)"
            " select %s, 'track_in_room', concept_id from semap.concept where name = 'Room'"
            " returning query_id",
            self.map_id,
        )
        declaration = {"input": "track_in_room", "emit": {"began": "entered", "ended": "left"}}
        self.rule_id = self.one(
            "insert into semap.rule (map_id, name, queries, declaration)"
            " values (%s, 'room_visits', jsonb_build_object('track_in_room', %s::int), %s) returning rule_id",
            self.map_id,
            self.query_id,
            json.dumps(declaration),
        )
        self.source_id = self.add_source("tracker")

    def run(self, statement: str, *parameters: object) -> None:
        self.connection.execute(statement, parameters)

    def one(self, statement: str, *parameters: object):
        return self.connection.execute(statement, parameters).fetchone()[0]

    def rows(self, statement: str, *parameters: object) -> list[tuple]:
        return self.connection.execute(statement, parameters).fetchall()

    def add_source(self, name: str) -> int:
        return self.one(
            "insert into semap.source (map_id, name) values (%s, %s) returning source_id", self.map_id, name
        )

    def add_room(
        self, name: str, footprint: shapely.Geometry, band: tuple[float, float] | None = None
    ) -> int:
        description_id = self.one(
            "insert into semap.description (map_id) values (%s) returning description_id", self.map_id
        )
        instance_id = self.one(
            "insert into semap.instance (map_id, uid, name, concept_id, frame_id, absolute_description_id)"
            " select %s, %s, %s, concept_id, %s, %s from semap.concept where name = 'Room'"
            " returning instance_id",
            self.map_id,
            uuid5(NAMESPACE_URL, name),
            name,
            self.frame_id,
            description_id,
        )
        low, high = band or (None, None)
        self.run(
            "insert into semap.abstraction (description_id, instance_id, type, geometry, z_min_m, z_max_m)"
            " values (%s, %s, 'Footprint', %s, %s, %s)",
            description_id,
            instance_id,
            shapely.to_wkb(footprint, hex=True),
            low,
            high,
        )
        return instance_id

    def edit_room(
        self, name: str, footprint: shapely.Geometry, band: tuple[float, float] | None = None
    ) -> None:
        low, high = band or (None, None)
        self.run(
            "update semap.abstraction a set geometry = %s, z_min_m = %s, z_max_m = %s from semap.instance i"
            " where i.map_id = %s and i.name = %s and a.description_id = i.absolute_description_id",
            shapely.to_wkb(footprint, hex=True),
            low,
            high,
            self.map_id,
            name,
        )

    def delete_room(self, name: str) -> None:
        self.run("delete from semap.instance where map_id = %s and name = %s", self.map_id, name)

    def add_track(self, name: str, source_id: int | None = None) -> int:
        return self.one(
            "insert into semap.track (uid, source_id, map_id, name) values (%s, %s, %s, %s)"
            " returning track_id",
            uuid5(NAMESPACE_URL, f"{self.name}/{name}"),
            source_id or self.source_id,
            self.map_id,
            name,
        )

    def end_track(self, track_id: int, stamp_us: int) -> None:
        self.run("update semap.track set ended_at = %s where track_id = %s", to_datetime(stamp_us), track_id)

    def ask(self, asked: Asked) -> None:
        """Let the query track_in_room ask this instead."""
        values = {
            each.name: timedelta(seconds=value) if each.name in INTERVALS else value
            for each in fields(asked)
            if (value := getattr(asked, each.name)) is not None
        }
        columns = ", ".join(f"{name} = %s" for name in values)
        self.run(
            f"update semap.continuous_query set {columns} where query_id = %s",
            *values.values(),
            self.query_id,
        )

    def keep_where(self, where: Mapping[str, object], kind: Kind = "track") -> str:
        return keep_where(self.connection, self.map_id, where, kind)

    def source_of(self, track_id: int) -> int:
        return self.one("select source_id from semap.track where track_id = %s", track_id)

    def say(self, source_id: int, stamp_us: int) -> None:
        """A source has given all its states up to here."""
        self.run(
            "update semap.source set watermark = greatest(watermark, %s) where source_id = %s",
            to_datetime(stamp_us),
            source_id,
        )

    def add_samples(self, track_id: int, samples: Sequence[Sample]) -> None:
        """States of one track in one statement, with how exact each is."""
        statement = (
            "copy semap.track_state (track_id, stamp, x_m, y_m, z_m, std_m, is_last, std_across_m, std_yaw_rad)"
            " from stdin"
        )
        with self.connection.cursor() as cursor, cursor.copy(statement) as copy:
            for each in samples:
                copy.write_row((track_id, to_datetime(each.stamp_us), each.x_m, each.y_m, each.z_m,
                                each.std_m, each.is_last, each.std_across_m, each.std_yaw_rad))  # fmt: skip
        self.correct()
        if samples:
            self.say(self.source_of(track_id), max(each.stamp_us for each in samples))

    def correct(self) -> None:
        """What came late is corrected, as the worker does it."""
        self.run("select semap.correct_all()")

    def add_states(self, states: Sequence[State]) -> None:
        """States in one statement, after which their source has given all up to the newest of them."""
        self.copy_states(states)
        if states:
            self.say(self.source_of(states[0][0]), max(stamp_us for _, stamp_us, *_ in states))

    def copy_states(self, states: Sequence[State]) -> None:
        """Rows of track id, stamp [us], x, y, z [m] and maybe whether it is the last, in one statement."""
        statement = "copy semap.track_state (track_id, stamp, x_m, y_m, z_m, is_last) from stdin"
        with self.connection.cursor() as cursor, cursor.copy(statement) as copy:
            for track_id, stamp_us, x_m, y_m, z_m, *is_last in states:
                copy.write_row((track_id, to_datetime(stamp_us), x_m, y_m, z_m, is_last == [True]))
        self.correct()

    def complete(self, source_id: int) -> None:
        """A source that says no watermark has given all states of its newest stamp."""
        self.run("update semap.source set newest_is_whole = true where source_id = %s", source_id)

    def add_batch(self, states: Sequence[State], source_id: int | None = None) -> None:
        """A track batch, after which its source has given all up to it."""
        self.send_batch(states, source_id)
        self.say(source_id or self.source_id, states[0][1])

    def send_batch(self, states: Sequence[State], source_id: int | None = None) -> None:
        """Track id, stamp [us], x, y, z [m] of all tracks of a source at one stamp, as a track batch."""
        (stamp_us,) = {stamp_us for _, stamp_us, *_ in states}
        track_ids, xs_m, ys_m, zs_m = zip(
            *((each[0], *each[2:5]) for each in sorted(states, key=lambda state: state[0])), strict=True
        )
        self.run(
            "select semap.add_states(%s, %s, %s, %s, %s, %s)",
            source_id or self.source_id,
            to_datetime(stamp_us),
            list(track_ids),
            [float(x_m) for x_m in xs_m],
            [float(y_m) for y_m in ys_m],
            None if set(zs_m) == {None} else [None if z_m is None else float(z_m) for z_m in zs_m],
        )
        self.correct()

    def changes(self) -> list[tuple[str, str, str, str, int]]:
        """Track, room, kind, cause and stamp [us] of every change, as they were written."""
        return [
            (track, room, kind, cause, int(stamp_us))
            for track, room, kind, cause, stamp_us in self.rows(
                "select track_name, instance_name, kind::text, cause::text,"
                " extract(epoch from stamp) * 1000000 from semap.relation_change"
                " where map_id = %s order by change_id",
                self.map_id,
            )
        ]

    def relations(self) -> set[tuple[str, str, int]]:
        """Track, room and since [us] of every relation that holds."""
        return {
            (track, room, int(since_us))
            for track, room, since_us in self.rows(
                "select track, instance, extract(epoch from since) * 1000000 from semap.relation_now"
                " where map_id = %s",
                self.map_id,
            )
        }

    def close(self) -> None:
        self.connection.close()
