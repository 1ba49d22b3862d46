"""`semap doctor --verify`: whatever is broken by hand is named, and mended by a repair."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from datetime import timedelta
from itertools import count
from typing import Any

import pytest
import shapely
from server import database_with_slot, fresh_database
from world import SECOND_US, World

from semap.cluster import Cluster
from semap.errors import Conflict
from semap.store.database.connection import connect
from semap.store.operate.doctor import verification as verification_module
from semap.store.operate.doctor.verification import COMPARISONS, Verified, verify

ROOMS = {f"r{n}": shapely.box(4 * n, 0, 4 * n + 4, 4) for n in range(4)}
QUERIES = {
    "margins": {"enter_margin_m": 0.3, "leave_margin_m": 0.3},
    "confirmed": {"enter_confirm": timedelta(seconds=1), "leave_confirm": timedelta(seconds=2)},
    "ways": {"longest_gap": timedelta(seconds=5), "fastest_mps": 10, "leave_confirm": timedelta(seconds=1)},
    "near": {"predicate": "within_distance", "distance_m": 0.5, "enter_margin_m": 0.2},
    "likely": {"enter_probability": 0.9, "leave_probability": 0.1, "widest_std_m": 2},
    "about": {"subject_where": {"op": "like", "args": [{"property": "name"}, "t1%"]}},
}


def add_query(world: World, name: str, **values: object) -> None:
    columns = "".join(f", {column}" for column in values)
    world.run(
        f"insert into semap.continuous_query (map_id, name, object_concept_id{columns})"
        f" select %s, %s, concept_id{', %s' * len(values)} from semap.concept where name = 'Room'",
        world.map_id, name, *(world.keep_where(each) if isinstance(each, dict) else each for each in values.values()),
    )  # fmt: skip


def walk(
    world: World, tracks: dict[str, int], steps: range, dice: random.Random, places: dict[str, list[float]]
) -> None:
    for step in steps:
        rows = []
        for name, track in tracks.items():
            place = places.setdefault(name, [dice.uniform(0, 16), dice.uniform(0, 4)])
            for axis, most in enumerate((17, 5)):
                place[axis] = min(max(place[axis] + dice.gauss(0, 0.4), -1), most)
            rows.append((track, step * SECOND_US // 2, *place, None))
        world.add_states(rows)


def differing(dsn: str, repair: bool = False) -> dict[str, list[tuple[str, str, str]]]:
    """By comparison: what differs; after a repair, where that is asked for."""
    verification = verify(dsn, lambda said: None)
    with verification.connection:
        found = list(verification.look(None))
        if repair:
            list(verification.repair())
            found = list(verification.look(None))
    return {each.name: each.examples for each in found if each.differ}


@pytest.fixture(scope="module")
def walked(cluster: Cluster, template: str) -> Iterator[str]:
    """The name of a database with queries of all kinds and tracks that have walked past rooms that were edited."""
    with database_with_slot(cluster, template) as dsn:
        world, dice = World(dsn), random.Random(7)
        for name, room in ROOMS.items():
            world.add_room(name, room)
        for name, values in QUERIES.items():
            add_query(world, name, **values)
        tracks, places = {f"t{n}": world.add_track(f"t{n}") for n in range(20)}, {}
        walk(world, tracks, range(1, 30), dice, places)
        world.edit_room("r0", shapely.box(0, 0, 3.5, 4))
        world.run("update semap.continuous_query set enter_margin_m = 0.25 where name = 'margins'")
        world.end_track(tracks.pop("t9"), 40 * SECOND_US // 2)
        walk(world, tracks, range(41, 60), dice, places)
        world.run("select pg_drop_replication_slot(semap.rule_slot())")
        world.close()
        yield (
            dsn.split("dbname=")[1].split()[0]
            if "dbname=" in dsn
            else dsn.rpartition("/")[2].partition("?")[0]
        )


@pytest.fixture
def broken(cluster: Cluster, walked: str) -> Iterator[World]:
    with fresh_database(cluster, walked) as dsn:
        world = World.__new__(World)
        world.dsn, world.name, world.connection = dsn, "world", connect(dsn)
        world.map_id = world.one("select map_id from semap.map")
        yield world
        world.close()


ONE_RELATION = "ctid = (select n.ctid from semap.relation n join semap.region r using (query_id, instance_id) where r.query_name = '{}' and n.confirmed limit 1)"
UNSETTLED = "(raw <> pending or pending <> confirmed)"
PLAIN, STATEFUL = ONE_RELATION.format("track_in_room"), ONE_RELATION.format("near")

BROKEN = {
    "a relation is gone": (f"delete from semap.relation where {PLAIN}", {"plain relations", "held", "log"}),
    "a stateful relation is gone": (f"delete from semap.relation where {STATEFUL}", {"stateful relations", "held", "log"}),
    "a relation too many": (
        "insert into semap.relation (track_id, query_id, instance_id, map_id, confirmed, since, pending, raw)"
        " select t.track_id, r.query_id, r.instance_id, r.map_id, true, now(), true, true"
        " from semap.region r join semap.track_now t on t.live and st_distance(r.footprint, st_point(t.x_m, t.y_m)) > 3"
        " where r.query_name = 'track_in_room' limit 1", {"plain relations", "held", "log"}),
    "a relation of nothing": (
        "insert into semap.relation (track_id, query_id, instance_id, map_id, confirmed, since, pending, raw)"
        " select track_id, -1, 1, map_id, true, now(), true, true from semap.track_now limit 1",
        {"plain relations", "log"}),
    "a wrong since": (f"update semap.relation set since = since - interval '1 s' where {PLAIN}", {"log"}),
    "wrong regions of a present": (
        "update semap.track_now set region_ids = region_ids || -1 where track_id = (select min(track_id) from semap.track_now)",
        {"held"}),
    "a wrong place": (
        "update semap.track_now set x_m = x_m + 30 where track_id = (select min(track_id) from semap.relation where confirmed)",
        {"presents", "plain relations", "stateful relations"}),
    "an old place": (
        "update semap.track_now t set stamp = s.stamp, x_m = s.x_m, y_m = s.y_m from semap.stored_state s"
        " where s.track_id = t.track_id and s.stamp = '1970-01-01 00:00:21Z'"
        " and t.track_id = (select min(track_id) from semap.relation where confirmed)", {"presents"}),
    "a track that should live": (
        "update semap.track_now set live = false where track_id = (select min(track_id) from semap.relation where confirmed)",
        {"presents", "plain relations", "stateful relations"}),
    "a cell too few": (
        "delete from semap.region_cell where ctid = (select min(ctid) from semap.region_cell)", {"grid"}),
    "an edge of another place": (
        "update semap.region_edge set x_min_m = x_min_m - 1 where ctid = (select min(ctid) from semap.region_edge)", {"grid"}),
    "a region too few": (
        "delete from semap.region where region_id = (select min(region_id) from semap.region join semap.relation using (query_id, instance_id))",
        {"regions", "plain relations", "held"}),
    "a region of another shape": (
        "update semap.region set footprint = st_translate(footprint, 1, 0) where query_name = 'track_in_room'",
        {"regions", "grid", "plain relations"}),
    "a track that is not chosen": (
        "delete from semap.query_track where track_id = (select min(track_id) from semap.query_track)", {"subjects"}),
    "what is seen is otherwise": (
        f"update semap.relation set raw = not raw where ctid = (select min(ctid) from semap.relation where {UNSETTLED})",
        {"stateful relations"}),
    "nothing is remembered": (f"delete from semap.relation where not confirmed and {UNSETTLED}", {"stateful relations"}),
    "a plain relation that waits": (
        "update semap.relation n set confirmed = false, since = null where ctid = (select min(n.ctid) from semap.relation n"
        " join semap.region r using (query_id, instance_id) where r.query_name = 'track_in_room')",
        {"plain relations", "held", "log"}),
    "a change too few": (
        "delete from semap.relation_change where change_id ="
        " (select max(change_id) from semap.relation_change where kind = 'ended' and cause = 'moved')", {"log", "past"}),
    "a change twice": (
        "insert into semap.relation_change (uid, map_id, query_id, query_name, track_id, track_name, instance_id,"
        " instance_name, kind, cause, stamp, transition_at, since) select gen_random_uuid(), map_id, query_id, query_name,"
        " track_id, track_name, instance_id, instance_name, kind, cause, stamp, transition_at, since"
        " from semap.relation_change order by change_id desc limit 1", {"log"}),
    "a stay too few": (
        "delete from semap.relation_past where relation_past_id = (select max(relation_past_id) from semap.relation_past)",
        {"past"}),
}  # fmt: skip


def test_what_was_walked_is_right(broken: World) -> None:
    assert broken.one("select count(*) from semap.relation where " + UNSETTLED) > 3
    assert broken.one("select count(*) from semap.relation_change where cause = 'map'") > 3
    verification = verify(broken.dsn, lambda said: None)
    with verification.connection:
        found = list(verification.look("world"))
    assert [each.name for each in found if each.rows == 0] == [
        "pair members",
        "pairs",
        "pair history",
        "crossings",
    ]
    assert [each for each in found if each.differ] == []
    assert found[-1].note == "", "all ways were followed from where the tracks appeared"


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_broken_is_named_and_mended(broken: World, name: str) -> None:
    statement, named = BROKEN[name]
    broken.run("select semap.flush_positions(array(select source_id from semap.source))")
    broken.run("set session_replication_role = replica")
    if name == "a region too few":
        broken.run("set session_replication_role = origin")
    assert broken.connection.execute(statement).rowcount > 0
    broken.run("set session_replication_role = origin")
    found = differing(broken.dsn)
    assert named <= set(found), found
    assert differing(broken.dsn, repair=True) == {}
    broken.run("update semap.source set jump_m = null")
    tracks = dict(broken.rows("select name, track_id from semap.track where ended_at is null"))
    walk(broken, tracks, range(61, 70), random.Random(3), {})
    assert differing(broken.dsn) == {}


def test_a_repair_tells_what_changed(broken: World) -> None:
    """A relation that is gone from the table and stands in the log has not ended for anybody."""
    before = broken.one("select max(change_id) from semap.relation_change")
    broken.run(f"delete from semap.relation where {PLAIN}")
    differing(broken.dsn, repair=True)
    assert broken.one("select count(*) from semap.relation_change where change_id > %s", before) == 0
    broken.run("set session_replication_role = replica")
    broken.run("update semap.abstraction set geometry = st_translate(geometry, 100, 0)")
    broken.run("set session_replication_role = origin")
    held = broken.one("select count(*) from semap.relation where confirmed")
    differing(broken.dsn, repair=True)
    assert broken.rows("select kind::text, cause::text, count(*) from semap.relation_change where change_id > %s group by 1, 2",
                       before) == [("ended", "map", held)]  # fmt: skip


def test_a_change_that_was_taken_back_does_not_count(broken: World) -> None:
    broken.run(
        "with taken as (delete from semap.relation_past where relation_past_id ="
        " (select max(relation_past_id) from semap.relation_past) returning *)"
        " insert into semap.relation_change (uid, map_id, query_id, query_name, track_id, track_name, instance_id,"
        " instance_name, kind, cause, stamp, transition_at, since, amendment, retracts) select gen_random_uuid(), c.map_id,"
        " c.query_id, c.query_name, c.track_id, c.track_name, c.instance_id, c.instance_name, c.kind, c.cause, c.stamp,"
        " c.transition_at, c.since, 'retracted', c.uid from semap.relation_change c join taken t on t.query_id = c.query_id"
        " and t.track_id = c.track_id and t.instance_id = c.instance_id and t.until = c.transition_at and c.kind = 'ended'"
    )
    found = differing(broken.dsn)
    assert set(found) == {"log"}, "what ended is held again, by the log"


def test_places_that_are_written_late_are_no_difference(world: World) -> None:
    for name, room in ROOMS.items():
        world.add_room(name, room)
    add_query(world, "margins", **QUERIES["margins"])
    add_query(world, "about", **QUERIES["about"])
    dice, places = random.Random(1), {}
    tracks = {f"t{n}": world.add_track(f"t{n}") for n in range(210)}
    late = 0
    for frame in range(1, 12):
        rows = []
        for name, track in tracks.items():
            place = places.setdefault(name, [dice.uniform(0, 16), dice.uniform(0, 4)])
            place[0] += dice.gauss(0, 0.05)
            rows.append((track, frame * SECOND_US // 10, *place, None))
        world.add_states(rows)
        late += world.one("select count(*) from semap.source_count where unflushed > 0")
        assert differing(world.dsn) == {}
    assert late > 5


def doctor(dsn: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    known = {name: value for name, value in os.environ.items() if not name.startswith("SEMAP")}
    return subprocess.run([sys.executable, "-m", "semap_service", "doctor", "--verify", *arguments],
                          env=known | {"SEMAP_DSN": dsn}, text=True, capture_output=True, timeout=120, check=False)  # fmt: skip


def test_for_people_and_programs(broken: World) -> None:
    broken.run("delete from semap.relation where ctid = (select n.ctid from semap.relation n join semap.region r using"
               " (query_id, instance_id) join semap.track t using (track_id) where r.query_name = 'track_in_room' order by t.name limit 1)")  # fmt: skip
    said = doctor(broken.dsn)
    assert said.returncode == 1, said.stderr
    assert "wrong  world  relations against footprints and heights: " in said.stdout
    assert " looked at, 1 differ\n" in said.stdout
    assert "(track_in_room): stored is no relation; it should be a relation" in said.stdout
    assert said.stdout.splitlines()[-1] == "-> Make what differs anew: semap doctor --verify --repair"
    mended = json.loads(doctor(broken.dsn, "--repair", "--json", "--map", "world").stdout)
    assert mended["ok"] is True
    assert mended["repaired"] == [{"map_name": "world", "crossings": 0}]
    assert doctor(broken.dsn, "--map", "nowhere").returncode not in (0, 1)


REFUSE = """
    create function public.refuse() returns trigger language plpgsql as $$
    begin
      if old.source_id = {} then
        raise exception 'This map is broken.';
      end if;
      return old;
    end $$;
    create trigger refuse before delete on semap.late_state for each row execute function public.refuse();
