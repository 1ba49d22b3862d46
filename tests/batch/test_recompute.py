"""The batch layer over what the speed layer has stored: what it confirms, amends, retracts and adds."""

from __future__ import annotations

import json
from collections.abc import Iterator

import numpy as np
import pytest
import shapely
from made_relations import change, pair_query
from rule_work import await_progress, running_worker
from world import SECOND_US, World

from semap.batch.recompute import Plan, recompute
from semap.errors import InvalidInput, NotFound
from semap.rules.matching import pattern_program
from semap.timeline.stamp import to_datetime

DAY_US = 1_767_225_600 * SECOND_US
ROOM = shapely.box(0, 0, 4, 4)
EXACT_S = 1e-3


def at(second: float):
    return to_datetime(DAY_US + round(second * SECOND_US))


@pytest.fixture
def scene(world: World) -> Iterator[World]:
    world.add_room("den", ROOM)
    # tracks are written one after the other here
    world.run("update semap.source set watermark = '-infinity'")
    with running_worker(world.dsn):
        yield world


def walk(world: World, name: str, second: np.ndarray, x_m: np.ndarray, y_m: float = 2.0) -> None:
    track_id = world.add_track(name)
    world.copy_states(
        [
            (track_id, DAY_US + round(s * SECOND_US), x, y_m, None)
            for s, x in zip(second.tolist(), x_m.tolist(), strict=True)
        ]
    )


def complete(world: World, second: float) -> None:
    world.run("update semap.source set watermark = %s", at(second))
    await_progress(world.dsn)


def log(world: World) -> list[tuple]:
    """Type, second, verdict and the second of the event by which it was amended, in the order of the log."""
    return world.rows(
        "select e.type, extract(epoch from e.stamp)::float8 - %s, a.verdict,"
        " (select extract(epoch from b.stamp)::float8 - %s from semap.event b where b.event_id = a.by_event_id), e.by_batch"
        " from semap.event e left join semap.event_amendment a using (event_id) order by e.seq",
        DAY_US / SECOND_US, DAY_US / SECOND_US,
    )  # fmt: skip


def test_a_crossing_between_two_states_confirms_or_amends(scene: World) -> None:
    walk(scene, "ann", np.arange(0, 12.0), np.arange(0, 12.0) * 1.0 - 3.6)
    complete(scene, 20)
    assert [row[:2] for row in log(scene)] == [("entered", 4.0), ("left", 8.0)]

    loose = recompute(scene.dsn, Plan(scene.name, at(0), at(20)))
    assert loose.counts() == {"confirmed": 2, "amended": 0, "retracted": 0, "added": 0}
    assert [row[:3] for row in log(scene)] == [("entered", 4.0, "confirmed"), ("left", 8.0, "confirmed")]

    strict = recompute(scene.dsn, Plan(scene.name, at(0), at(20), same_s=0.1))
    assert strict.counts() == {"confirmed": 0, "amended": 2, "retracted": 0, "added": 0}
    entered, left, in_truth, out_in_truth = log(scene)
    assert in_truth[:4] == ("entered", pytest.approx(3.6, abs=EXACT_S), None, None)
    assert out_in_truth[:4] == ("left", pytest.approx(7.6, abs=EXACT_S), None, None)
    assert entered[:4] == ("entered", 4.0, "amended", in_truth[1])
    assert left[:4] == ("left", 8.0, "amended", out_in_truth[1])
    assert [row[4] for row in log(scene)] == [False, False, True, True]
    assert [change.by_stamp for change in strict.changed] == [
        pytest.approx(at(each), abs=at(EXACT_S) - at(0)) for each in (3.6, 7.6)
    ]


def test_the_same_again_gives_the_same_and_another_verdict_takes_its_place(scene: World) -> None:
    walk(scene, "ann", np.arange(0, 12.0), np.arange(0, 12.0) * 1.0 - 3.6)
    complete(scene, 20)
    strict = Plan(scene.name, at(0), at(20), same_s=0.1)
    recompute(scene.dsn, strict)
    once = log(scene)
    again = recompute(scene.dsn, strict)
    assert log(scene) == once
    assert again.counts()["amended"] == 2
    assert again.events == []
    recompute(scene.dsn, Plan(scene.name, at(0), at(20)))
    assert [row[2] for row in log(scene)] == ["confirmed", "confirmed", "retracted", "retracted"]
    recompute(scene.dsn, strict)
    assert log(scene) == once
    assert scene.rows("select run_id, counts ->> 'amended' from semap.recompute_run order by 1") == [
        (1, "2"), (2, "2"), (3, "0"), (4, "2")
    ]  # fmt: skip


