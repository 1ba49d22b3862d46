"""The same states leave the same log, wherever they are cut, from whichever source they come first, however late."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass

import pytest
import shapely
from hypothesis import HealthCheck, given, note, settings
from hypothesis import strategies as st
from server import fresh_database
from world import SECOND_US, World

from semap.cluster import Cluster
from semap.store.operate.doctor.verification import verify
from semap.timeline.stamp import to_datetime

SETTINGS = settings(
    max_examples=25,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
QUERIES = {
    "near": ("within_distance", "distance_m", "0.8"),
    "near for a while": (
        "within_distance",
        "distance_m, enter_confirm, leave_confirm",
        "1.0, '1 s', '500 ms'",
    ),
    "nearest": ("nearest", "count", "1"),
    "approaching": ("approaching", "distance_m, speed_mps", "3, 0.3"),
}
STANDING = """
    select uid, query_name, track_name, instance_name, object_track_name, kind::text, cause::text, stamp, transition_at, since,
           x_m, y_m, direction
    from semap.relation_change c
    where amendment is distinct from 'retracted'
      and not exists (select from semap.relation_change d where d.retracts = c.uid)
"""
PAST = (
    "select query_name, track_name, instance_name, object_track_name, since, until from semap.relation_past"
)
HELD = (
    "select h.query_id, t.name, h.instance_id, o.name, h.since from semap.relation_held h"
    " join semap.track t using (track_id) left join semap.track o on o.track_id = h.object_track_id"
)


@dataclass(frozen=True)
class Row:
    source: int
    track: str
    stamp_us: int
    x_m: float
    y_m: float
    is_last: bool


@dataclass(frozen=True)
class Cuts:
    """How a play is sent.

    seed        of where each source is cut, and which source comes next
    batch       so many rows at most in a statement; None: all of a stamp, as a frame where that is possible
    lateness_s  rows of a source come in any order within this; its watermark says so
    says        whether sources say watermarks
    """

    seed: int
    batch: int | None
    lateness_s: float
    says: bool


cuts = st.builds(
    Cuts,
    seed=st.integers(0, 2**32),
    batch=st.sampled_from([None, 1, 2, 3, 7, 50]),
    lateness_s=st.sampled_from([0.0, 0.0, 1.5]),
    says=st.booleans(),
)


def walks(dice: random.Random) -> list[Row]:
    """Five tracks of two sources, at stamps of their own and at common ones, in the order of their stamps."""
    rows = []
    for number in range(5):
        source, x_m, y_m = number % 2, dice.uniform(0, 4), dice.uniform(0, 4)
        stamps = sorted(dice.sample(range(1, 25), dice.randint(10, 20)))
        for stamp in stamps:
            x_m, y_m = x_m + dice.uniform(-0.8, 0.8), y_m + dice.uniform(-0.8, 0.8)
            stamp_us = stamp * SECOND_US // 2 + source * dice.choice([0, 0, 1])
            rows.append(Row(source, f"t{number}", stamp_us, x_m, y_m, False))
        if dice.random() < 0.3:
            rows[-1] = Row(source, f"t{number}", rows[-1].stamp_us, x_m, y_m, True)
    return sorted(rows, key=lambda row: row.stamp_us)


def batches(rows: Sequence[Row], how: Cuts, dice: random.Random) -> Iterator[tuple[list[Row], int]]:
    """The statements of one source, each with the watermark that is true after it."""
    late_us = int(how.lateness_s * SECOND_US)
    sent = sorted(rows, key=lambda row: row.stamp_us + (dice.randint(0, late_us) if late_us else 0))
    begin = 0
    while begin < len(sent):
        end = begin + (dice.randint(1, how.batch) if how.batch else 1)
        while how.batch is None and end < len(sent) and sent[end].stamp_us == sent[begin].stamp_us:
            end += 1
        left = [row.stamp_us for row in sent[end:]]
        # said before the lateness is taken off
        said_us = min(left) - 1 + late_us if left else max(row.stamp_us for row in sent) + late_us
        yield sent[begin:end], said_us
        begin = end


def play(world: World, rows: Sequence[Row], how: Cuts) -> None:
    dice = random.Random(how.seed)
    world.add_room("room", shapely.box(0.5, 0.5, 3, 3))
    world.run(
        "insert into semap.continuous_query (map_id, name, predicate, subject_kind, object_kind, abstraction)"
        " values (%s, 'crossed', 'crosses', 'track', 'instance', 'Footprint')",
        world.map_id,
    )
    for name, (predicate, columns, values) in QUERIES.items():
        world.run(
            "insert into semap.continuous_query (map_id, name, predicate, subject_kind, object_kind,"
            f" {columns}) values (%s, %s, %s, 'track', 'track', {values})",
            world.map_id, name, predicate,
        )  # fmt: skip
    sources = [world.source_id, world.add_source("second")]
    world.run("update semap.source set jump_m = null, lateness = make_interval(secs => %s)", how.lateness_s)
    if how.says:
        world.run("update semap.source set watermark = '-infinity'")
    tracks = {
        name: world.add_track(name, sources[source])
        for name, source in sorted({(row.track, row.source) for row in rows})
    }
    waiting = [list(batches([row for row in rows if row.source == source], how, dice)) for source in (0, 1)]
    while any(waiting):
        source = dice.choice([source for source in (0, 1) if waiting[source]])
        batch, said_us = waiting[source].pop(0)
        stamps = {row.stamp_us for row in batch}
        if how.batch is None and len(stamps) == 1 and not any(row.is_last for row in batch):
            world.send_batch(
                [(tracks[row.track], row.stamp_us, row.x_m, row.y_m, None) for row in batch], sources[source]
            )
        else:
            with (
                world.connection.transaction(),
                world.connection.cursor() as cursor,
                cursor.copy("copy semap.track_state (track_id, stamp, x_m, y_m, is_last) from stdin") as copy,
            ):
                for row in dice.sample(batch, len(batch)):
                    copy.write_row(
                        (tracks[row.track], to_datetime(row.stamp_us), row.x_m, row.y_m, row.is_last)
                    )
        if how.says:
            world.run(
                "update semap.source set watermark = greatest(watermark, %s) where source_id = %s",
                to_datetime(said_us), sources[source],
            )  # fmt: skip
        if dice.random() < 0.2:
            world.correct()
    world.run("update semap.source set ended = true")
    world.correct()


def known(world: World) -> dict[str, list[tuple]]:
    return {
        name: sorted(world.rows(statement), key=repr)
        for name, statement in (("log", STANDING), ("past", PAST), ("held", HELD))
    }


@SETTINGS
@given(seed=st.integers(0, 2**32), how=cuts)
def test_the_log_does_not_depend_on_how_a_play_was_cut(
    cluster: Cluster, template: str, seed: int, how: Cuts
) -> None:
    note(f"{seed} {how}")
    rows = walks(random.Random(seed))
    found = []
    for cut in (Cuts(0, 1000, 0.0, True), how):
        with fresh_database(cluster, template) as dsn, closing(World(dsn)) as world:
            play(world, rows, cut)
            found.append(known(world))
            verification = verify(dsn, lambda said: None)
            with verification.connection:
                assert [each for each in verification.look(None) if each.differ] == []
    assert found[0] == found[1]


@pytest.mark.parametrize("batch", [1, 2, 3, 1000])
def test_who_walk_side_by_side_meet_once(world: World, batch: int) -> None:
    """Half a metre apart, a metre a step: a batch that is cut inside of a stamp compares nobody with where others were."""
    world.run(
        "insert into semap.continuous_query (map_id, name, predicate, subject_kind, object_kind, distance_m)"
        " values (%s, 'near', 'within_distance', 'track', 'track', 0.8)",
        world.map_id,
    )
    a, b = world.add_track("a"), world.add_track("b")
    rows = [
        row for step in range(5)
        for row in ((a, step * SECOND_US, float(step)), (b, step * SECOND_US, step - 0.5))
    ]  # fmt: skip
    for begin in range(0, len(rows), batch):
        with (
            world.connection.cursor() as cursor,
            cursor.copy("copy semap.track_state (track_id, stamp, x_m, y_m) from stdin") as copy,
        ):
            for track_id, stamp_us, x_m in rows[begin : begin + batch]:
                copy.write_row((track_id, to_datetime(stamp_us), x_m, 0.0))
    world.run("update semap.track set ended_at = %s", to_datetime(4 * SECOND_US))
    world.run("update semap.source set ended = true")
    kinds = [
        kind for (kind,) in world.rows("select kind::text from semap.relation_change order by change_id")
    ]
    assert sorted(kinds) == ["began", "began", "ended", "ended"]
