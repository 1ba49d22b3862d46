"""`semap log mcap`: a file with the topics that the app is given live, read by the format's own library."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from furnished import furnish
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from semap_bridge.adapters.foxglove.channels import OWN_TOPICS
from semap_ingest.recording.reading import Recording
from semap_ingest.simulation.office import OfficePaths, write_office
from semap_ingest.simulation.settings import OfficeSettings
from world import SECOND_US, World

FIRST_US = 1_700_000_000 * SECOND_US
DOOR = (
    "insert into semap.object_state (uid, map_id, source_id, instance_id, instance_name, property, value, stamp)"
    " select gen_random_uuid(), map_id, %s, instance_id, name, 'door', %s, to_timestamp(%s)"
    " from semap.instance where name = 'door'"
)
LINE = (
    "insert into semap.line_observation (source_id, stamp, x1_m, y1_m, x2_m, y2_m, angle_std_rad, offset_std_m, points)"
    " values (%s, to_timestamp(%s), 1, 2, 3, 4, 0.1, 0.1, 5)"
)
EVENT = (
    "insert into semap.event (seq, event_id, map_id, type, stamp, rule_version, rule_name, since)"
    " values (1, gen_random_uuid(), %s, 'told', to_timestamp(%s), 1, 'room_visits', now())"
)
MOVED = (
    "insert into semap.frame_pose (frame_id, stamp, x_m) select frame_id, to_timestamp(%s), 3 from semap.frame"
    " where name = 'table'"
)


def written(world: World, file: Path, *arguments: object) -> list[tuple[str, int, object]]:
    """Topic, log time [us] and message of all that the command writes, in the order of time."""
    ran = semap(world, file, *arguments)
    assert ran.returncode == 0, ran.stderr
    return read(file)


def semap(world: World, file: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "semap_service", "log", "mcap", str(file), "--map", "world", *map(str, arguments)],
        env={**os.environ, "SEMAP_DSN": world.dsn}, capture_output=True, text=True, check=False,
    )  # fmt: skip


def read(file: Path) -> list[tuple[str, int, object]]:
    with file.open("rb") as opened:
        reader = make_reader(opened, decoder_factories=[DecoderFactory(), Json()])
        return [
            (channel.topic, message.log_time // 1000, decoded)
            for _, channel, message, decoded in reader.iter_decoded_messages()
        ]


class Json:
    """Of messages that are JSON."""

    def decoder_for(self, encoding: str, _: object):
        return json.loads if encoding == "json" else None


@pytest.fixture
def lived_in(world: World) -> World:
    """Two walk; a door opens and closes; a line was seen, the table moved, an event happened."""
    furnish(world)
    cat, dog = world.add_track("cat"), world.add_track("dog")
    for second in range(10):
        world.add_states([(cat, FIRST_US + second * SECOND_US, 0.5 + second, 1.0, 1.0, second == 9)])
    world.add_states([(dog, FIRST_US + 2_500_000, 1.0, 1.0, 1.0)])
    first_s = FIRST_US // SECOND_US
    for value, second in (("open", 3), ("closed", 5)):
        world.run(DOOR, world.source_id, value, first_s + second)
    world.run(LINE, world.source_id, first_s + 4)
    world.run(EVENT, world.map_id, first_s + 6)
    world.run(MOVED, first_s + 7)
    return world


def test_all_that_happened_is_in_the_file(lived_in: World, tmp_path: Path) -> None:
    found = written(lived_in, tmp_path / "walk.mcap")
    assert {topic for topic, _, _ in found} == OWN_TOPICS
    assert [stamp_us for _, stamp_us, _ in found] == sorted(stamp_us for _, stamp_us, _ in found)
    seen = {
        (entity.id, stamp_us, entity.cylinders[0].pose.position.x)
        for topic, stamp_us, update in found if topic == "/semap/people" for entity in update.entities
    }  # fmt: skip
    stored = lived_in.rows(
        "select 'track/' || track_id, (extract(epoch from stamp) * 1000000)::bigint, x_m from semap.stored_state"
        " where not is_last"
    )
    assert seen == set(stored)
    gone = [
        (each.id, stamp_us)
        for topic, stamp_us, update in found if topic == "/semap/people" for each in update.deletions
    ]  # fmt: skip
    assert {stamp_us for _, stamp_us in gone} == {FIRST_US + 9 * SECOND_US}
    doors = [
        ((stamp_us - FIRST_US) / SECOND_US, state["doors"][0]["value"])
        for topic, stamp_us, state in found if topic == "/semap/state"
    ]  # fmt: skip
    assert [each for i, each in enumerate(doors) if i == 0 or each[1] != doors[i - 1][1]] == [
        (0.0, "unknown"), (3.0, "open"), (5.0, "closed")
    ]  # fmt: skip
    moved = [update.transforms[0] for topic, _, update in found if topic == "/tf"]
    assert [(each.child_frame_id, each.translation.x) for each in moved] == [("table", 3.0)]
    (lines,) = [update.entities[0].lines[0] for topic, _, update in found if topic == "/semap/lines"]
    assert [(p.x, p.y) for p in lines.points] == [(1, 2), (3, 4)]


def test_the_timeline_says_who_was_in_which_room(lived_in: World, tmp_path: Path) -> None:
    """At each moment as the relations say it, which another part of semap made."""
    found = written(lived_in, tmp_path / "walk.mcap")
    for topic, stamp_us, state in found:
        if topic == "/semap/state":
            inside = Counter(dict(lived_in.rows(
                "select i.name, count(distinct track_id) from semap.stays(%s, to_timestamp(%s), to_timestamp(%s)) s"
                " join semap.instance i using (instance_id)"
                " where s.since <= to_timestamp(%s) and (s.until is null or s.until > to_timestamp(%s)) group by 1",
                lived_in.map_id, *[stamp_us / 1e6] * 4,
            )))  # fmt: skip
            assert {each["label"]: each["value"] for each in state["rooms"]} == {
                room: inside[room] for room in ("hall", "kitchen")
            }


def test_a_stretch_of_time_is_cut_out(lived_in: World, tmp_path: Path) -> None:
    found = written(
        lived_in, tmp_path / "part.mcap", "--from", "2023-11-14T22:13:22Z", "--to", "2023-11-14T22:13:24Z"
    )
    assert {(stamp_us - FIRST_US) / SECOND_US for topic, stamp_us, _ in found if topic == "/semap/people"} == {
        2.0, 2.5, 3.0
    }  # fmt: skip


def test_a_map_of_which_nothing_was_said_is_told_so(world: World, tmp_path: Path) -> None:
    ran = semap(world, tmp_path / "none.mcap")
    assert ran.returncode != 0
    assert "nothing was said of the map world yet" in ran.stderr
    assert "--from and --to" in ran.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_is_full_is_told_once_and_nothing_is_left(lived_in: World, tmp_path: Path) -> None:
    """As a limit of the process says it, at 4 KiB."""
    command = f"ulimit -f 4; exec {sys.executable} -m semap_service log mcap {tmp_path}/full.mcap --map world"
    ran = subprocess.run(
        ["bash", "-c", command], env={**os.environ, "SEMAP_DSN": lived_in.dsn, "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ran.returncode != 0
    assert ran.stderr.count("cannot be written: File too large") == 1
    assert "Error" not in ran.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def office(tmp_path_factory) -> OfficePaths:
    """A second of a laser and a camera."""
    folder = tmp_path_factory.mktemp("office") / "short"
    return write_office(folder, OfficeSettings(seed=3, people=2, duration_s=1.0))


def test_scans_and_images_of_a_recording_are_put_in(
    world: World, office: OfficePaths, tmp_path: Path
) -> None:
    with Recording(office.recording) as recording:
        given = list(recording.records())
        span = [
            np.datetime_as_string(np.datetime64(each, "us")) + "Z"
            for each in (recording.start_us, recording.end_us + 1)
        ]
    found = written(
        world, tmp_path / "office.mcap", "--from", span[0], "--to", span[1], "--recording", office.recording
    )
    kinds = Counter(type(each.value).__name__ for each in given)
    topics = Counter(topic for topic, _, _ in found)
    assert kinds["Scan"] > 5
    assert (topics["/scan"], topics["/image"]) == (kinds["Scan"], kinds["Image"] + kinds["CompressedImage"])
    assert topics["/tf"] == kinds["Transform"]
    (first, *_) = [each.value for each in given if type(each.value).__name__ == "Scan"]
    scan = next(message for topic, _, message in found if topic == "/scan")
    assert scan.frame_id == first.frame
    assert np.allclose(np.array(scan.ranges)[first.is_return], first.ranges_m[first.is_return])
    assert np.isinf(np.array(scan.ranges)[~first.is_return]).all()
    image = next(message for topic, _, message in found if topic == "/image")
    assert image.data