def test_a_flicker_of_noise_is_retracted(scene: World) -> None:
    second = np.arange(0, 10, 0.1)
    x_m = np.full(len(second), -0.25)
    x_m[50] = 0.05
    walk(scene, "ann", second, x_m)
    complete(scene, 20)
    assert [row[:2] for row in log(scene)] == [("entered", 5.0), ("left", pytest.approx(5.1))]
    looked = recompute(scene.dsn, Plan(scene.name, at(0), at(20)), dry_run=True)
    assert looked.run_id is None
    assert looked.counts() == {"confirmed": 0, "amended": 0, "retracted": 2, "added": 0}
    assert [row[2] for row in log(scene)] == [None, None]
    recompute(scene.dsn, Plan(scene.name, at(0), at(20)))
    assert [row[2] for row in log(scene)] == ["retracted", "retracted"]


def test_what_a_corrected_map_shows_is_added(scene: World) -> None:
    walk(scene, "ann", np.arange(0, 12.0), np.arange(0, 12.0) * 1.0 - 3.6, y_m=6.0)
    complete(scene, 20)
    assert log(scene) == []
    scene.edit_room("den", shapely.box(0, 0, 4, 8))
    outcome = recompute(scene.dsn, Plan(scene.name, at(0), at(20)))
    assert outcome.counts() == {"confirmed": 0, "amended": 0, "retracted": 0, "added": 2}
    assert [(row[0], row[4]) for row in log(scene) if row[4]] == [("entered", True), ("left", True)]


def test_rules_over_rules_are_judged_with_the_rules_that_they_read(scene: World) -> None:
    scene.run(
        "insert into semap.rule (map_id, name, declaration) values (%s, 'short_visit', %s)",
        scene.map_id,
        '{"input": {"rule": "room_visits"}, "partition_by": ["track", "room"], "pattern": "E followed by L",'
        ' "define": {"E": "type = \'entered\'", "L": "type = \'left\'"}, "within": "6 s", "emit": "short_visit"}',
    )
    second = np.arange(0, 10, 0.1)
    x_m = np.full(len(second), -0.25)
    x_m[50] = 0.05
    walk(scene, "ann", second, x_m)
    walk(scene, "bob", np.arange(0, 12.0), np.arange(0, 12.0) * 1.0 - 3.6)
    complete(scene, 20)
    assert sorted(row[0] for row in log(scene)) == [
        "entered",
        "entered",
        "left",
        "left",
        "short_visit",
        "short_visit",
    ]
    outcome = recompute(scene.dsn, Plan(scene.name, at(0), at(20), rules=["short_visit"]))
    assert outcome.counts() == {"confirmed": 3, "amended": 0, "retracted": 3, "added": 0}


def test_a_track_that_stood_unseen_for_hours_has_not_just_come(scene: World) -> None:
    track_id = scene.add_track("ann")
    for second in (0.0, 7200.0, 7210.0, 14400.0):
        scene.add_states([(track_id, DAY_US + round(second * SECOND_US), 2.0, 2.0, None)])
    complete(scene, 20_000)
    outcome = recompute(scene.dsn, Plan(scene.name, at(7100), at(7300)))
    assert outcome.counts() == {"confirmed": 0, "amended": 0, "retracted": 0, "added": 0}


def test_a_track_that_is_to_end_later_has_not_ended_in_a_pause(scene: World) -> None:
    """Its last state of the span is not its last; and it ends at a moment for which there is no state."""
    track_id = scene.add_track("ann")
    for second in (0.0, 1.0, 2.0, 600.0):
        scene.add_states([(track_id, DAY_US + round(second * SECOND_US), 2.0, 2.0, None)])
    scene.end_track(track_id, DAY_US + 700 * SECOND_US)
    complete(scene, 800)
    assert [row[:2] for row in log(scene)] == [("entered", 0.0), ("left", 700.0)]
    for span in ((0, 100), (500, 800)):
        outcome = recompute(scene.dsn, Plan(scene.name, *map(at, span)))
        assert outcome.counts() == {"confirmed": 1, "amended": 0, "retracted": 0, "added": 0}


