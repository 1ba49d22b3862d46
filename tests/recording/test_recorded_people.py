"""Persons that others have tracked, in real bags: who they are to their tracker tells them apart here."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import FORMATS, Ros, Said, write
from perceived import perceived

START_NS = 1_785_000_000 * 10**9
TENTH_NS = 10**8
COVARIANCE = np.diag([0.04, 0.04, 1, 1, 1, 1]).ravel()
Places = dict[int, tuple[float, float, float]]
Say = Callable[[Ros, int, Places], Any]


def turning_back(time_s: float) -> Places:
    """Two walk towards each other, meet within 0.2 m, and each goes back where it came from."""
    apart_m = 0.1 + abs(time_s - 4.0)
    return {41: (5.0 - apart_m, 2.0, 0.0), 7: (5.0 + apart_m, 2.0, 0.0)}


def solids(ros: Ros, stamp_ns: int, places: Places) -> Any:
    detections = []
    for number, place in places.items():
        told = ros.solid([ros.hypothesis("person", 0.9, place, COVARIANCE)], place, (0.5, 0.5, 1.8))
        told.id = f"someone-{number}"
        detections.append(told)
    return ros.make("vision_msgs/Detection3DArray", header=ros.header(stamp_ns, "map"), detections=detections)


def legs(ros: Ros, stamp_ns: int, places: Places) -> Any:
    people = [ros.make("leg_tracker/Person", pose=ros.pose(place), id=n) for n, place in places.items()]
    return ros.make("leg_tracker/PersonArray", header=ros.header(stamp_ns, "map"), people=people)


def people(ros: Ros, stamp_ns: int, places: Places) -> Any:
    return ros.people(stamp_ns, {f"person {number}": place for number, place in places.items()})


def tracked(ros: Ros, stamp_ns: int, places: Places) -> Any:
    return ros.tracked(stamp_ns, places, COVARIANCE)


CASES = [
    ("vision_msgs/msg/Detection3DArray", solids, "mcap"),
    ("people_msgs/msg/People", people, "ros1"),
    ("spencer_tracking_msgs/msg/TrackedPersons", tracked, "ros1"),
    ("spencer_tracking_msgs/msg/TrackedPersons", tracked, "sqlite3"),
    ("leg_tracker/msg/PersonArray", legs, "ros1"),
]


def recorded(folder: Path, kind: str, type_name: str, say: Say, seconds: float = 8.0) -> Path:
    ros = Ros(is_ros1=kind == "ros1")
    stamps = [START_NS + n * TENTH_NS for n in range(int(seconds * 10))]
    said = [
        Said("/people", type_name, say(ros, stamp, turning_back((stamp - START_NS) / 1e9)), stamp)
        for stamp in stamps
    ]
    return write(folder, kind, said, ros)


@pytest.mark.parametrize(("type_name", "say", "kind"), CASES, ids=[f"{c[0]} {c[2]}" for c in CASES])
def test_who_somebody_is_to_his_tracker_he_stays(tmp_path: Path, type_name: str, say: Say, kind: str) -> None:
    """By places alone they would have walked past each other."""
    found, _ = perceived(recorded(tmp_path, kind, type_name, say), topics={"poses": ["/people"]})
    sides: dict[int, set[bool]] = {}
    for states in (each.states for one in found for each in one.persons):
        for track, place in zip(states.track.tolist(), states.position_m, strict=True):
            if abs(place[0] - 5.0) > 0.8:
                sides.setdefault(track, set()).add(bool(place[0] > 5.0))
    assert sorted(map(sorted, sides.values())) == [[False], [True]]


@pytest.mark.parametrize("kind", FORMATS)
def test_whom_a_tracker_does_not_see_is_left_out(tmp_path: Path, kind: str) -> None:
    ros = Ros(is_ros1=kind == "ros1")
    said = [
        Said("/people", "spencer_tracking_msgs/msg/TrackedPersons",
             ros.tracked(stamp, {1: (1, 2, 0), 2: (8, 2, 0)}, COVARIANCE, hidden=[2]), stamp)
        for stamp in range(START_NS, START_NS + 20 * TENTH_NS, TENTH_NS)
    ]  # fmt: skip
    found, _ = perceived(write(tmp_path, kind, said, ros), topics={"poses": ["/people"]})
    places = np.concatenate([each.states.position_m for one in found for each in one.persons])
    assert len(places)
    np.testing.assert_allclose(places, np.tile([1.0, 2.0], (len(places), 1)), atol=0.01)


def test_an_id_that_several_have_tells_nothing(tmp_path: Path) -> None:
    """Some write the same text into each detection."""

    def alike(ros: Ros, stamp_ns: int, places: Places) -> Any:
        message = solids(
            ros, stamp_ns, {n: (x, y + (0.0 if n == 7 else 3.0), z) for n, (x, y, z) in places.items()}
        )
        for each in message.detections:
            each.id = "person"
        return message

    path = recorded(tmp_path, "mcap", "vision_msgs/msg/Detection3DArray", alike)
    found, _ = perceived(path, topics={"poses": ["/people"]})
    last = [each.states for one in found for each in one.persons if len(each.states)][-1]
    assert sorted(last.position_m[:, 1].round(1).tolist()) == [2.0, 5.0]
