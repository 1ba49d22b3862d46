"""A map with one query about pairs: what happens to it is done in the database and told to the oracle."""

from __future__ import annotations

from dataclasses import fields, replace
from datetime import timedelta
from uuid import NAMESPACE_URL, UUID, uuid4, uuid5

import pytest
import shapely
from pair_oracle import Change, PairOracle, Question, Thing
from world import World

from semap.store.operate.doctor.verification import Verified, verify
from semap.timeline.stamp import to_datetime

ANY_HEIGHT = (float("-inf"), float("inf"))
CHOSEN = {"op": "=", "args": [{"property": "attributes.chosen"}, 1]}


class Town:
    """A map with one query about pairs, driven in the database and told to the oracle.

    Its sources say no watermark: all states before the newest stamp of each have come, and those at it where it is whole,
    which `settle` says. The oracle is told of a stamp once it is complete.
    """

    def __init__(self, database: str, asked: Question, name: str | None = None) -> None:
        self.world = World(database, name or f"map {uuid4()}")
        self.oracle = PairOracle(asked)
        self.tracks: dict[str, int] = {}
        self.last: dict[str, Thing] = {}
        self.heard: dict[str, int] = {}
        self.sources = [self.world.source_id, self.world.add_source("other")]
        self.source_of: dict[str, int] = {}
        self.newest_us = [-1, -1]
        self.waiting: list[tuple[Thing, bool]] = []
        self.through_us = -1
        self.query_id: int | None = None
        self.ask(asked)
        self.world.run("update semap.source set jump_m = null where map_id = %s", self.world.map_id)

    def close(self) -> None:
        self.world.close()

    def uid(self, name: str) -> UUID:
        return uuid5(NAMESPACE_URL, f"{self.world.name}/{name}")

    def ask(self, asked: Question) -> None:
        values: dict[str, object] = {}
        for each in fields(asked):
            value = getattr(asked, each.name)
            if each.name.startswith("chosen"):
                side = "subject" if each.name == "chosen_subjects" else "object"
                kind = getattr(asked, f"{side}_kind")
                values[f"{side}_where"] = self.world.keep_where(CHOSEN, kind) if value else None
            else:
                values[each.name] = timedelta(seconds=value) if each.name.endswith("confirm") else value
        if self.query_id is None:
            names = ", ".join(values)
            self.query_id = self.world.one(
                f"insert into semap.continuous_query (map_id, name, {names})"
                f" values (%s, 'pairs', {', '.join(['%s'] * len(values))}) returning query_id",
                self.world.map_id, *values.values(),
            )  # fmt: skip
        else:
            self.world.run(
                f"update semap.continuous_query set {', '.join(f'{name} = %s' for name in values)}"
                " where query_id = %s",
                *values.values(), self.query_id,
            )  # fmt: skip
            self.oracle.ask(asked)

    # what happens, in both

    def put(
        self, name: str, shape: shapely.Geometry, band: tuple[float, float] = ANY_HEIGHT,
        yaw_rad: float = 0.0, chosen: bool = True,
    ) -> None:  # fmt: skip
        """An instance is there, as this."""
        place = shapely.Point(*(round(value * 64) / 64 for value in shapely.centroid(shape).coords[0]))
        drawn = boundary_of(shape) if self.oracle.asked.abstraction == "Line" else shape
        low, high = (None if abs(z) == float("inf") else z for z in band)
        world, known = self.world, name in self.oracle.things
        if not known:
            turn = shapely.affinity.rotate(shapely.Point(1, 0), yaw_rad / 2, origin=(0, 0), use_radians=True)
            frame_id = world.one(
                "insert into semap.frame (map_id, name, parent_id) values (%s, %s, %s) returning frame_id",
                world.map_id, name, world.frame_id,
            )  # fmt: skip
            world.run(
                "insert into semap.frame_pose (frame_id, qz, qw) values (%s, %s, %s)",
                frame_id,
                turn.y,
                turn.x,
            )
            world.run(
                "insert into semap.instance (map_id, uid, name, concept_id, frame_id, attributes)"
                " select %s, %s, %s, concept_id, %s, jsonb_build_object('chosen', %s::integer)"
                " from semap.concept where name = 'Room'",
                world.map_id, self.uid(name), name, frame_id, int(chosen),
            )  # fmt: skip
            world.run(
                "insert into semap.abstraction (description_id, instance_id, type, geometry, z_min_m, z_max_m)"
                " select absolute_description_id, instance_id, t.type, t.geometry, %s, %s from semap.instance,"
                " (values (%s, %s::geometry), ('Position2D', %s)) t (type, geometry)"
                " where map_id = %s and name = %s",
                low, high, self.oracle.asked.abstraction, shapely.to_wkb(drawn, hex=True), shapely.to_wkb(place, hex=True),
                world.map_id, name,
            )  # fmt: skip
        else:
            world.run(
                "update semap.abstraction a set z_min_m = %s, z_max_m = %s,"
                " geometry = case when type = 'Position2D' then %s::geometry else %s end from semap.instance i"
                " where a.instance_id = i.instance_id and i.map_id = %s and i.name = %s",
                low, high, shapely.to_wkb(place, hex=True), shapely.to_wkb(drawn, hex=True), world.map_id, name,
            )  # fmt: skip
            yaw_rad, chosen = self.oracle.things[name].yaw_rad, self.oracle.things[name].chosen
        self.oracle.edit(
            name,
            Thing(name, self.uid(name), False, chosen, place.x, place.y, yaw_rad, shape=shape, band=band),
        )

    def remove(self, name: str) -> None:
        self.world.run("delete from semap.instance where map_id = %s and name = %s", self.world.map_id, name)
        self.oracle.edit(name, None)

    def choose(self, name: str, chosen: bool) -> None:
        """A track or an instance is described in another way."""
        table = "track" if name in self.tracks else "instance"
        self.world.run(
            f"update semap.{table} set attributes = jsonb_build_object('chosen', %s::integer)"
            " where map_id = %s and name = %s",
            int(chosen), self.world.map_id, name,
        )  # fmt: skip
        if table == "track":
            self.last[name] = replace(self.last[name], chosen=chosen)
        if name in self.oracle.things:
            self.oracle.edit(name, replace(self.oracle.things[name], chosen=chosen))

    def track(self, name: str, source: int = 0, chosen: bool = True) -> None:
        self.tracks[name] = self.world.one(
            "insert into semap.track (uid, source_id, map_id, name, attributes)"
            " values (%s, %s, %s, %s, jsonb_build_object('chosen', %s::integer)) returning track_id",
            self.uid(name), self.sources[source], self.world.map_id, name, int(chosen),
        )  # fmt: skip
        self.last[name] = Thing(name, self.uid(name), True, chosen)
        self.heard[name] = -1
        self.source_of[name] = source

    def see(self, *states: tuple[Thing, bool]) -> None:
        """States of tracks of one source, in one statement, in any order; the oracle is not told of the late ones."""
        statement = (
            "copy semap.track_state (track_id, stamp, x_m, y_m, z_m, heading_rad, length_m, width_m, is_last)"
            " from stdin"
        )
        with self.world.connection.cursor() as cursor, cursor.copy(statement) as copy:
            for thing, is_last in states:
                copy.write_row((self.tracks[thing.name], to_datetime(thing.stamp_us), thing.x_m, thing.y_m,
                                thing.z_m, thing.yaw_rad, thing.length_m, thing.width_m, is_last))  # fmt: skip
        for thing, is_last in states:
            if thing.stamp_us > self.through_us:
                self.waiting.append((thing, is_last))
            if thing.stamp_us > self.heard[thing.name]:
                self.heard[thing.name], self.last[thing.name] = thing.stamp_us, thing
            source = self.source_of[thing.name]
            self.newest_us[source] = max(self.newest_us[source], thing.stamp_us)
        self._release([newest_us - 1 for newest_us in self.newest_us])

    def settle(self) -> None:
        """All sources have given all that they have, and what came late is corrected."""
        self.world.correct()
        if not self.tracks or max(self.newest_us) < 0:
            return
        self.world.run(
            "update semap.source set newest_is_whole = true, newest_stamp = greatest(newest_stamp, %s) where map_id = %s",
            to_datetime(max(self.newest_us)), self.world.map_id,
        )  # fmt: skip
        self.newest_us = [max(self.newest_us)] * 2
        self._release(self.newest_us)

    def _release(self, complete_us: list[int]) -> None:
        through_us = min(complete_us[self.source_of[name]] for name in self.tracks)
        self.through_us = max(self.through_us, through_us)
        due = [state for state in self.waiting if state[0].stamp_us <= self.through_us]
        self.waiting = [state for state in self.waiting if state[0].stamp_us > self.through_us]
        self.oracle.states(
            (replace(thing, chosen=self.last[thing.name].chosen), is_last) for thing, is_last in due
        )

    def end(self, name: str, stamp_us: int) -> None:
        self.world.end_track(self.tracks[name], stamp_us)
        stamp_us = self.heard[name] = max(stamp_us, self.heard[name])
        if stamp_us <= self.through_us:
            self.oracle.end(name, stamp_us)
        else:
            self.waiting.append((replace(self.last[name], x_m=None, stamp_us=stamp_us), True))
        source = self.source_of[name]
        self.newest_us[source] = max(self.newest_us[source], stamp_us)
        self._release([newest_us - 1 for newest_us in self.newest_us])

    def forget(self, name: str) -> None:
        self.world.run("delete from semap.track where track_id = %s", self.tracks.pop(name))
        self.oracle.delete_track(name)
        self.waiting = [state for state in self.waiting if state[0].name != name]

    # what came of it

    def log(self) -> list[Change]:
        self.settle()
        return [
            Change(*row)
            for row in self.world.rows(
                "select kind::text, cause::text, coalesce(track_name, subject_instance_name),"
                " coalesce(instance_name, object_track_name), (extract(epoch from stamp) * 1000000)::bigint,"
                " (extract(epoch from transition_at) * 1000000)::bigint, (extract(epoch from since) * 1000000)::bigint,"
                " x_m, y_m, direction from semap.relation_change where query_id = %s order by change_id",
                self.query_id,
            )
        ]

    def held(self) -> set[tuple[str, str, int]]:
        self.settle()
        return {
            (subject, object_, since)
            for subject, object_, since in self.world.rows(
                "select coalesce(s.name, si.name), coalesce(o.name, oi.name), (extract(epoch from h.since) * 1000000)::bigint"
                " from semap.relation_held h"
                " left join semap.track s on s.track_id = h.track_id"
                " left join semap.instance si on si.instance_id = h.subject_instance_id"
                " left join semap.track o on o.track_id = h.object_track_id"
                " left join semap.instance oi on oi.instance_id = h.instance_id where h.query_id = %s",
                self.query_id,
            )
        }

    def differences(self) -> list[Verified]:
        """What `semap doctor --verify` finds wrong with the map."""
        self.settle()
        verification = verify(self.world.dsn, lambda said: None)
        with verification.connection:
            return [each for each in verification.look(self.world.name) if each.differ]

    def check(self) -> None:
        wanted, found = self.oracle.log, self.log()
        by_clock = "track" not in (self.oracle.asked.subject_kind, self.oracle.asked.object_kind)
        plain = [(each.kind, each.cause, each.subject, each.object, each.direction) for each in found]
        assert plain == [(e.kind, e.cause, e.subject, e.object, e.direction) for e in wanted]
        held = {(key, pair.since_us) for key, pair in self.oracle.pairs.items() if pair.held}
        assert {each[:2] for each in self.held()} == {key for key, _ in held}
        if by_clock:
            return
        assert [each.stamp_us for each in found] == [each.stamp_us for each in wanted]
        for name in ("edge_us", "since_us"):
            times = [getattr(each, name) for each in wanted]
            assert [getattr(each, name) for each in found] == pytest.approx(times, abs=2)
        places = [(each.x_m or 0, each.y_m or 0) for each in wanted]
        assert [each.x_m or 0 for each in found] == pytest.approx([x for x, _ in places], abs=1e-9)
        assert [each.y_m or 0 for each in found] == pytest.approx([y for _, y in places], abs=1e-9)
        assert self.held() == {(*key, round(since)) for key, since in held}


def boundary_of(shape: shapely.Geometry) -> shapely.Geometry:
    """The lines of an area with its inside on the left."""
    if shape.geom_type == "LineString":
        return shape
    return shapely.boundary(shapely.orient_polygons(shape))
