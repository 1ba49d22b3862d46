"""Two recordings that come in at once, while the map is edited and other maps come and go: nobody waits in a circle, and
the doors stand as was written last."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import psycopg
import pytest
from door_plan import SCAN_US, Door, DoorPlan
from patience import moment
from world import World

from semap.store.database.connection import connect
from semap.timeline.stamp import to_datetime

PATIENCE_S = 60.0
BATCHES = 25
EDITS = 15
DOORS = [Door(f"d{n}", 3.0 * n, 0.0) for n in range(4)]
STILL = DOORS[:2]
"""Those that nobody moves."""
ADD_TRACK = (
    "insert into semap.track (uid, source_id, map_id, name) select gen_random_uuid(), source_id, map_id, %s"
    " from semap.source where source_id = %s returning track_id"
)
ADD_LINE = (
    "insert into semap.line_observation"
    " (source_id, stamp, x1_m, y1_m, x2_m, y2_m, z_m, angle_std_rad, offset_std_m, points)"
    " select %s, %s, x1, y1, x2, y2, null, 0.01, 0.005, 20"
    " from unnest(%s::float8[], %s::float8[], %s::float8[], %s::float8[]) l (x1, y1, x2, y2)"
)


@dataclass(frozen=True)
class Sources:
    """Of one recording."""

    persons_id: int
    lines_id: int


@pytest.fixture
def plan(world: World) -> DoorPlan:
    made = DoorPlan(world)
    for door in DOORS:
        made.add(door)
    world.run("select semap.ensure_partitions(array[date '1970-01-01'])")
    return made


def write_recording(dsn: str, sources: Sources, number: int) -> None:
    """Batches as an ingest of a recording commits them: tracks, states, ends, amendments, lines, watermarks."""
    dice = random.Random(number)
    tracks: list[int] = []
    with connect(dsn, "semap_ingest", autocommit=False) as connection:
        for batch in range(1, BATCHES + 1):
            with connection.transaction(), connection.cursor() as cursor:
                write_batch(cursor, sources, tracks, batch, batch * SCAN_US + number, dice)


def write_batch(
    cursor: psycopg.Cursor,
    sources: Sources,
    tracks: list[int],
    batch: int,
    stamp_us: int,
    dice: random.Random,
) -> None:
    stamp = to_datetime(stamp_us)
    cursor.execute(ADD_TRACK, [f"t{batch}", sources.persons_id])
    tracks += cursor.fetchone()
    with cursor.copy("copy semap.track_state (track_id, stamp, x_m, y_m) from stdin") as copy:
        for track_id in tracks:
            copy.write_row((track_id, stamp, dice.uniform(0, 12), dice.uniform(-1, 4)))
    if len(tracks) > 3:
        cursor.execute("select semap.end_tracks(%s, %s, %s)", [sources.persons_id, [tracks.pop(0)], [stamp]])
        cursor.execute(
            "insert into semap.track_amendment (source_id, track_id, other_track_id, kind, since, found)"
            " values (%s, %s, %s, 'merged', %s, %s)", [sources.persons_id, tracks[1], tracks[0], stamp, stamp],
        )  # fmt: skip
    leaves = [door.leaf(math.radians(dice.choice([0, 0, 30, 90]))) for door in DOORS]
    ends = [[leaf[end][axis] for leaf in leaves] for end in (0, 1) for axis in (0, 1)]
    cursor.execute(ADD_LINE, [sources.lines_id, stamp, *ends])
    for source_id in (sources.persons_id, sources.lines_id):
        cursor.execute("update semap.source set watermark = %s where source_id = %s", [stamp, source_id])


def edit_map(dsn: str) -> None:
    dice = random.Random(7)
    with connect(dsn, "semap_api") as connection:
        for number in range(EDITS):
            connection.execute(
                "update semap.frame_pose p set y_m = %s from semap.frame f"
                " where f.frame_id = p.frame_id and f.name = %s", [dice.choice([0, 0, 1]), dice.choice(["d2", "d3"])],
            )  # fmt: skip
            connection.execute(
                "update semap.instance set attributes = attributes || jsonb_build_object('note', %s::int)"
                " where name = %s", [number, dice.choice(DOORS).name],
            )  # fmt: skip


def import_maps(dsn: str) -> None:
    for number in range(4):
        other = World(dsn, f"other {number}")
        DoorPlan(other).add(Door("x", 0.0, 0.0))
        other.run("delete from semap.map where map_id = %s", other.map_id)
        other.close()


def make_partitions(dsn: str) -> None:
    with connect(dsn, "semap_ingest") as connection:
        for day in range(10):
            connection.execute("select semap.ensure_partitions(array[date '2020-01-01' + %s])", [day])


def test_recordings_edits_and_imports_at_once_leave_the_truth(plan: DoorPlan) -> None:
    world = plan.world
    recordings = [Sources(world.add_source(f"{n}/persons"), world.add_source(f"{n}/lines")) for n in range(2)]
    jobs: list[tuple[Callable[..., None], tuple]] = [
        *((write_recording, (world.dsn, sources, n)) for n, sources in enumerate(recordings)),
        (edit_map, (world.dsn,)), (import_maps, (world.dsn,)), (make_partitions, (world.dsn,)),
    ]  # fmt: skip
    waits = "select deadlocks from pg_stat_database where datname = current_database()"
    with ThreadPoolExecutor(len(jobs)) as pool:
        for done in [pool.submit(job, *arguments) for job, arguments in jobs]:
            done.result(PATIENCE_S)
    assert world.one(waits) == 0
    assert world.one("select count(*) from semap.line_observation") == 2 * BATCHES * len(DOORS)
    assert world.one("select count(*) from semap.track_amendment") == 2 * (BATCHES - 3)
    assert world.one("select count(*) from semap.track_now where live") == 2 * 3
    for door in STILL:
        chain = world.rows(
            "select value, previous, stamp from semap.object_state where instance_id = %s order by stamp",
            plan.ids[door.name],
        )
        assert [value for value, _, _ in chain[:-1]] == [previous for _, previous, _ in chain[1:]]
        assert all(value != previous for value, previous, _ in chain)
        assert world.rows(
            "select state, since from semap.door_now where instance_id = %s", plan.ids[door.name]
        ) == [(chain[-1][0], chain[-1][2])]


def test_tracks_end_beside_a_writer_of_states(plan: DoorPlan) -> None:
    """Two that wrote states and then end tracks: neither asks for what the other holds."""
    world = plan.world
    sources = [world.add_source(name) for name in "ab"]
    tracks = [world.add_track(name, source_id) for name, source_id in zip("ab", sources, strict=True)]
    add = "insert into semap.track_state (track_id, stamp, x_m, y_m) values (%s, to_timestamp(1), 0, 0)"
    end = "select semap.end_tracks(%s, array[%s]::bigint[], array[to_timestamp(2)])"
    with (
        connect(world.dsn, "semap_ingest", autocommit=False) as first,
        connect(world.dsn, "semap_ingest", autocommit=False) as second,
    ):
        for connection, track_id in zip((first, second), tracks, strict=True):
            connection.execute("set local lock_timeout = '5s'")
            connection.execute(add, [track_id])
        # a track of another source is not ended
        first.execute(end, [sources[0], tracks[1]])
        for connection, source_id, track_id in zip((first, second), sources, tracks, strict=True):
            connection.execute(end, [source_id, track_id])
            connection.commit()
    assert (
        world.rows("select live, stamp from semap.track_now order by track_id")
        == [(False, to_datetime(2_000_000))] * 2
    )


def test_amendments_are_seen_in_the_order_of_their_numbers(plan: DoorPlan) -> None:
    world = plan.world
    sources = [world.add_source(name) for name in "ab"]
    tracks = [
        [world.add_track(f"{s}{n}", source) for n in range(2)]
        for s, source in zip("ab", sources, strict=True)
    ]
    amend = (
        "insert into semap.track_amendment (track_id, other_track_id, kind, since, found)"
        " values (%s, %s, 'merged', to_timestamp(1), to_timestamp(2)) returning track_amendment_id"
    )
    seen: list[int] = []

    def write_second() -> None:
        with connect(world.dsn, "semap_ingest") as connection:
            seen.append(connection.execute(amend, tracks[1]).fetchone()[0])

    with connect(world.dsn, "semap_ingest", autocommit=False) as first, ThreadPoolExecutor() as pool:
        seen.append(first.execute(amend, tracks[0]).fetchone()[0])
        writing = pool.submit(write_second)
        while not world.rows(
            "select from pg_locks where locktype = 'advisory' and classid = 7368 and not granted"
        ):
            moment()
        assert world.rows("select from semap.track_amendment") == []
        first.commit()
        writing.result(PATIENCE_S)
    assert seen == sorted(seen)
    assert len(seen) == 2


def test_the_lines_of_a_source_are_found_by_their_index(world: World) -> None:
    """With a source go its lines; what others saw on other days is not read."""
    other = world.add_source("other")
    days = ["2026-01-01", "2026-01-02"]
    world.run("select semap.ensure_partitions(%s::date[])", days)
    for source_id, day in zip((other, world.source_id), days, strict=True):
        world.run(
            "insert into semap.line_observation"
            " (source_id, stamp, x1_m, y1_m, x2_m, y2_m, angle_std_rad, offset_std_m, points)"
            " select %s, %s::timestamptz + make_interval(secs => n * 0.01), 0, 5, 1, 5, 0.01, 0.01, 9"
            " from generate_series(1, 20000) n", source_id, f"{day} 00:00Z",
        )  # fmt: skip
    world.run("select brin_summarize_new_values(indexrelid::regclass) from pg_index i"
              " join pg_class c on c.oid = i.indexrelid join pg_am a on a.oid = c.relam"
              " where a.amname = 'brin' and c.relkind = 'i'")  # fmt: skip
    world.run("set enable_seqscan = off")
    (plan,) = world.one(
        "explain (analyze, format json) delete from semap.line_observation where source_id = any (%s)",
        [world.source_id],
    )
    world.run("reset enable_seqscan")
    read = {
        node["Relation Name"]: node["Actual Rows"] + node.get("Rows Removed by Index Recheck", 0)
        for node in scans(plan["Plan"])
        if node["Node Type"] == "Bitmap Heap Scan"
    }
    assert read == {
        "line_observation_20260101": 0,
        "line_observation_20260102": 20000,
        "line_observation_default": 0,
    }
    world.run("delete from semap.source where source_id = %s", other)
    assert world.one("select count(*) from semap.line_observation") == 0


def scans(node: dict) -> list[dict]:
    return [node, *(found for child in node.get("Plans", []) for found in scans(child))]
