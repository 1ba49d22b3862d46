"""Labels against the dense truth, by shapely, and through their file."""

import json
from collections import Counter
from functools import cache
from math import pi
from pathlib import Path

import numpy as np
import pytest
import shapely
from semap_ingest.simulation.floor import HALLWAY
from semap_ingest.simulation.in_view import track_labels
from semap_ingest.simulation.labels import Labels, label, read_labels, stamp_us, write_labels
from semap_ingest.simulation.laser_view import SWEEP_S, LaserView
from semap_ingest.simulation.schedule import Moments
from semap_ingest.simulation.settings import START_US, OfficeSettings
from shapely.affinity import rotate, scale, translate
from simulated import SEEDS, course

from semap.errors import InvalidInput

TIMES_S = np.arange(0.0, 93.0, 0.5)


@cache
def labelled(seed: int) -> tuple[Moments, Labels]:
    happening = course(seed)
    view = LaserView(happening.floor)
    moments = [happening.at(time_s) for time_s in TIMES_S]
    ranges = [
        view.sweep(moment, happening.at(time_s + SWEEP_S))
        for time_s, moment in zip(TIMES_S, moments, strict=True)
    ]
    names = tuple(person.name for person in happening.people)
    stamps = [stamp_us(time_s) for time_s in TIMES_S]
    tracks = track_labels(happening.floor, names, stamps, moments, ranges)
    return happening, label(OfficeSettings(seed=seed), happening, tracks)


def body(moment, name: str) -> shapely.Polygon:
    """The ellipse as shapely makes it, a little inside the true one."""
    found = next(each for each in moment.bodies if each.name == name)
    circle = shapely.Point(0, 0).buffer(0.5, quad_segs=16)
    ellipse = scale(circle, found.depth_m, found.width_m, origin=(0, 0))
    return translate(rotate(ellipse, found.heading_rad * 180 / pi, origin=(0, 0)), *found.position_m)


@pytest.mark.parametrize("seed", SEEDS)
def test_counts(seed: int) -> None:
    _, labels = labelled(seed)
    assert len(labels.transitions) == 16
    assert Counter(each.kind for each in labels.doors) == {"opening": 6, "closing": 6}
    kinds = Counter(each.kind for each in labels.relations)
    assert len(labels.relations) == 12
    assert kinds["opened_then_entered"] == kinds["entered_then_closed"]
    assert kinds["opened_then_left"] == kinds["left_then_closed"]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_transition_is_complete_when_all_of_the_body_is_inside(seed: int) -> None:
    happening, labels = labelled(seed)
    for each in labels.transitions:
        time_s = (each.complete_us - START_US) / 1e6
        footprint = happening.floor.rooms[each.room if each.kind == "entered" else HALLWAY]
        inside = [
            footprint.covers(body(happening.at(time_s + shift_s), each.person))
            for shift_s in (-0.1, -0.05, 0.005, 0.05, 0.1, 0.2)
        ]
        assert inside == [False, False, True, True, True, True], each


@pytest.mark.parametrize("seed", SEEDS)
def test_rooms_of_dense_samples_change_as_the_labels_say(seed: int) -> None:
    happening, labels = labelled(seed)
    rooms = {person.name: [] for person in happening.people}
    for time_s in np.arange(0.0, 93.0, 0.25):
        moment = happening.at(time_s)
        for name in rooms:
            outline = body(moment, name)
            where = [room for room, area in happening.floor.rooms.items() if area.covers(outline)]
            assert len(where) <= 1
            if where and rooms[name][-1:] != where:
                rooms[name] += where
    for name, visited in rooms.items():
        changes = [each for each in labels.transitions if each.person == name]
        expected = visited[:1] + [each.room if each.kind == "entered" else HALLWAY for each in changes]
        assert visited == expected