def test_what_the_rules_have_not_read_yet_cannot_be_judged(scene: World) -> None:
    """The states are all there; the worker, which is to read them, stands still: nothing is to be added twice."""
    walk(scene, "bob", np.arange(0, 12.0), np.arange(0, 12.0) * 1.0 - 3.6)
    complete(scene, 20)
    scene.run("update semap.source set ended = true")
    other_id = scene.add_source("other")
    walk(scene, "ann", np.arange(20, 32.0), np.arange(0, 12.0) * 1.0 - 3.6)
    complete_of = "update semap.source set watermark = %s where source_id = %s"
    scene.run(complete_of, at(40), scene.source_id)
    await_progress(scene.dsn)
    with pytest.raises(InvalidInput, match="come only up to"):
        recompute(scene.dsn, Plan(scene.name, at(0), at(40)))
    scene.run(complete_of, at(40), other_id)
    await_progress(scene.dsn)
    outcome = recompute(scene.dsn, Plan(scene.name, at(0), at(40)))
    assert outcome.counts() == {"confirmed": 4, "amended": 0, "retracted": 0, "added": 0}


@pytest.mark.parametrize(("name", "clauses", "second"), [
    ("stayed", {"pattern": "B not followed by L", "within": "90 min"}, 5400),
    ("thrice", {"pattern": "B{3} relaxed", "within": "10 s"}, 5405),
])  # fmt: skip
def test_a_pattern_that_the_edge_of_the_span_cuts(
    scene: World, name: str, clauses: dict[str, object], second: float
) -> None:
    """One that began long before; and one of a series, in which the next begins where the last one ended."""
    declaration = {
        "input": "track_in_room", "partition_by": "room", "emit": name, **clauses,
        "define": {"B": "type = 'began'", **({"L": "type = 'ended'"} if "not" in str(clauses) else {})},
    }  # fmt: skip
    scene.run(
        "insert into semap.rule (map_id, name, queries, declaration)"
        " values (%s, %s, jsonb_build_object('track_in_room', %s::int), %s)",
        scene.map_id, name, scene.query_id, json.dumps(declaration),
    )  # fmt: skip
    if name == "stayed":
        walk(scene, "ann", np.arange(0, 6000.0, 1.5), np.full(4000, 2.0))
    else:
        for number in range(40):
            walk(scene, f"t{number}", np.arange(0, 3.0) + 5300 + 3 * number, np.array([2.0, 2.0, 2.0]))
    complete(scene, 6100)
    made = [row[1] for row in log(scene) if row[0] == name]
    assert second in made
    outcome = recompute(scene.dsn, Plan(scene.name, at(5399), at(5410), rules=[name]))
    there = sum(5399 <= each < 5410 for each in made)
    assert outcome.counts() == {"confirmed": there, "amended": 0, "retracted": 0, "added": 0}


def test_a_map_with_states_of_objects_alone(scene: World) -> None:
    scene.run(
        "insert into semap.rule (map_id, name, declaration) values (%s, 'lamps', %s)",
        scene.map_id, '{"input": {"object_state": "lamp"}, "emit": {"on": "lit", "off": "dark"}}',
    )  # fmt: skip
    for value, second in (("on", 5), ("on", 7), ("off", 9)):
        scene.run(
            "insert into semap.object_state (source_id, instance_name, property, value, stamp)"
            " values (%s, 'den', 'lamp', %s, %s)", scene.source_id, value, at(second),
        )  # fmt: skip
    complete(scene, 20)
    assert [row[:2] for row in log(scene)] == [("lit", 5.0), ("dark", 9.0)]
    for span in ((0, 20), (6, 20), (6, 8)):
        outcome = recompute(scene.dsn, Plan(scene.name, *map(at, span)))
        there = sum(span[0] <= row[1] < span[1] for row in log(scene))
        assert outcome.counts() == {"confirmed": there, "amended": 0, "retracted": 0, "added": 0}


