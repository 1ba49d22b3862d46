"""What truly happened in a simulated recording: written as JSON beside it, read by whoever compares.

Stamps are event time [us since 1970], places [m] in the frame `map`. The file:

  format, seed, people, duration_s, start_us   what it is, and of which settings
  transitions  person, room, kind (entered, left), complete_us: from when on ALL of the body, an ellipse, is
               inside the room's footprint (left: inside the hallway's)
  doors        door, room, person, kind (opening, closing), start_us, end_us: while the leaf turns
  relations    kind, person, room, door, first_us, second_us: a transition, and the turn of the leaf before or
               after it by the same person. first_us is the end of the opening or the completion of the
               transition, second_us the completion or the end of the closing
  tracks       stamp_us of each scan; per person x_m, y_m, heading_rad, laser_beams (how many of the scan's
               beams met a shin) and in_camera (whether a camera sees the middle of the body: in its image,
               and neither a wall nor a leaf nor somebody else before it)
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap_ingest.simulation.floor import HALLWAY
from semap_ingest.simulation.motion import STEP_S
from semap_ingest.simulation.person import Person, is_all_inside
from semap_ingest.simulation.schedule import DoorMove, Moments
from semap_ingest.simulation.settings import START_US, OfficeSettings

FORMAT = "semap office labels 1"
PASSED_WITHIN_US = 10_000_000
"""A leaf that is turned by somebody longer before or after a transition has nothing to do with it."""

RelationKind = Literal["opened_then_entered", "opened_then_left", "entered_then_closed", "left_then_closed"]


@dataclass(frozen=True)
class TransitionLabel:
    person: str
    room: str
    kind: Literal["entered", "left"]
    complete_us: int


@dataclass(frozen=True)
class DoorLabel:
    door: str
    room: str
    person: str
    kind: Literal["opening", "closing"]
    start_us: int
    end_us: int


@dataclass(frozen=True)
class RelationLabel:
    kind: RelationKind
    person: str
    room: str
    door: str
    first_us: int
    second_us: int


@dataclass(frozen=True, eq=False)
class TrackLabels:
    """Everybody at each scan: of n people and m scans.

    stamp_us (m,), position_m (n, m, 2), heading_rad (n, m), laser_beams (n, m), in_camera (n, m)
    """

    people: tuple[str, ...]
    stamp_us: NDArray[np.int64]
    position_m: NDArray[np.float64]
    heading_rad: NDArray[np.float64]
    laser_beams: NDArray[np.int64]
    in_camera: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Labels:
    """Each list in the order of its (last) stamps."""

    seed: int
    duration_s: float
    start_us: int
    transitions: tuple[TransitionLabel, ...]
    doors: tuple[DoorLabel, ...]
    relations: tuple[RelationLabel, ...]
    tracks: TrackLabels


def label(settings: OfficeSettings, course: Moments, tracks: TrackLabels) -> Labels:
    """The labels of a recording, from the true state alone: the plan behind it is not asked."""
    transitions = sorted(
        (each for person in course.people for each in _transitions(course, person)),
        key=lambda each: each.complete_us,
    )
    doors = [_door_label(course, move) for move in course.moves]
    relations = sorted(_relations(transitions, doors), key=lambda each: each.second_us)
    return Labels(
        settings.seed,
        course.duration_s,
        START_US,
        tuple(transitions),
        tuple(doors),
        tuple(relations),
        tracks,
    )


def stamp_us(time_s: float) -> int:
    """The stamp of a time since the recording's beginning."""
    return START_US + round(time_s * 1e6)


def write_labels(path: Path, labels: Labels) -> None:
    """Write the file that the head of this module describes."""
    tracks = labels.tracks
    people = {
        name: {
            "x_m": np.round(tracks.position_m[index, :, 0], 4).tolist(),
            "y_m": np.round(tracks.position_m[index, :, 1], 4).tolist(),
            "heading_rad": np.round(tracks.heading_rad[index], 4).tolist(),
            "laser_beams": tracks.laser_beams[index].tolist(),
            "in_camera": tracks.in_camera[index].tolist(),
        }
        for index, name in enumerate(tracks.people)
    }
    document = {
        "format": FORMAT,
        "seed": labels.seed,
        "people": len(tracks.people),
        "duration_s": labels.duration_s,
        "start_us": labels.start_us,
        "transitions": [asdict(each) for each in labels.transitions],
        "doors": [asdict(each) for each in labels.doors],
        "relations": [asdict(each) for each in labels.relations],
        "tracks": {"stamp_us": tracks.stamp_us.tolist(), "people": people},
    }
    path.write_text(json.dumps(document), "utf-8")


