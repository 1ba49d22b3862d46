"""The worker corrects the past after late states; until it has, rules wait for what came within the lateness."""

from __future__ import annotations

from contextlib import closing

import shapely
from patience import until
from world import SECOND_US, World

from semap.store.database.connection import connect
from semap.timeline.stamp import to_us
from semap.worker.correcting import correcting

ROOM = shapely.box(0, 0, 4, 4)
SPANS = (
    "select extract(epoch from since)::int, extract(epoch from until)::int from semap.relation_past"
    " where map_id = %s order by 1"
)
INSERT = "insert into semap.track_state (track_id, stamp, x_m, y_m) values (%s, to_timestamp(%s), %s, 1)"
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


def walked(world: World) -> int:
    """Somebody who was seen outside at 1 and 9 s; what was seen inside, at 4 and 6 s, comes late."""
    world.run("update semap.source set lateness = '20 s' where map_id = %s", world.map_id)
    track = world.add_track("ann")
    for at_s, x_m in ((1, 9), (9, 9), (4, 1), (6, 9)):
        world.run(INSERT, track, at_s, x_m)
    return track


def test_who_writes_a_late_state_does_not_wait_for_its_correction(world: World) -> None:
    world.add_room("room", ROOM)
    walked(world)
    assert world.one("select count(*) from semap.late_state") == 2
    assert world.rows(SPANS, world.map_id) == []
    with correcting(world.dsn):
        until(lambda: world.one("select count(*) from semap.late_state") == 0)
    assert world.rows(SPANS, world.map_id) == [(4, 6)]


def test_rules_wait_for_what_came_within_the_lateness(world: World) -> None:
    walked(world)
    world.run("update semap.source set ended = true")
    complete = "select semap.complete_through(s) from semap.source s"
    assert to_us(world.one(complete)) == 4 * SECOND_US - 1
    world.correct()
    assert to_us(world.one(complete)) == 9 * SECOND_US
    assert world.one("select late_from from semap.source") is None


def test_a_map_that_cannot_be_corrected_stops_neither_another_nor_an_edit(world: World) -> None:
    with closing(World(world.dsn, "another")) as other:
        world.add_room("room", ROOM)
        other.add_room("room", ROOM)
        walked(world)
        walked(other)
        with connect(world.dsn) as connection:
            connection.execute(REFUSE.format(world.source_id))
        with correcting(world.dsn):
            until(lambda: other.rows(SPANS, other.map_id) == [(4, 6)])
            other.edit_room("room", shapely.box(0, 0, 5, 5))
            assert world.rows(SPANS, world.map_id) == []
            world.run("drop trigger refuse on semap.late_state")
            until(lambda: world.rows(SPANS, world.map_id) == [(4, 6)])


def test_an_edit_corrects_before_it_what_came_late_before_it(world: World) -> None:
    world.add_room("room", ROOM)
    walked(world)
    world.edit_room("room", shapely.box(0, 0, 5, 5))
    assert world.one("select count(*) from semap.late_state") == 0
    assert world.rows(SPANS, world.map_id) == [(4, 6)]