def test_a_span_that_is_not_all_there_is_refused(scene: World) -> None:
    walk(scene, "ann", np.arange(0, 5.0), np.full(5, 2.0))
    with pytest.raises(InvalidInput, match="read no states yet"):
        recompute(scene.dsn, Plan(scene.name, at(0), at(20)))
    complete(scene, 10)
    with pytest.raises(InvalidInput, match="come only up to"):
        recompute(scene.dsn, Plan(scene.name, at(0), at(20)))
    with pytest.raises(InvalidInput, match="ends before it begins"):
        recompute(scene.dsn, Plan(scene.name, at(20), at(0)))
    with pytest.raises(NotFound, match="no map nowhere"):
        recompute(scene.dsn, Plan("nowhere", at(0), at(20)))
    with pytest.raises(NotFound, match="no rule in force other"):
        recompute(scene.dsn, Plan(scene.name, at(0), at(10), rules=["other"]))
    assert recompute(scene.dsn, Plan(scene.name, at(0), at(10))).counts()["confirmed"] == 1


def test_relations_of_pairs_count_as_they_were_noted(scene: World) -> None:
    """Who was near whom is not computed again: its events stand, as do those of a pattern over both kinds."""
    ann, bob = (("track", scene.add_track(name), name) for name in ("Ann", "Bob"))
    query_id = pair_query(scene, "near", "track", "track")
    for name, document in (
        ("meetings", '{"input": "near", "emit": {"began": "met", "ended": "parted"}}'),
        (
            "met_before",
            '{"input": ["near", "track_in_room"], "pattern": "M followed by E", "emit": "met_before",'
            ' "define": {"M": "input = \'near\'", "E": "input = \'track_in_room\' and type = \'began\'"},'
            ' "within": "20 s"}',
        ),
    ):
        scene.run(
            "insert into semap.rule (map_id, name, queries, declaration) values (%s, %s, %s, %s)",
            scene.map_id, name, json.dumps({"near": query_id, "track_in_room": scene.query_id}), document,
        )  # fmt: skip
    first_s = DAY_US / SECOND_US
    change(scene, query_id, "near", "began", ann, bob, first_s + 2)
    change(scene, query_id, "near", "ended", ann, bob, first_s + 3, first_s + 2)
    walk(scene, "cid", np.arange(0, 12.0), np.arange(0, 12.0) * 1.0 - 3.6)
    complete(scene, 20)
    kinds = ["met", "parted", "entered", "met_before", "left"]
    assert sorted(row[0] for row in log(scene)) == sorted(kinds)
    outcome = recompute(scene.dsn, Plan(scene.name, at(0), at(20)))
    assert outcome.counts() == {"confirmed": 5, "amended": 0, "retracted": 0, "added": 0}


def test_a_rule_that_gives_up_says_so(scene: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also in the run that is kept, since what it retracts may be there all the same."""
    monkeypatch.setattr(pattern_program, "RUNS_AT_MOST", 1)
    together = {
        "input": "track_in_room", "pattern": "A followed by B", "after_match": "skip to next row", "emit": "found",
        "define": {"A": "type = 'began'", "B": "type = 'ended' and track = 'nobody'"}, "within": "1 h",
    }  # fmt: skip
    scene.run(
        "insert into semap.rule (map_id, name, queries, declaration) values (%s, 'together', %s, %s)",
        scene.map_id, json.dumps({"track_in_room": scene.query_id}), json.dumps(together),
    )  # fmt: skip
    for name, second in (("ann", 0), ("bob", 1)):
        walk(scene, name, np.arange(0, 12.0) + second, np.arange(0, 12.0) * 1.0 - 3.6)
    complete(scene, 20)
    outcome = recompute(scene.dsn, Plan(scene.name, at(0), at(20)))
    (given_up,) = outcome.given_up.values()
    assert (list(outcome.given_up), given_up.attempts, given_up.key) == (["together"], 1, {})
    assert abs((given_up.first - at(3.6)).total_seconds()) < 0.1
    kept = scene.one("select settings -> 'given_up' from semap.recompute_run")
    assert kept == {"together": given_up.as_json()}
