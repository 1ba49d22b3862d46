"""What the benchmark sets side by side gives the same answer: shapely's, asked state by state."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import shapely

from bench import side_by_side
from bench.crowd import Crowd, Floor, walk
from bench.flink import environment, python_environment
from bench.flink.environment import Flink, FlinkMissing
from bench.flink.python_environment import FlinkPython
from bench.peers import Changes, Fed, Named, Peer, PeerMissing, flink_sql, ordered, peers, row_trigger
from semap.store.database.connection import connect

FLOOR = Floor(3, 2)
# A hall over parts of four rooms, and rooms side by side that share their edges.
ROOMS = [*FLOOR.rooms(), shapely.box(3, 2, 11, 6)]
TRACKS = 12
FRAMES = 40
ROUNDS = 3
# On a raster of half metres, which the walls and corners lie on, too.
PLACES = np.round(walk(FLOOR, TRACKS, ROUNDS * FRAMES, 0.2) * 2) / 2


def _oracle(crowd: Crowd) -> list[Changes]:
    """By rounds."""
    inside: dict[int, set[int]] = {int(track): set() for track in crowd.track_ids}
    rounds: list[list[tuple[int, int, int, int]]] = []
    for frame, stamp_us in enumerate(crowd.stamps_us):
        if frame % FRAMES == 0:
            rounds.append([])
        for track, place in zip(crowd.track_ids.tolist(), crowd.places[frame], strict=True):
            now = {room for room, shape in enumerate(ROOMS) if shapely.contains(shape, shapely.Point(place))}
            rounds[-1] += [(track, room, 1, int(stamp_us)) for room in now - inside[track]]
            rounds[-1] += [(track, room, 0, int(stamp_us)) for room in inside[track] - now]
            inside[track] = now
    return [ordered(rows) for rows in rounds]


def _crowd() -> Crowd:
    return Crowd(ROOMS, np.arange(1, TRACKS + 1), PLACES, side_by_side.FIRST_US)


def _same(found: list[Changes], wanted: list[Changes]) -> bool:
    return len(found) == len(wanted) and all(map(np.array_equal, found, wanted))


def test_the_raster_puts_states_on_edges_and_into_two_rooms() -> None:
    points = shapely.points(PLACES.reshape(-1, 2))
    assert any(shapely.touches(room, points).any() for room in ROOMS)
    assert max(sum(shapely.contains(room, points).astype(int) for room in ROOMS)) == 2


@pytest.mark.slow
def test_semap_and_the_row_trigger_find_what_shapely_finds(database: str) -> None:
    with connect(database) as connection:
        triggers, crowd = side_by_side.begin_triggers(connection, "floor", ROOMS, PLACES, FRAMES)
        with row_trigger.begin(database, crowd, FRAMES) as peer:
            ways: dict[str, Peer] = {"semap": triggers, "row_trigger": peer}
            found = side_by_side.rounds_in_turn(ways, ROUNDS, FRAMES)
        wanted = _oracle(crowd)
        for way, made in ways.items():
            assert _same([made.begun, *(fed.changes for fed in found[way])], wanted)
        left = connection.execute("select to_regnamespace('row_trigger')").fetchone()
    assert left == (None,)


class Silent:
    """A peer that misses one change of the second round."""

    named = Named("silent")

    def __init__(self, rounds: list[Changes]) -> None:
        self.begun = rounds[0]
        self._rounds = rounds

    def feed(self, first: int, count: int) -> Fed:
        return Fed(1.0, self._rounds[first // count])


def test_a_peer_that_misses_a_change_is_no_comparison() -> None:
    wanted = _oracle(_crowd())
    missed = [wanted[0], wanted[1][:-1], wanted[2]]
    with pytest.raises(RuntimeError, match=r"^silent and semap differ in round 1: "):
        side_by_side.rounds_in_turn({"semap": Silent(wanted), "silent": Silent(missed)}, ROUNDS, FRAMES)


def test_a_peer_is_a_file_of_the_folder() -> None:
    assert list(peers()) == ["flink_sql", "row_trigger"]


class Absent:
    def begin(self, dsn: str, crowd: Crowd, frames: int) -> object:
        raise PeerMissing("It is on holiday.")


def test_a_peer_that_is_not_here_is_a_row_that_says_so(
    database: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(side_by_side, "peers", lambda: {"absent": Absent(), "row_trigger": row_trigger})
    rows = side_by_side.compare(database, "floor", ROOMS, PLACES, FRAMES)
    changes = sum(map(len, _oracle(_crowd())[1:]))
    assert [(row["way"], row.get("changes"), row.get("note")) for row in rows] == [
        ("semap's triggers", changes, None),
        ("semap's triggers, as rows", changes, None),
        ("row trigger on PostGIS", changes, None),
        ("absent", None, "It is on holiday."),
    ]


@pytest.mark.parametrize(
    ("version", "said"),
    [
        (sys.version_info[:2], r"^Flink's Python could not be installed: "),
        ((2, 0), r"^Flink's Python functions need one of Python 2\.0, and none was found\.$"),
    ],
)
def test_a_python_that_cannot_be_installed_is_missing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, version: tuple[int, int], said: str
) -> None:
    (tmp_path / "pyflink" / "opt").mkdir(parents=True)
    (tmp_path / "pyflink" / "opt" / "flink-python-2.3.0.jar").touch()
    (tmp_path / "packages.txt").write_text("not-a-folder-of-packages @ file:///nowhere\n")
    monkeypatch.setattr(python_environment, "HOME", tmp_path)
    monkeypatch.setattr(python_environment, "PACKAGES", tmp_path / "packages.txt")
    monkeypatch.setattr(python_environment, "PYTHONS", (version,))
    with pytest.raises(FlinkMissing, match=said):
        python_environment.make_python()
    with pytest.raises(FlinkMissing, match=r"run \./dev flink once\.$"):
        python_environment.find_python()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["packages.txt", "pyflink"]


@pytest.fixture(scope="module")
def flink() -> tuple[Flink, FlinkPython]:
    try:
        return environment.find(), python_environment.find_python()
    except FlinkMissing as missing:
        pytest.skip(str(missing))


@pytest.mark.flink
def test_flink_finds_what_shapely_finds_whichever_way_it_calls_python(
    flink: tuple[Flink, FlinkPython],
) -> None:
    crowd = _crowd()
    found: Mapping[flink_sql.Way, list[Changes]]
    with flink_sql.start(*flink, crowd, FRAMES) as jobs:
        found = {way: [jobs.feed(way, FRAMES).changes for _ in range(ROUNDS)] for way in flink_sql.WAYS}
    wanted = _oracle(crowd)
    assert {way.title: _same(rounds, wanted) for way, rounds in found.items()} == {
        way.title: True for way in flink_sql.WAYS
    }