def test_relations_pair_each_transition_by_hand_with_its_door() -> None:
    happening, labels = labelled(1)
    by_hand = [passage for passage in happening.passages if passage.opening_s and passage.closing_s]
    expected = {
        (f"opened_then_{each.kind}", each.person, each.door.name, stamp_us(each.opening_s[1]))
        for each in by_hand
    } | {
        (f"{each.kind}_then_closed", each.person, each.door.name, stamp_us(each.closing_s[1]))
        for each in by_hand
    }
    assert expected == {
        (each.kind, each.person, each.door, each.first_us if "opened" in each.kind else each.second_us)
        for each in labels.relations
    }
    assert all(each.first_us < each.second_us for each in labels.relations)


@pytest.mark.parametrize("seed", SEEDS)
def test_transitions_are_seen(seed: int) -> None:
    """By three beams at least, in three of four scans of the half second before."""
    happening, labels = labelled(seed)
    view = LaserView(happening.floor)
    for each in labels.transitions:
        number = [person.name for person in happening.people].index(each.person)
        seen = 0
        for back_s in (0.0, 0.15, 0.3, 0.45):
            moment = happening.at((each.complete_us - START_US) / 1e6 - back_s)
            seen += bool((view.sweep(moment, moment).shin_of == number).sum() >= 3)
        assert seen >= 3, each


def test_tracks_are_the_truth_at_each_scan() -> None:
    happening, labels = labelled(1)
    tracks = labels.tracks
    assert tracks.position_m.shape == (5, len(TIMES_S), 2)
    for index, time_s in enumerate(TIMES_S):
        moment = happening.at(time_s)
        assert tracks.stamp_us[index] == stamp_us(time_s)
        for person, each in enumerate(moment.bodies):
            assert tracks.position_m[person, index].tolist() == each.position_m.tolist()


def test_camera_sees_who_stands_in_its_image_with_nothing_between() -> None:
    happening, labels = labelled(1)
    camera = np.array([10.0, 4.9])
    low_m, high_m = happening.floor.fixed.z_m.T
    walls = shapely.union_all(
        shapely.linestrings(happening.floor.fixed.segments_m[(low_m <= 1.2) & (high_m >= 1.2)])
    )
    for index, time_s in enumerate(TIMES_S):
        leaves = shapely.union_all(
            shapely.linestrings(happening.floor.leaves(happening.door_rad(time_s)).segments_m)
        )
        middles = labels.tracks.position_m[:, index]
        for person, middle in enumerate(middles):
            ahead, beside = middle[1] - camera[1], abs(middle[0] - camera[0])
            sight = shapely.LineString([camera, middle])
            nearer = [
                other
                for other in middles
                if (other != middle).any() and np.hypot(*(other - camera)) < sight.length
            ]
            is_free = not sight.intersects(walls) and not sight.intersects(leaves)
            is_free &= all(sight.distance(shapely.Point(other)) >= 0.2 for other in nearer)
            assert labels.tracks.in_camera[person, index] == (beside < ahead and is_free)


def test_file_keeps_everything(tmp_path: Path) -> None:
    _, labels = labelled(8)
    path = tmp_path / "labels.json"
    write_labels(path, labels)
    again = read_labels(path)
    for field in ("seed", "duration_s", "start_us", "transitions", "doors", "relations"):
        assert getattr(again, field) == getattr(labels, field)
    assert again.tracks.people == labels.tracks.people
    assert (again.tracks.stamp_us == labels.tracks.stamp_us).all()
    assert again.tracks.position_m == pytest.approx(labels.tracks.position_m, abs=1e-4)
    assert (again.tracks.laser_beams == labels.tracks.laser_beams).all()
    assert (again.tracks.in_camera == labels.tracks.in_camera).all()


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"format": "semap office labels 0"}', "\xff", "3", "null"])
def test_other_files_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "labels.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InvalidInput, match=r"labels\.json") as refused:
        read_labels(path)
    assert "semap simulate office" in refused.value.remedy


def test_half_a_file_is_refused(tmp_path: Path) -> None:
    _, labels = labelled(8)
    path = tmp_path / "labels.json"
    write_labels(path, labels)
    document = json.loads(path.read_text())
    del document["transitions"][0]["person"]
    path.write_text(json.dumps(document))
    with pytest.raises(InvalidInput, match="no labels"):
        read_labels(path)
    with pytest.raises(InvalidInput, match="cannot be read"):
        read_labels(tmp_path / "missing.json")
