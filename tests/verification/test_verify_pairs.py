"""`semap doctor --verify` about pairs: whatever is broken by hand is named, and mended by a repair."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import replace

import pytest
import shapely
from pair_oracle import Question
from pair_town import Town
from server import database_with_slot, fresh_database
from world import SECOND_US, World

from semap.cluster import Cluster
from semap.store.database.connection import connect
from semap.store.operate.doctor.verification import verify

WIDE = shapely.box(0, 0, 4, 4)
QUESTIONS = {
    "near": Question("within_distance", distance_m=2.5),
    "with margins": Question("within_distance", distance_m=2.5, enter_margin_m=0.5, leave_margin_m=0.5),
    "confirmed": Question("within_distance", distance_m=2.5, enter_confirm=1.0, leave_confirm=2.0),
    "nearest": Question("nearest", object_kind="instance", count=1),
    "nearest track": Question("nearest", count=2, distance_m=4.0),
    "approaching": Question("approaching", distance_m=6.0, speed_mps=0.2),
    "facing": Question("facing", angle_rad=1.2),
    "contains": Question("contains", "instance", "instance"),
    "on": Question("on", "instance", "instance"),
    "intersects": Question("intersects", object_kind="instance"),
    "in front": Question("in_front_of", "instance", "track", 3.0),
    "crosses": Question("crosses", object_kind="instance"),
}


def walk(town: Town, dice: random.Random, frames: range) -> None:
    """Two sources, of which one lags behind the other, write in turns."""
    for frame in frames:
        names = [name for name in sorted(town.tracks) if ord(name) % 2 == frame % 2]
        states = []
        for name in names:
            before = town.last[name]
            x, y = (min(max(value + dice.gauss(0, 0.5), -1), 7) for value in (before.x_m, before.y_m))
            if before.stamp_us is None:
                x, y = dice.uniform(0, 6), dice.uniform(0, 6)
            stamp_us = frame * SECOND_US // 2 - (frame % 2) * SECOND_US
            states.append((replace(before, stamp_us=stamp_us, x_m=x, y_m=y, z_m=1.0, yaw_rad=dice.uniform(-3, 3),
                                   length_m=1.0, width_m=0.5), False))  # fmt: skip
        town.see(*states)


def differing(dsn: str, repair: bool = False, map_name: str | None = None) -> dict[str, set[str]]:
    """By map, or of one: the comparisons in which something differs; after a repair, where that is asked for."""
    verification = verify(dsn, lambda said: None)
    with verification.connection:
        found = list(verification.look(map_name))
        if repair:
            list(verification.repair())
            found = list(verification.look(map_name))
    maps = {each.map_name for each in found if each.differ}
    return {name: {each.name for each in found if each.differ and each.map_name == name} for name in maps}


@pytest.fixture(scope="module")
def walked(cluster: Cluster, template: str) -> Iterator[str]:
    """The name of a database with a map for each question, on which six tracks of two sources have walked."""
    with database_with_slot(cluster, template) as dsn:
        for number, (name, asked) in enumerate(QUESTIONS.items()):
            town, dice = Town(dsn, asked, name), random.Random(number)
            for track in "abcdef":
                town.track(track, ord(track) % 2)
            town.put("P", WIDE, band=(0.0, 3.0))
            band = (3.0, 3.5) if name == "on" else (1.0, 2.0)
            town.put("Q", shapely.box(1, 1, 2, 2), band)
            walk(town, dice, range(4, 30))
            town.put("Q", shapely.box(9, 1, 10, 2), band)
            town.put("Q", shapely.box(1.5, 1, 2.5, 2), band)
            town.end("f", 40 * SECOND_US // 2)
            town.tracks.pop("f")
            walk(town, dice, range(44, 60))
            town.check()
            town.close()
        with connect(dsn) as connection:
            connection.execute("select pg_drop_replication_slot(semap.rule_slot())")
            name = connection.info.dbname
        yield name


@pytest.fixture
def broken(cluster: Cluster, walked: str) -> Iterator[World]:
    with fresh_database(cluster, walked) as dsn:
        world = World.__new__(World)
        world.dsn, world.connection = dsn, connect(dsn)
        yield world
        world.close()


OF_MAP = "map_id = (select map_id from semap.map where name = '{}')"
INSTANCE = "(instance_id, query_id, is_object) = (select instance_id, query_id, is_object from semap.pair_instance where {} limit 1)"
TRACK = "track_id = (select min(track_id) from semap.followed_state where {})"
ONE_PAIR = "ctid = (select min(ctid) from semap.relation where in_pairs and confirmed and {})"


def one_of(map_name: str, of: str = TRACK) -> str:
    return of.format(OF_MAP.format(map_name))


def held(map_name: str) -> str:
    return ONE_PAIR.format(OF_MAP.format(map_name))


SIDES = """(
    select w.map_id, w.query_id, w.is_object, w.track_id as key, w.track_id, null::bigint as instance_id,
           st_point((f.state).x_m, (f.state).y_m) as place
    from semap.pair_track_wanted w join semap.followed_state f using (track_id)
    union all
    select map_id, query_id, is_object, -instance_id, null, instance_id, place from semap.pair_instance)"""

HELD = ("near", "with margins", "nearest", "nearest track", "facing", "contains", "on", "intersects")
BROKEN = {
    **{f"a pair that is gone: {name}": (name, f"delete from semap.relation where {held(name)}", {"log", "pairs"})
       for name in HELD if name != "with margins"},
    **{f"a pair too many: {name}": (
        name,
        "insert into semap.relation (in_pairs, map_id, query_id, track_id, subject_instance_id, instance_id, object_track_id,"
        " confirmed, since, pending, pending_at, raw, raw_at) select true, s.map_id, s.query_id, s.track_id, s.instance_id,"
        f" o.instance_id, o.track_id, true, now(), true, now(), true, now() from {SIDES} s join {SIDES} o on o.query_id = s.query_id and o.is_object"
        f" and o.key <> s.key where not s.is_object and s.{OF_MAP.format(name)} and not exists (select from semap.relation p"
        " where p.query_id = s.query_id and p.subject_key = s.key and p.object_key = o.key) order by 3, st_distance(s.place,"
        " o.place) desc limit 1", {"log", "pairs"}) for name in ("near", "with margins", "nearest", "in front", "contains")},
    "one that stands on no side": ("near", f"update semap.relation set pending = false where {held('near')}", {"pairs"}),
    "one that should be confirmed": (
        "confirmed", "update semap.relation set confirmed = false, since = null where "
        + held("confirmed"), {"pairs", "log"}),
    "a wrong since": ("near", f"update semap.relation set since = since - interval '1 s' where {held('near')}", {"log"}),
    "one of who ended": (
        "near", "insert into semap.relation (in_pairs, map_id, query_id, track_id, object_track_id, confirmed, since, pending,"
        " pending_at, raw, raw_at) select true, q.map_id, q.query_id, s.track_id, o.track_id, true, now(), true, now(), true,"
        " now() from semap.continuous_query q"
        " join semap.map m on m.map_id = q.map_id and m.name = 'near' join semap.track s on s.map_id = q.map_id and"
        " s.name = 'a' join semap.track o on o.map_id = q.map_id and o.name = 'f' where q.in_pairs", {"pairs", "log"}),
    "what approaches is not followed": (
        "approaching", f"delete from semap.relation where not confirmed and {OF_MAP.format('approaching')}", {"pairs"}),
    "a line that is held": (
        "crosses", "insert into semap.relation (in_pairs, map_id, query_id, track_id, instance_id, confirmed, since, pending, raw)"
        f" select true, s.map_id, s.query_id, s.track_id, o.instance_id, true, now(), true, true from {SIDES} s join {SIDES} o"
        f" using (query_id) where not s.is_object and o.is_object and s.{OF_MAP.format('crosses')} limit 1",
        {"pairs", "log"}),
    "no place": ("near", f"delete from semap.followed_state where {one_of('near')}", {"pair members"}),
    "no instance": (
        "nearest", f"delete from semap.pair_instance where {one_of('nearest', INSTANCE)}", {"pair members"}),
    "a track at another place": (
        "near", f"update semap.followed_state set state.x_m = (state).x_m + 1 where {one_of('near')}", {"pair members"}),
    "an instance of another shape": (
        "contains", f"update semap.pair_instance set shape = st_buffer(shape, 1) where {one_of('contains', INSTANCE)}",
        {"pair members"}),
    "a box elsewhere": (
        "contains",
        f"update semap.pair_instance set box = st_translate(box, 99, 0, 0) where {one_of('contains', INSTANCE)}",
        {"pair members"}),
    "an instance of another name": (
        "contains", f"update semap.pair_instance set name = 'x' where {one_of('contains', INSTANCE)}", {"pair members"}),
    "an old stamp": (
        "near", f"update semap.followed_state set state.stamp = '-infinity' where {one_of('near')}", {"pair members"}),
    "a track that ended": (
        "near", "insert into semap.followed_state (track_id, map_id, cell_x, cell_y, state)"
        " select t.track_id, t.map_id, 0, 0, semap.new_state(t.track_id, now(), 0, 0) from semap.track t"
        f" where t.name = 'f' and t.{OF_MAP.format('near')}", {"pair members"}),
    "a track that is elsewhere": (
        "near", "update semap.track_now set x_m = x_m + 30 where track_id = (select min(track_id) from"
        f" semap.relation where confirmed and {OF_MAP.format('near')})",
        {"presents", "pair members", "pairs"}),
    "a change too few": (
        "near", "delete from semap.relation_change where change_id = (select max(change_id) from semap.relation_change where"
        f" kind = 'began' and object_track_id is not null and {OF_MAP.format('near')})", {"log"}),
    "an end too few": (
        "near", "delete from semap.relation_change where change_id = (select max(change_id) from semap.relation_change where"
        f" kind = 'ended' and {OF_MAP.format('near')})", {"log", "past", "pair history"}),
    "an end of two instances too few": (
        "contains", "delete from semap.relation_change where change_id = (select max(change_id) from semap.relation_change"
        f" where kind = 'ended' and {OF_MAP.format('contains')})", {"log", "past"}),
    "a stay too few": (
        "nearest track", "delete from semap.relation_past where relation_past_id = (select max(relation_past_id) from"
        f" semap.relation_past where {OF_MAP.format('nearest track')})", {"past"}),
    "a beginning that was taken back": (
        "near", "insert into semap.relation_change (uid, map_id, query_id, query_name, track_id, track_name,"
        " object_track_id, object_track_name, kind, cause, stamp, transition_at, since, amendment, retracts)"
        " select gen_random_uuid(), map_id, query_id, query_name, track_id, track_name, object_track_id, object_track_name,"
        " kind, cause, stamp, transition_at, since, 'retracted', uid from semap.relation_change where change_id ="
        " (select max(c.change_id) from semap.relation_change c join semap.relation p on p.confirmed and p.query_id = c.query_id"
        " and p.track_id = c.track_id and p.object_track_id = c.object_track_id where c.kind = 'began' and"
        f" c.{OF_MAP.format('near')})", {"log", "pair history"}),
    "a crossing too few": (
        "crosses", "delete from semap.relation_change where change_id = (select max(change_id) from semap.relation_change"
        f" where kind = 'crossed' and {OF_MAP.format('crosses')})", {"crossings"}),
    "a crossing that never was": (
        "crosses", "update semap.relation_change set direction = case direction when 'left_to_right' then 'right_to_left'"
        " else 'left_to_right' end where change_id = (select max(change_id) from semap.relation_change"
        f" where kind = 'crossed' and {OF_MAP.format('crosses')})", {"crossings"}),
}  # fmt: skip


def test_what_was_walked_is_right(broken: World) -> None:
    assert differing(broken.dsn) == {}
    counts = dict(
        broken.rows(
            "select m.name, count(*) from semap.relation p join semap.map m using (map_id) where confirmed group by 1"
        )
    )
    assert set(HELD) | {"confirmed", "in front"} <= set(counts), "so that there is something to be looked at"
    crossed = broken.rows("select distinct query_id from semap.relation_change where kind = 'crossed'")
    assert len(crossed) == 1
    assert broken.one("select count(*) from semap.relation_change where kind = 'ended' and cause = 'map'") > 0


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_broken_is_named_and_mended(broken: World, name: str) -> None:
    map_name, statement, named = BROKEN[name]
    broken.run("set session_replication_role = replica")
    assert broken.connection.execute(statement).rowcount > 0
    broken.run("set session_replication_role = origin")
    assert differing(broken.dsn, map_name=map_name) == {map_name: named}
    assert differing(broken.dsn, repair=True, map_name=map_name) == {}


def test_what_goes_on_after_a_repair_is_right(broken: World) -> None:
    broken.run("delete from semap.pair_instance")
    broken.run("delete from semap.followed_state")
    broken.run("delete from semap.relation")
    assert set(differing(broken.dsn)) == set(QUESTIONS)
    assert differing(broken.dsn, repair=True) == {}
    dice = random.Random(5)
    for second in range(100, 105):
        for map_id, source_id in broken.rows("select map_id, source_id from semap.source"):
            tracks = broken.rows(
                "select track_id from semap.track where ended_at is null and source_id = %s", source_id
            )
            broken.add_states([(track, (second + map_id) * SECOND_US, dice.uniform(0, 6), dice.uniform(0, 6), 1.0)
                               for (track,) in tracks])  # fmt: skip
    assert differing(broken.dsn) == {}


def test_a_repair_tells_what_changed(broken: World) -> None:
    """A pair that is gone from the table and stands in the log has not ended for anybody; one that is in neither begins."""
    before = broken.one("select max(change_id) from semap.relation_change")
    broken.run(f"delete from semap.relation where {held('near')}")
    differing(broken.dsn, repair=True)
    assert broken.one("select count(*) from semap.relation_change where change_id > %s", before) == 0
    broken.run("with gone as (delete from semap.relation where confirmed and " + OF_MAP.format("near") + " returning *)"
               " delete from semap.relation_change c using gone g where c.kind = 'began' and c.query_id = g.query_id and"
               " c.track_id = g.track_id and c.object_track_id = g.object_track_id and c.transition_at = g.since")  # fmt: skip
    before = broken.one("select max(change_id) from semap.relation_change")
    verification = verify(broken.dsn, lambda said: None)
    with verification.connection:
        list(verification.look("near"))
        repaired = list(verification.repair())
    count = broken.one("select count(*) from semap.relation where confirmed and " + OF_MAP.format("near"))
    assert [each.crossings for each in repaired] == [count]
    assert broken.rows("select kind::text, cause::text, count(*) from semap.relation_change where change_id > %s group by 1, 2",
                       before) == [("began", "map", count)]  # fmt: skip
