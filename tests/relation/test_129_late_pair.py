"""Late states leave the history of pairs that the same states leave in the order of their stamps."""

from __future__ import annotations

import random
from copy import deepcopy
from dataclasses import dataclass, replace

import pytest
import shapely
from hypothesis import HealthCheck, given, note, settings
from hypothesis import strategies as st
from pair_oracle import Change, PairOracle, Question, Thing
from pair_town import Town
from test_pairs import frames, questions, shape_of, step
from world import SECOND_US, World

QUICK = settings(
    max_examples=40,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
with_tracks = questions().filter(lambda asked: "track" in (asked.subject_kind, asked.object_kind))
STANDING = """
    select kind::text, cause::text, coalesce(track_name, subject_instance_name), coalesce(instance_name, object_track_name),
           (extract(epoch from stamp) * 1000000)::bigint, (extract(epoch from transition_at) * 1000000)::bigint,
           (extract(epoch from since) * 1000000)::bigint, x_m, y_m, direction
    from semap.relation_change c
    where query_id = %s and amendment is distinct from 'retracted'
      and not exists (select from semap.relation_change d where d.retracts = c.uid)
"""
PAST = """
    select coalesce(track_name, subject_instance_name), coalesce(instance_name, object_track_name),
           (extract(epoch from since) * 1000000)::bigint, (extract(epoch from until) * 1000000)::bigint
    from semap.relation_past where query_id = %s
"""
REMEMBERED = """
    select coalesce(s.name, si.name), coalesce(o.name, oi.name), p.confirmed, p.pending,
           case when p.pending <> p.confirmed then (extract(epoch from p.pending_at) * 1000000)::bigint end,
           p.distance_m, (extract(epoch from p.distance_at) * 1000000)::bigint
    from semap.relation p
    left join semap.track s on s.track_id = p.track_id
    left join semap.instance si on si.instance_id = p.subject_instance_id
    left join semap.track o on o.track_id = p.object_track_id
    left join semap.instance oi on oi.instance_id = p.instance_id
    where p.query_id = %s
"""


@dataclass(frozen=True)
class Letter:
    """A state that is sent, at a turn."""

    turn: int
    thing: Thing
    is_last: bool


def off_grid(thing: Thing) -> Thing:
    """Of a size that keeps the corners of its ground off the places of others, which floats might tell either way."""
    length_m, width_m = (size and 1.01 * size for size in (thing.length_m, thing.width_m))
    return replace(thing, length_m=length_m, width_m=width_m)


def walk(dice: random.Random, town: Town, turns: int) -> list[Letter]:
    """States of all tracks in the order of their stamps, some of which are sent when their track has gone on already.

    At one turn speaks one source, so that what has one stamp is known at once.
    """
    letters, now_us = [], 0
    last = dict(town.last)
    for turn in range(turns):
        now_us += dice.choice([SECOND_US // 4, SECOND_US // 4, SECOND_US, 2 * SECOND_US, 40 * SECOND_US])
        names = [name for name in sorted(town.tracks) if ord(name) % 2 == turn % 2]
        for name in dice.sample(names, dice.randint(0, len(names))):
            last[name] = off_grid(step(dice, last[name], now_us))
            letters.append(Letter(turn, last[name], dice.random() < 0.06))
    newest = {each.thing.name: each for each in letters}
    is_late = [each is not newest[each.thing.name] and dice.random() < 0.2 for each in letters]
    sent = []
    for place, each in enumerate(letters):
        turn = each.turn
        if is_late[place]:
            turn = next(other.turn for after, other in enumerate(letters)
                        if after > place and other.thing.name == each.thing.name and not is_late[after])  # fmt: skip
            turn += dice.choice([1, 1, 2, dice.randint(1, turns)])
        sent.append(replace(each, turn=turn))
    return sent


def send(town: Town, letters: list[Letter], dice: random.Random) -> None:
    """Turn by turn, the states of each source in one statement or in two; the late ones after what they are late for."""
    for turn in sorted({each.turn for each in letters}):
        for source in (turn % 2, 1 - turn % 2):
            batch = [each for each in letters if each.turn == turn and ord(each.thing.name) % 2 == source]
            newest_us = max((each.thing.stamp_us for each in batch), default=0)
            parts = [batch]
            if dice.random() < 0.5:
                parts = [
                    [each for each in batch if (each.thing.stamp_us == newest_us) == is_new]
                    for is_new in (True, False)
                ]
            for part in filter(None, parts):
                town.see(*((each.thing, each.is_last) for each in dice.sample(part, len(part))))
                if dice.random() < 0.3:
                    town.world.correct()


def rounded(changes: list[Change]) -> list[tuple]:
    return sorted(
        (each.subject, each.object, each.stamp_us, round(each.edge_us), each.cause == "disappeared", each.kind, each.cause,
         each.direction or "", round(each.since_us), round(each.x_m or 0, 6), round(each.y_m or 0, 6))
        for each in changes
    )  # fmt: skip


def check(town: Town, truth: PairOracle) -> None:
    world, query_id = town.world, town.query_id
    town.settle()
    standing = [Change(*row) for row in world.rows(STANDING, query_id)]
    assert rounded(standing) == rounded(truth.log)
    held = {(*key, round(pair.since_us)) for key, pair in truth.pairs.items() if pair.held}
    assert town.held() == held
    over = [
        (each.subject, each.object, round(each.since_us), round(each.edge_us))
        for each in truth.log
        if each.kind == "ended"
    ]
    assert sorted(world.rows(PAST, query_id)) == sorted(over)
    if truth.asked.predicate != "crosses":
        memory = {
            (*key, pair.held, pair.inside, round(pair.inside_us) if pair.inside != pair.held else None,
             None if pair.distance_m is None else round(pair.distance_m, 9), pair.distance_us)
            for key, pair in truth.pairs.items()
        }  # fmt: skip
        remembered = {
            (*names_and_signals, None if distance_m is None else round(distance_m, 9), distance_us)
            for *names_and_signals, distance_m, distance_us in world.rows(REMEMBERED, query_id)
        }
        assert remembered == memory
    assert world.rows("select * from semap.pair_differences(%s)", world.map_id) == []
    assert world.rows("select * from semap.log_differences(%s)", world.map_id) == []


def play(database: str, asked: Question, seed: int, turns: int) -> None:
    note(f"{asked} {seed}")
    dice = random.Random(seed)
    town = Town(database, asked)
    try:
        for name in ("P", "Q", "R")[: dice.randint(1, 3)]:
            town.put(name, **shape_of(dice, asked), yaw_rad=dice.choice([0.0, 0.0, 0.4, -2.0]))
        for name in "abcd":
            town.track(name, ord(name) % 2)
        truth = deepcopy(town.oracle)
        letters = walk(dice, town, turns)
        in_order = sorted(letters, key=lambda each: each.thing.stamp_us)
        truth.states((each.thing, each.is_last) for each in in_order)
        send(town, letters, dice)
        check(town, truth)
    finally:
        town.close()


@QUICK
@given(asked=with_tracks, seed=st.integers(0, 2**32))
def test_late_states_amend_pairs(database: str, asked: Question, seed: int) -> None:
    play(database, asked, seed, 25)


@pytest.mark.slow
@settings(QUICK, max_examples=1000)
@given(asked=with_tracks, seed=st.integers(0, 2**32))
def test_late_states_amend_pairs_in_long_plays(database: str, asked: Question, seed: int) -> None:
    play(database, asked, seed, 60)


@QUICK
@given(asked=with_tracks, seed=st.integers(0, 2**32))
def test_what_comes_late_between_edits_leaves_a_sound_log(database: str, asked: Question, seed: int) -> None:
    """Sources that lag behind one another by a second, states in any order, and a map that is edited under them.

    What is nearest changes at the moment of a third one, and would go back in time with a source that lags.
    """
    note(f"{asked} {seed}")
    dice, withheld, now_us = random.Random(seed), [], [0, 0]
    lag_us = 0 if asked.predicate == "nearest" else SECOND_US
    town = Town(database, asked)
    try:
        for name in "abcd":
            town.track(name, ord(name) % 2)
        for _ in range(20):
            what = dice.random()
            source = dice.randint(0, 1)
            now_us[source] = max(now_us[source], max(now_us) - lag_us)
            if what < 0.7:
                states, now_us[source] = frames(dice, town, source, now_us[source])
                town.see(*states[::2])
                withheld += states[1::2]
            elif what < 0.8:
                town.put(dice.choice("PQR"), **shape_of(dice, asked), yaw_rad=dice.choice([0.0, 0.4]))
            elif what < 0.85:
                town.choose(dice.choice(sorted(town.tracks)), dice.random() < 0.7)
            elif what < 0.9:
                now_us[source] += SECOND_US
                town.end(dice.choice([name for name in "abcd" if ord(name) % 2 == source]), now_us[source])
            else:
                town.ask(
                    replace(
                        asked, dimensions=dice.choice([2, 3]), leave_confirm=town.oracle.asked.leave_confirm
                    )
                )
            dice.shuffle(withheld)
            late = [each for each in withheld if lag_us or each[0].stamp_us < town.heard[each[0].name]][:3]
            withheld = [each for each in withheld if each not in late]
            for source in (0, 1):
                town.see(*[each for each in late if ord(each[0].name) % 2 == source])
        assert town.differences() == []
    finally:
        town.close()


def near(world: World, name: str, confirm_s: int = 0) -> int:
    return world.one(
        "insert into semap.continuous_query (map_id, name, predicate, subject_kind, object_kind, distance_m, enter_confirm)"
        " values (%s, %s, 'within_distance', 'track', 'track', 1, make_interval(secs => %s)) returning query_id",
        world.map_id, name, confirm_s,
    )  # fmt: skip


def spans(world: World, query_id: int) -> list[tuple]:
    return world.rows(
        "select track_name, extract(epoch from since)::integer, extract(epoch from until)::integer"
        " from semap.relation_past where query_id = %s order by 1, 2",
        query_id,
    )


def test_a_play_that_would_hold_too_much_is_of_the_queries_that_need_less(world: World) -> None:
    """Who stands for an hour before a meeting counts is not looked at again; who meets at once is."""
    plain, patient = near(world, "near"), near(world, "near for an hour", 3600)
    a, b = world.add_track("a"), world.add_track("b")
    world.add_states([(b, 0, 0.0, 5.0, None)])
    world.add_states([(a, second * SECOND_US, 0.0, 0.0, None) for second in range(2_500) if second != 1_500])
    late_us = 1_500 * SECOND_US
    world.add_states([(a, late_us, 0.0, 4.5, None)])
    began_us = world.one(
        "select (extract(epoch from since) * 1000000)::bigint from semap.relation_past where query_id = %s limit 1",
        plain,
    )
    assert began_us == late_us
    assert world.one("select count(*) from semap.relation_change where query_id = %s", plain) == 4
    assert world.one("select count(*) from semap.relation_change where query_id = %s", patient) == 0


def test_what_a_query_asks_since_then_is_not_asked_of_before(world: World) -> None:
    a, b = world.add_track("a"), world.add_track("b")
    for second in (0, 1, 3, 4, 6):
        world.add_states([(a, second * SECOND_US, 0.0, 0.0, None), (b, second * SECOND_US, 9.0, 0.0, None)])
    query_id = near(world, "near")
    for second in (7, 8, 10, 11, 12, 13):
        world.add_states([(a, second * SECOND_US, 0.0, 0.0, None), (b, second * SECOND_US, 9.0, 0.0, None)])
    world.add_states([(a, 2 * SECOND_US, 9.0, 0.0, None)])
    assert spans(world, query_id) == []
    for second in range(14, 20):
        world.add_states([(a, second * SECOND_US, 0.0, 0.0, None), (b, second * SECOND_US, 9.0, 0.0, None)])
    world.add_states([(a, 14 * SECOND_US + 1, 9.0, 0.0, None)])
    world.add_states([(a, 12 * SECOND_US + SECOND_US // 2, 9.0, 0.0, None)])
    assert [span[:1] for span in spans(world, query_id)] == [("a",), ("a",), ("b",), ("b",)]


def test_who_is_not_heard_of_for_long_is_met_where_it_stands(world: World) -> None:
    query_id = near(world, "near")
    a, b = world.add_track("a"), world.add_track("b")
    world.add_states([(b, 0, 5.0, 0.0, None)])
    for second in range(100, 120):
        world.add_states([(a, second * SECOND_US, 0.0, 0.0, None)])
    world.add_states([(b, 300 * SECOND_US, 5.0, 0.0, None)])
    world.add_states([(a, 110 * SECOND_US + 1, 5.0, 0.0, None)])
    assert spans(world, query_id) == [("a", 110, 111), ("b", 110, 111)]


def test_what_was_nearest_before_something_went_is_not_corrected_without_it(world: World) -> None:
    query_id = world.one(
        "insert into semap.continuous_query (map_id, name, predicate, subject_kind, object_kind, count)"
        " values (%s, 'nearest', 'nearest', 'track', 'instance', 1) returning query_id", world.map_id,
    )  # fmt: skip
    for name, x in (("near", 5), ("far", 10)):
        room = world.add_room(name, shapely.box(x - 0.5, -0.5, x + 0.5, 0.5))
        world.run("insert into semap.abstraction (description_id, instance_id, type, geometry) select"
                  " absolute_description_id, instance_id, 'Position2D', st_point(%s, 0) from semap.instance"
                  " where instance_id = %s", x, room)  # fmt: skip
    a = world.add_track("a")
    for second in range(20):
        world.add_states([(a, second * SECOND_US, 0.0, 0.0, None)])
    world.delete_room("near")
    before = world.one("select count(*) from semap.relation_change where query_id = %s", query_id)
    world.add_states([(a, 10 * SECOND_US + 1, 7.0, 0.0, None)])
    assert world.one("select count(*) from semap.relation_change where query_id = %s", query_id) == before


def test_an_end_of_what_began_earlier_is_another_change(world: World) -> None:
    """Who believes the one that was taken back has to know: it is retracted by its identity, and the other has its own."""
    query_id = near(world, "near")
    a, b = world.add_track("a"), world.add_track("b")
    for second in range(20):
        x = 0.5 if 10 <= second < 15 else 5.0
        world.add_states([(a, second * SECOND_US, x, 0.0, None), (b, second * SECOND_US, 0.0, 0.0, None)])
    ended = (
        "select uid from semap.relation_change where query_id = %s and kind = 'ended' and amendment is null"
    )
    told = set(world.rows(ended, query_id))
    world.add_states([(a, 9 * SECOND_US + 1, 0.5, 0.0, None)])
    assert set(world.rows(ended, query_id)) == told
    assert (
        set(
            world.rows(
                "select retracts from semap.relation_change where kind = 'ended' and retracts is not null"
            )
        )
        == told
    )
    assert [row[1:] for row in spans(world, query_id)] == [(9, 15), (9, 15)]
