"""Rules over relations of any two sides and over lines that are crossed; the changes are written by hand."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field

import pytest
import shapely
from made_relations import KINDS, Thing, at, change, pair_query
from rule_work import await_events, await_progress, lose_slot, running_worker
from world import World

from semap.intake.history_rows import Span, history_rows
from semap.intake.stored_facts import load_map_facts
from semap.rules.engine.rule import Rule
from semap.rules.language.reading import parse_declaration
from semap.store.database.connection import connect
from semap.store.operate.rule_slot import ensure_slot
from semap.worker.past import dry_run
from semap.worker.resync import resync

EDGES = {"began": "met", "ended": "parted", "crossed": "passed"}


@dataclass
class Scene:
    """Two instances, two tracks, and queries of each two sides."""

    world: World
    queries: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.things: dict[str, list[Thing]] = {
            "track": [("track", self.world.add_track(name), name) for name in ("ann", "bob", "cid")],
            "instance": [
                ("instance", self.world.add_room(name, shapely.box(x, 0, x + 1, 1)), name)
                for x, name in enumerate(("cup", "desk", "line"))
            ],
        }
        for subject, object_ in KINDS:
            self.queries[f"{subject}_{object_}"] = pair_query(
                self.world, f"{subject}_{object_}", subject, object_
            )
        self.queries["over"] = pair_query(
            self.world, "over", "track", "instance", predicate="crosses", count=None
        )

    def rule(self, name: str, document: dict[str, object]) -> None:
        self.world.run(
            "insert into semap.rule (map_id, name, queries, declaration) values (%s, %s, %s, %s)",
            self.world.map_id, name,
            json.dumps({each: query_id for each, query_id in self.queries.items() if each in str(document)}),
            json.dumps(document),
        )  # fmt: skip

    def change(self, query: str, kind: str, a: int, b: int, second: float, **more: object) -> str:
        subject, _, object_ = ("track_instance" if query == "over" else query).partition("_")
        sides = self.things[subject][a], self.things[object_][b]
        return change(self.world, self.queries[query], query, kind, *sides, second, **more)  # type: ignore[arg-type]

    def id(self, name: str) -> int:
        return next(number for each in self.things.values() for _, number, known in each if known == name)

    def complete(self, second: float) -> None:
        self.world.run("update semap.source set watermark = %s", at(second))
        await_progress(self.world.dsn)


@pytest.fixture
def scene(world: World) -> Iterator[Scene]:
    return Scene(world)


def told(world: World, *columns: str) -> list[tuple]:
    return world.rows(f"select {', '.join(columns)} from semap.event order by seq")


def test_an_event_of_an_edge_says_who_with_whom(scene: Scene) -> None:
    world = scene.world
    for name in scene.queries:
        scene.rule(f"of_{name}", {"input": name, "emit": EDGES})
    expected = []
    with running_worker(world.dsn):
        for place, (subject, object_) in enumerate(KINDS):
            for kind, second in (("began", 10 + place), ("ended", 20 + place)):
                scene.change(f"{subject}_{object_}", kind, 0, 1, second, since_s=10 + place)
                a, b = scene.things[subject][0], scene.things[object_][1]
                others = {}
                if subject == "instance":
                    others |= {"subject": a[2], "subject_id": a[1]}
                if object_ == "track":
                    others |= {"other": b[2], "other_id": b[1]}
                expected.append((
                    EDGES[kind], a[2] if subject == "track" else None, b[2] if object_ == "instance" else None,
                    at(second), at(10 + place), others,
                ))  # fmt: skip
        scene.change(
            "over", "crossed", 0, 2, 30, direction="left_to_right", x_m=2.5, y_m=0.5, edge=1,
            door_id=scene.id("line"), door_name="line",
        )  # fmt: skip
        expected.append(("passed", "ann", "line", at(30), at(30), {"direction": "left_to_right"}))
        scene.complete(30)
    columns = ("type", "track_name", "instance_name", "stamp", "since", "measures")
    assert told(world, *columns) == sorted(expected, key=lambda event: event[3])
    live = {row[0]: row[1:] for row in told(world, "event_id::text", *columns)}
    with connect(world.dsn, "semap_read") as connection:
        again = {
            str(each.event_id): (each.type, each.track_name, each.instance_name, each.stamp, each.since,
                                 dict(each.measures))
            for name in scene.queries
            for each in dry_run(
                connection, "world", parse_declaration({"input": name, "emit": EDGES}, f"of_{name}")
            )
        }  # fmt: skip
    assert again == live


def test_what_happened_while_the_slot_was_lost_is_caught_up(scene: Scene) -> None:
    world = scene.world
    for name in scene.queries:
        scene.rule(f"of_{name}", {"input": name, "emit": EDGES})
    with running_worker(world.dsn):
        scene.change("track_track", "began", 0, 1, 10)
        scene.complete(10)
        await_events(world.dsn, 1)
    lose_slot(world.dsn)
    scene.change("instance_track", "began", 0, 1, 11)
    scene.change("instance_instance", "began", 0, 1, 12)
    scene.change("over", "crossed", 1, 2, 13, direction="right_to_left")
    world.say(world.source_id, 13_000_000)
    with connect(world.dsn) as connection:
        ensure_slot(connection)
    assert resync(world.dsn) == 3
    assert told(world, "type", "track_name", "instance_name", "measures") == [
        ("met", "ann", None, {"other": "bob", "other_id": scene.id("bob")}),
        ("met", None, None, {"subject": "cup", "subject_id": scene.id("cup"), "other": "bob", "other_id": scene.id("bob")}),
        ("met", None, "desk", {"subject": "cup", "subject_id": scene.id("cup")}),
        ("passed", "bob", "line", {"direction": "right_to_left"}),
    ]  # fmt: skip


def test_two_tracks_are_a_key(scene: Scene) -> None:
    """Those who part within a minute, each two by themselves."""
    scene.rule("brief", {
        "input": "track_track", "partition_by": ["track", "other"], "pattern": "B followed by E",
        "define": {"B": "type = 'began'", "E": "type = 'ended' and other = first(B.other)"}, "within": "1 min",
        "measures": {"who": "last(E.track)", "whom": "last(E.other)", "x": "last(E.x_m)"}, "emit": "brief",
    })  # fmt: skip
    world = scene.world
    with running_worker(world.dsn):
        scene.change("track_track", "began", 0, 1, 10)
        scene.change("track_track", "began", 0, 2, 11)
        scene.change("track_track", "began", 1, 0, 12)
        scene.change("track_track", "ended", 0, 1, 40, since_s=10, x_m=1.5, y_m=2)
        scene.change("track_track", "ended", 0, 2, 90, since_s=11)
        scene.change("track_track", "ended", 1, 0, 50, since_s=12)
        scene.complete(200)
    assert told(world, "key", "measures", "stamp") == [
        ({"track": "ann", "other": "bob"}, {"who": "ann", "whom": "bob", "x": 1.5}, at(40)),
        ({"track": "bob", "other": "ann"}, {"who": "bob", "whom": "ann", "x": None}, at(50)),
    ]


def test_occupants_are_subjects_of_either_kind_and_no_crossing_counts(scene: Scene) -> None:
    world = scene.world
    for name in ("instance_instance", "over", "track_track"):
        scene.rule(f"many_{name}", {
            "input": name, "where": "occupants is null or occupants > 1", "emit": {**EDGES, "began": "many"},
        })  # fmt: skip
    with running_worker(world.dsn):
        scene.change("instance_instance", "began", 0, 1, 10)
        scene.change("over", "crossed", 0, 1, 11)
        scene.change("over", "crossed", 1, 1, 12)
        scene.change("track_track", "began", 0, 1, 13)
        scene.change("instance_instance", "began", 2, 1, 14)
        scene.complete(100)
    # of a crossing there are 0 occupants, and of two tracks it is not known
    assert told(world, "type", "instance_name", "track_name", "stamp") == [
        ("many", None, "ann", at(13)), ("many", "desk", None, at(14)),
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["instance_track", "track_instance", "instance_instance"])
def test_what_an_edit_of_the_map_ends_is_read_whatever_its_sides(scene: Scene, name: str) -> None:
    scene.rule("ends", {"input": name, "emit": EDGES})
    world = scene.world
    with running_worker(world.dsn):
        scene.change(name, "began", 0, 1, 10)
        scene.complete(12)
        with world.connection.transaction():
            scene.change(name, "ended", 0, 1, 11, since_s=10, cause="map")
            world.delete_room("desk")
        await_events(world.dsn, 2)
    assert told(world, "type", "cause") == [("met", "moved"), ("parted", "map")]


def test_a_rule_that_looks_back_knows_what_holds_of_each_two_sides(scene: Scene) -> None:
    """Its span begins when relations of all kinds hold, one was over, and a line was crossed."""
    world = scene.world
    for subject, object_ in KINDS:
        scene.change(f"{subject}_{object_}", "began", 0, 1, 10)
        scene.change(f"{subject}_{object_}", "began", 0, 2, 10)
        scene.change(f"{subject}_{object_}", "ended", 0, 2, 15, since_s=10)
    scene.change("over", "crossed", 0, 2, 12)
    names = [f"{subject}_{object_}" for subject, object_ in KINDS]
    scene.rule("ends", {"input": [*names, "over"], "emit": EDGES})
    with connect(world.dsn, "semap_worker") as connection:
        rule_id, document = connection.execute(
            "select rule_id, semap.rule_json(r) from semap.rule r where name = 'ends'"
        ).fetchone()  # type: ignore[misc]
        span = Span(from_us=20_000_000, with_held=True)
        rule, facts = Rule.from_json(rule_id, document), load_map_facts(connection)
        rows = history_rows(connection, rule, frozenset({"ends"}), span, facts)
    said = sorted(
        (row.values["input"], row.values.get("track") or row.values.get("subject"),
         row.values.get("instance") or row.values.get("other"))
        for row in rows
    )  # fmt: skip
    assert said == sorted(
        (f"{subject}_{object_}", scene.things[subject][0][2], scene.things[object_][1][2])
        for subject, object_ in KINDS
    )
