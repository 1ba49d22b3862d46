"""`semap relations` and `semap query`: relations of any two sides, now and as of a time."""

from __future__ import annotations

import json

import pytest
import shapely
from made_relations import Thing, at, hold, past
from test_cli import done, semap
from world import SECOND_US, World

NEAR = ("query", "add", "near", "--map", "world", "--subject", "track", "--object", "track")


@pytest.fixture
def scene(world: World) -> World:
    """Ann was in the kitchen and then in the hall, was near Bob, and is near him again; the clock faces her."""
    kitchen = world.add_room("kitchen", shapely.box(0, 0, 4, 4))
    world.add_room("hall", shapely.box(4, 0, 8, 4))
    ann, bob = (("track", world.add_track(name), name) for name in ("ann", "bob"))
    world.add_states([(ann[1], 0, 1.0, 1.0, None), (ann[1], 10 * SECOND_US, 5.0, 1.0, None)])
    done(world.dsn, *NEAR, "--predicate", "nearest", "--count", "1", "--distance", "3")
    done(world.dsn, "query", "add", "facing", "--map", "world", "--predicate", "facing", "--angle", "15",
         "--subject", "instance", "--object", "track")  # fmt: skip
    world.run("update semap.continuous_query set enabled = false where name <> 'track_in_room'")
    ids = dict(world.rows("select name, query_id from semap.continuous_query"))
    past(world, ids["near"], "near", ann, bob, 2, 4)
    hold(world, ids["near"], ann, bob, 12)
    clock: Thing = ("instance", kitchen, "kitchen")
    hold(world, ids["facing"], clock, ann, 11)
    return world


def stamp(second: float) -> str:
    return at(second).isoformat()


def shown(world: World, *arguments: str) -> list[tuple]:
    rows = json.loads(done(world.dsn, *arguments, "--json"))
    return [
        tuple(row[name] for name in ("query", "subject", "object", "duration_s") if name in row)
        for row in rows
    ]


def test_what_holds_now_and_what_held(scene: World) -> None:
    now = [("facing", "kitchen", "ann"), ("near", "ann", "bob"), ("track_in_room", "ann", "hall")]
    assert shown(scene, "relations", "--map", "world") == now == shown(scene, "query", "now")
    assert shown(scene, "query", "now", "near") == now[1:2]
    assert shown(scene, "relations", "--track", "bob") == now[1:2]
    then = ("--as-of", stamp(3))
    assert shown(scene, "relations", *then) == [
        ("near", "ann", "bob", 2.0), ("track_in_room", "ann", "kitchen", 10.0)
    ]  # fmt: skip
    assert shown(scene, "query", "now", "near", *then) == [("near", "ann", "bob", 2.0)]
    assert shown(scene, "relations", "--room", "kitchen", "--as-of", stamp(11)) == [
        ("facing", "kitchen", "ann", None)
    ]
    between = ("relations", "--from", stamp(4), "--to", stamp(11))
    assert shown(scene, *between) == [
        ("track_in_room", "ann", "kitchen", 10.0),
        ("track_in_room", "ann", "hall", None),
    ]
    assert "held then" in done(scene.dsn, "relations", "--as-of", stamp(-5))
    for nowhere in (
        ("relations", "--map", "nowhere"),
        ("query", "now", "nothing"),
        ("query", "list", "--map", "x"),
    ):
        ran = semap(scene.dsn, *nowhere)
        assert (
            ran.returncode,
            f"no {'query' if 'now' in nowhere else 'map'} {nowhere[-1]}" in ran.stderr,
        ) == (2, True)
    both = semap(scene.dsn, *between, *then)
    assert (both.returncode, "Leave one out" in both.stderr) == (2, True)


def test_the_list_says_what_is_related_to_what(scene: World) -> None:
    said = done(scene.dsn, "query", "list", "--map", "world")
    assert [line.split()[3:7] for line in said.splitlines()[1:]] == [
        ["track_in_room", "track", "contains", "Room"],
        ["near", "track", "nearest", "track"],
        ["facing", "instance", "facing", "track"],
    ]
    assert "1 nearest, 3 m" in said
    assert "15 degrees" in said
    whole = json.loads(done(scene.dsn, "query", "list", "--json"))[2]
    assert (whole["subject"]["kind"], whole["angle_rad"]) == ("instance", pytest.approx(0.2618, abs=1e-4))


def test_a_query_of_nothing_says_so(world: World) -> None:
    """A door has no outline here, a room has."""
    world.add_room("hall", shapely.box(4, 0, 8, 4))
    crossing = ("query", "add", "--map", "world", "--predicate", "crosses")
    told = [
        semap(world.dsn, *crossing, "doors", "--concept", "Door").stderr,
        semap(world.dsn, "query", "add", "in_door", "--map", "world", "--concept", "Door").stderr,
        semap(world.dsn, *crossing, "rooms", "--concept", "Room").stderr,
        semap(world.dsn, *NEAR, "--predicate", "within_distance", "--distance", "2").stderr,
    ]
    assert ["nothing can hold" in each for each in told] == [True, True, False, False], told


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--object", "tracks"), "neither track nor instance"),
        (("--predicate", "nearest"), "needs a count"),
        (("--confirm", "1e30"), "a time to confirm entering"),
        (("--between-samples", "--fastest", "nan"), "a highest speed"),
        (("--sql", "select * from track t, room r where is_in(t, r)"), "--sql"),
    ],
)
def test_what_is_refused_says_what_to_do(world: World, options: tuple[str, ...], message: str) -> None:
    ran = semap(world.dsn, *NEAR, *options)
    assert ran.returncode == 2
    assert message in ran.stderr
    assert "What to do" in ran.stderr