def read_labels(path: Path) -> Labels:
    """The labels of a recording.

    raises InvalidInput if the file is missing or not of this form
    """
    try:
        document: Mapping[str, Any] = json.loads(path.read_text("utf-8"))
        if document["format"] != FORMAT:
            raise ValueError(document["format"])
        return Labels(
            int(document["seed"]),
            float(document["duration_s"]),
            int(document["start_us"]),
            tuple(TransitionLabel(**each) for each in document["transitions"]),
            tuple(DoorLabel(**each) for each in document["doors"]),
            tuple(RelationLabel(**each) for each in document["relations"]),
            _read_tracks(document["tracks"]),
        )
    except OSError as error:
        raise InvalidInput(
            f"cannot be read: {error.strerror}",
            "Write the recording with its labels: semap simulate office FOLDER",
            str(path),
        ) from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InvalidInput(
            f"no labels of a simulated office, or of another version ({error!r})",
            "Write them anew: semap simulate office FOLDER",
            str(path),
        ) from error


def _read_tracks(document: Mapping[str, Any]) -> TrackLabels:
    people: Mapping[str, Any] = document["people"]
    stamps = np.array(document["stamp_us"], dtype=np.int64)

    def column(key: str) -> NDArray[Any]:
        return np.array([each[key] for each in people.values()]).reshape(len(people), len(stamps))

    return TrackLabels(
        tuple(people),
        stamps,
        np.stack([column("x_m"), column("y_m")], axis=-1).astype(np.float64),
        column("heading_rad").astype(np.float64),
        column("laser_beams").astype(np.int64),
        column("in_camera").astype(np.bool_),
    )


def _transitions(course: Moments, person: Person) -> list[TransitionLabel]:
    """Whenever all of somebody is in another room than before; in a doorway one is in none."""
    motion = person.motion
    rooms = list(course.floor.rooms)
    inside = np.stack(
        [
            is_all_inside(
                course.floor.rooms[room],
                motion.position_m,
                motion.heading_rad,
                person.width_m,
                person.depth_m,
            )
            for room in rooms
        ]
    )
    samples = np.flatnonzero(inside.any(axis=0))
    room_of = np.argmax(inside[:, samples], axis=0)
    found = []
    for index in np.flatnonzero(np.diff(room_of)) + 1:
        before, now = rooms[room_of[index - 1]], rooms[room_of[index]]
        time_s = float(samples[index]) * STEP_S
        if time_s > course.duration_s:
            continue
        if before != HALLWAY:
            found.append(TransitionLabel(person.name, before, "left", stamp_us(time_s)))
        if now != HALLWAY:
            found.append(TransitionLabel(person.name, now, "entered", stamp_us(time_s)))
    return found


def _door_label(course: Moments, move: DoorMove) -> DoorLabel:
    return DoorLabel(
        move.door,
        course.floor.doors[move.door].room,
        move.person,
        "opening" if move.to_rad > move.from_rad else "closing",
        stamp_us(move.start_s),
        stamp_us(move.end_s),
    )


def _relations(transitions: list[TransitionLabel], doors: list[DoorLabel]) -> list[RelationLabel]:
    found = []
    for each in transitions:
        near = [door for door in doors if (door.room, door.person) == (each.room, each.person)]
        for door in near:
            opened_us = each.complete_us - door.end_us
            closed_us = door.end_us - each.complete_us
            if door.kind == "opening" and 0 < opened_us < PASSED_WITHIN_US:
                kind: RelationKind = "opened_then_entered" if each.kind == "entered" else "opened_then_left"
                found.append(
                    RelationLabel(kind, each.person, each.room, door.door, door.end_us, each.complete_us)
                )
            elif door.kind == "closing" and 0 < closed_us < PASSED_WITHIN_US:
                kind = "entered_then_closed" if each.kind == "entered" else "left_then_closed"
                found.append(
                    RelationLabel(kind, each.person, each.room, door.door, each.complete_us, door.end_us)
                )
    return found