"""


def test_a_map_that_cannot_be_corrected_is_told_and_the_others_are_looked_at(world: World) -> None:
    with closing(World(world.dsn, "another")) as other:
        world.run(REFUSE.format(world.source_id))
        for each in (world, other):
            each.add_room("room", shapely.box(0, 0, 4, 4))
            track = each.add_track("ann")
            for at_s, x_m in ((1, 9), (9, 9), (4, 1)):
                each.run("insert into semap.track_state (track_id, stamp, x_m, y_m)"
                         " values (%s, to_timestamp(%s), %s, 1)", track, at_s, x_m)  # fmt: skip
        other.run("delete from semap.region_cell where map_id = %s", other.map_id)
        said = doctor(world.dsn, "--repair")
        assert said.returncode == 1, said.stderr
        told = [line for line in said.stdout.splitlines() if "  world  " in line]
        late = "wrong  world  late states that are not corrected: 1 looked at, 1 differ"
        assert told == 2 * [f"{late} (nothing else of this map is compared until it is)"]
        assert "since its correction fails: This map is broken." in said.stdout
        assert "wrong  another  cells and edges against their regions: " in said.stdout
        assert "repaired  another: 0 relations began or ended by it" in said.stdout
        world.run("drop trigger refuse on semap.late_state")
    assert differing(world.dsn) == {}


@pytest.mark.parametrize("is_again", [False, True], ids=["once", "again and again"])
def test_queries_that_are_removed_meanwhile(
    broken: World, monkeypatch: pytest.MonkeyPatch, is_again: bool
) -> None:
    """A condition is a function, which a snapshot does not keep."""
    verification = verify(broken.dsn, lambda said: None)
    removed = count()

    def remove() -> None:
        broken.run("delete from semap.continuous_query where subject_where is not null")
        if is_again:
            add_query(broken, f"about {next(removed)}", **QUERIES["about"])

    def compare(*named: Any) -> Verified:
        if named[3].name == "subjects" and (is_again or not next(removed)):
            remove()
        return compared(*named)

    compared = verification_module._compare
    monkeypatch.setattr(verification_module, "_compare", compare)
    with verification.connection:
        if is_again:
            with pytest.raises(Conflict, match="removed each of 5 times"):
                list(verification.look(None))
        else:
            found = list(verification.look(None))
            names = [each.name for each in COMPARISONS]
            assert [each.name for each in found] == [*names, "stateful relations"]
            assert {each.name for each in found if each.differ} == set()
