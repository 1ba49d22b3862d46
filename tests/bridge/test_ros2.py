"""A robot of ROS 2, live: what its sensors say is understood as a recording of it would be, and it is told."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from threading import Event as Signal
from threading import Thread

import numpy as np
import pytest
from bridging import running
from patience import until
from robots import (
    FIRST_US,
    LOOPBACK,
    SCAN,
    STRING,
    Robot,
    closing,
    domain,
    hearing,
    marks,
    ros_entry,
    rows,
    scanning,
    told,
)
from rule_work import running_worker
from semap_bridge.adapter import Settings
from semap_bridge.adapters.ros.playing import play
from semap_bridge.adapters.ros.settings import Ros1Settings, Ros2Settings
from semap_bridge.checking import check_bridge
from semap_bridge.config import read_config
from semap_bridge.ros.dds import Dds, network_config
from semap_bridge.ros.message import messages
from semap_ingest.pipeline.ingest_recording import Plan, ingest_recording
from semap_ingest.simulation.office import OfficePaths, write_office
from semap_ingest.simulation.settings import OfficeSettings
from semap_service.evaluation.office import camera_model
from semap_service.evaluation.play import wait_for_rules

from semap.errors import InvalidInput
from semap.timeline.stamp import to_us

EVENTS = """
    select type, coalesce(measures ->> 'room', instance_name), e.stamp, measures, dense_rank() over (order by first)
    from semap.event e join semap.map m using (map_id)
    left join (select track_id, min(stamp) as first from semap.stored_state group by 1) f using (track_id)
    where m.name = %s and (track_name is null or track_name <> 'robot') order by e.stamp, type, 2
"""

PRESENT = """
    select t.name, n.x_m, n.y_m from semap.track_place n join semap.track t using (track_id)
    where n.live and t.name <> 'robot'
"""


@dataclass
class Dsn:
    """As `running` wants a world."""

    dsn: str


@pytest.fixture
def number() -> int:
    return domain()


@pytest.fixture
def graph(number: int) -> Iterator[Dds]:
    with closing(Dds(number, "robot", network_config(LOOPBACK, []))) as made:
        yield made


def play_both(
    dsn: str, tmp_path: Path, paths: OfficePaths, number: int, speed: float, **settings: object
) -> tuple:
    """The events of a recording's file, and those of it played over DDS."""
    model = settings.get("image_model")
    with running_worker(dsn):
        ingest_recording(dsn, Plan("file", "robot", paths.recording, image_model=model and Path(str(model))))
        end_us = rows(dsn, "select max((extract(epoch from watermark) * 1000000)::bigint) from semap.source")[
            0
        ][0]
        player = Dds(number, "player", network_config(LOOPBACK, []))
        with running(Dsn(dsn), ros_entry(tmp_path, domain=number, **settings)):
            play(paths.recording, player, Signal(), speed=speed, wait_s=60.0)
            # the file's end is one microsecond after its last state, and a camera may wait for its laser
            until(lambda: marks(dsn).get("robot/persons", 0) >= end_us - 300_000, lambda: str(told(dsn)))
            player.close()
        wait_for_rules(dsn)
    of_file, live = (rows(dsn, EVENTS, name) for name in ("file", "office"))
    # who is still there at the file's end leaves with it, and a robot's sensors have none
    return [each for each in of_file if to_us(each[2]) < end_us - 1], live


def test_a_recording_played_over_dds_gives_the_events_of_its_file(
    office_map: str, office: OfficePaths, tmp_path: Path, number: int
) -> None:
    of_file, live = play_both(office_map, tmp_path, office, number, 1.0, robot="base_link")
    assert live == of_file
    assert len(live) > 1
    said = told(office_map)
    assert (said["dropped"], said["refused"], said["reconnects"]) == (0, 0, 0)
    steps = rows(
        office_map,
        "select count(*), count(heading_rad) from semap.stored_state join semap.track t using (track_id)"
        " where t.name = 'robot'",
    )
    assert steps[0][0] == steps[0][1] > 30, "the robot itself is a track"


@pytest.mark.slow
def test_so_does_one_with_a_camera(office_map: str, tmp_path: Path, number: int) -> None:
    paths = write_office(tmp_path / "camera", OfficeSettings(seed=3, people=3, duration_s=25.0))
    model = str(camera_model())
    of_file, live = play_both(office_map, tmp_path, paths, number, 0.5, image_model=model)
    assert [each[:2] for each in live] == [each[:2] for each in of_file]


def test_what_is_told_of_a_map(office_map: str, tmp_path: Path, number: int, graph: Dds) -> None:
    """Latched: who comes later hears it too."""
    with running(Dsn(office_map), ros_entry(tmp_path, domain=number, sense=False)):
        (grid, *_) = hearing(graph, "/semap/map", bool)
        (markers, *_) = hearing(graph, "/semap/markers", bool)
        (people, *_) = hearing(graph, "/semap/people", bool)
        (room, *_) = hearing(graph, "/semap/room", bool)
    names = {
        name
        for (name,) in rows(
            office_map,
            "select i.name from semap.instance i join semap.map m using (map_id) join semap.concept c using (concept_id) where m.name = 'office' and c.name = 'Room'",
        )
    }
    assert names <= {each.text for each in markers.markers}
    assert grid.header.frame_id == "map"
    assert (grid.info.width * grid.info.height, set(np.unique(grid.data)) - {-1}) == (
        len(grid.data),
        {0, 100},
    )
    assert (people.people, room.data) == ([], "")


def test_people_and_events_are_told(
    office_map: str, office: OfficePaths, tmp_path: Path, number: int
) -> None:
    with (
        running_worker(office_map),
        closing(Dds(number, "listener", network_config(LOOPBACK, []))) as listener,
    ):
        entry = ros_entry(tmp_path, domain=number, robot="base_link", from_start=True)
        with running(Dsn(office_map), entry):
            player = Dds(number, "player", network_config(LOOPBACK, []))
            play(office.recording, player, Signal(), speed=1.0, wait_s=60.0)
            wait_for_rules(office_map)
            count = rows(office_map, "select count(*) from semap.event")[0][0]
            who = {name: (x_m, y_m) for name, x_m, y_m in rows(office_map, PRESENT)}
            people = hearing(
                listener,
                "/semap/people",
                lambda heard: (
                    heard
                    and who == {each.name: (each.position.x, each.position.y) for each in heard[-1].people}
                ),
            )
            found = hearing(
                listener, "/semap/detections", lambda heard: heard and len(heard[-1].detections) == len(who)
            )
            rooms = hearing(listener, "/semap/room", lambda heard: heard and heard[-1].data)
            player.close()
        with running(
            Dsn(office_map), ros_entry(tmp_path, domain=number, tell=["events"], from_start=True, sense=False)
        ):
            until(lambda: told(office_map)["delivered"] == 0)
    last = people[-1].people
    assert last
    assert all(each.tags[1] for each in last), "each is in a room"
    assert {each.id for each in found[-1].detections} == {each.name for each in last}
    assert [each.results[0].hypothesis.class_id for each in found[-1].detections] == ["person"] * len(last)
    assert rooms[-1].data in {name for (name,) in rows(office_map, "select name from semap.instance")}
    assert told(office_map)["state"] == "ended"
    assert count > 2


def test_an_event_is_told_as_json_and_as_a_message(
    office_map: str, tmp_path: Path, number: int, graph: Dds
) -> None:
    with running(Dsn(office_map), ros_entry(tmp_path, domain=number, sense=False, tell=["events"])):
        until(lambda: {"/semap/events", "/semap/event"} <= {each.topic for each in graph.offers()})
        graph.hear([each for each in graph.offers() if each.topic in ("/semap/events", "/semap/event")])
        until(lambda: told(office_map)["state"] == "connected")
        made = []

        def heard() -> list:
            made.extend(rows(
                office_map,
                "insert into semap.event (seq, event_id, map_id, type, stamp, rule_version, rule_name, since)"
                " select coalesce((select max(seq) from semap.event), 0) + 1, gen_random_uuid(), map_id, 'told', now(), 1,"
                " r.name, now() from semap.rule r join semap.map m using (map_id) where m.name = 'office' limit 1"
                " returning event_id::text",
            ))  # fmt: skip
            return graph.take(1.0)

        first = []
        until(lambda: first.extend(heard()) or len({each.topic for each in first}) == 2)
    m = messages(is_ros1=False)
    as_json = next(json.loads(m.read(each.raw, STRING).data) for each in first if each.type == STRING)
    event = next(m.read(each.raw, each.type) for each in first if each.type == "semap_msgs/msg/Event")
    assert as_json["id"] == event.id == json.loads(event.json)["id"]
    assert (event.id,) in made
    assert (event.type, event.map, event.sequence) == ("told", "office", int(as_json["sequence"]))


def perceived(dsn: str, tmp_path: Path, number: int, **settings: object):
    return running(Dsn(dsn), ros_entry(tmp_path, domain=number, tell=[], **settings))


def test_frames_that_are_never_connected_are_told(
    office_map: str, tmp_path: Path, number: int, graph: Dds
) -> None:
    robot = Robot(graph)
    robot.fix(("base", "laser"))
    with perceived(office_map, tmp_path, number):
        scanning(robot, lambda: told(office_map)["refusals"])
    (reason,) = told(office_map)["refusals"]
    assert reason == "/scan: where it was seen from is not known: no transform names the frame 'map'"
    entry = ros_entry(tmp_path, domain=number, tell=[])
    stop = Signal()

    def go_on() -> None:
        while not stop.wait(0.05):
            robot.scan()

    thread = Thread(target=go_on)
    thread.start()
    sights = check_bridge(office_map, entry, 4.0)
    stop.set()
    thread.join()
    missing = next(each for each in sights if each.what == "transform of /scan")
    assert "'map'" in missing.trouble
    assert "transforms name base, laser" in missing.remedy
    scan = next(each for each in sights if each.what == "/scan")
    assert (scan.is_a, scan.trouble) == (SCAN, "")
    assert scan.rate_hz > 0


def test_scans_of_10000_beams_and_those_without_stamps_are_taken(
    office_map: str, tmp_path: Path, number: int, graph: Dds
) -> None:
    robot = Robot(graph)
    robot.fix(("map", "laser"))
    with perceived(office_map, tmp_path, number):
        scanning(
            robot, lambda: len(rows(office_map, "select from semap.line_observation limit 1")), beams=10_000
        )
        assert told(office_map)["refusals"] == {}
        scanning(robot, lambda: marks(office_map).get("robot/lines", 0) > 1_750_000_000_000_000, stamp_us=0)


def test_stamps_ahead_of_this_clock_are_refused_and_leave_no_mark(
    office_map: str, tmp_path: Path, number: int, graph: Dds
) -> None:
    """Else all that comes with the right stamps would be late, once the clock is set."""
    robot = Robot(graph)
    robot.fix(("map", "laser"))
    ahead_us = to_us(datetime.now(UTC)) + 3_600_000_000
    with perceived(office_map, tmp_path, number):
        scanning(robot, lambda: told(office_map)["refusals"], stamp_us=ahead_us)
        assert set(told(office_map)["refusals"]) == {"stamp in the future"}
        assert not marks(office_map)
        scanning(robot, lambda: marks(office_map).get("robot/lines"))
        assert FIRST_US < marks(office_map)["robot/lines"] < ahead_us


def test_a_clock_that_is_set_back_begins_anew(
    office_map: str, tmp_path: Path, number: int, graph: Dds
) -> None:
    robot = Robot(graph)
    robot.fix(("map", "laser"))
    with perceived(office_map, tmp_path, number):
        scanning(robot, lambda: marks(office_map).get("robot/lines", 0) > FIRST_US)
        robot.stamp_us = FIRST_US - 3_600_000_000
        before = "select from semap.line_observation where stamp < to_timestamp(%s) limit 1"
        scanning(robot, lambda: rows(office_map, before, FIRST_US / 1e6))
        stamps = told(office_map)
        assert stamps["reconnects"] == 0


@pytest.mark.parametrize(
    ("type_name", "topics", "said"),
    [
        (STRING, {"scan": "/front"}, "/front is of the type std_msgs/msg/String"),
        ("sensor_msgs/msg/PointCloud2", {"scan": "/front"}, "/front is of sensor_msgs/msg/PointCloud2, which is not read"),
        ("sensor_msgs/msg/PointCloud2", {}, "/front is of sensor_msgs/msg/PointCloud2, which is not read"),
        (STRING, {"scan": "/back"}, "nobody publishes /back"),
        (STRING, {"nose": "/front"}, "there is no part 'nose'"),
        (SCAN, {"poses": "/front"}, "/front is of the type sensor_msgs/msg/LaserScan"),
    ],
)  # fmt: skip
def test_a_topic_of_a_wrong_type_is_told_with_the_remedy(
    office_map: str,
    tmp_path: Path,
    number: int,
    graph: Dds,
    type_name: str,
    topics: dict[str, str],
    said: str,
) -> None:
    graph.publish("/front", type_name)
    with perceived(office_map, tmp_path, number, topics=topics):
        until(lambda: said in told(office_map)["trouble"], lambda: told(office_map)["trouble"])
        assert told(office_map)["state"] == "waiting"
    sights = check_bridge(office_map, ros_entry(tmp_path, domain=number, topics=topics, tell=[]), 3.0)
    trouble = next(each for each in sights if each.what == "sensors")
    assert said in trouble.trouble
    if "PointCloud2" in type_name:
        assert "pointcloud_to_laserscan" in trouble.remedy


def test_two_publishers_of_one_scan_are_told(
    office_map: str, tmp_path: Path, number: int, graph: Dds
) -> None:
    robot = Robot(graph)
    with closing(Dds(number, "intruder", network_config(LOOPBACK, []))) as other:
        other.publish("/scan", SCAN)
        robot.scan()
        sights = check_bridge(office_map, ros_entry(tmp_path, domain=number, tell=[]), 4.0)
    scan = next(each for each in sights if each.what == "/scan")
    assert scan.trouble == "2 publishers share it (/intruder, /robot)"


def test_a_pose_of_a_wrong_type_is_told(office_map: str, tmp_path: Path, number: int, graph: Dds) -> None:
    graph.publish("/amcl_pose", "geometry_msgs/msg/PoseStamped")
    sights = check_bridge(
        office_map, ros_entry(tmp_path, domain=number, robot_pose="/amcl_pose", tell=[]), 3.0
    )
    trouble = next(each for each in sights if each.what == "sensors")
    assert "/amcl_pose is of the type geometry_msgs/msg/PoseStamped" in trouble.trouble
    assert "PoseWithCovarianceStamped" in trouble.remedy


def test_the_robots_place_by_a_pose(office_map: str, tmp_path: Path, number: int, graph: Dds) -> None:
    robot = Robot(graph)
    pose = "geometry_msgs/msg/PoseWithCovarianceStamped"
    places = graph.publish("/amcl_pose", pose)
    m = robot.m
    with perceived(office_map, tmp_path, number, robot_pose="/amcl_pose", robot_name="tug"):

        def told_of() -> list[tuple]:
            robot.stamp_us += 200_000
            where = m.new("geometry_msgs/msg/PoseWithCovariance", pose=m.pose(2.0, 3.0, 0.0, 1.0))
            places.send(m.write(m.new(pose, header=m.header(robot.stamp_us, "map"), pose=where)))
            return rows(
                office_map,
                "select x_m, y_m, heading_rad, t.name from semap.stored_state join semap.track t using (track_id)",
            )

        until(told_of)
    x_m, y_m, heading_rad, name = told_of()[0]
    assert (x_m, y_m, name) == (2.0, 3.0, "tug")
    assert heading_rad == pytest.approx(1.0)


def test_a_bridge_that_was_killed_leaves_no_track_open(
    office_map: str, office: OfficePaths, tmp_path: Path, number: int
) -> None:
    opened = "select count(*) from semap.track where ended_at is null"
    with running(Dsn(office_map), ros_entry(tmp_path, domain=number, tell=[])):
        player = Dds(number, "player", network_config(LOOPBACK, []))
        play(office.recording, player, Signal(), speed=1.0, wait_s=60.0)
        until(lambda: rows(office_map, opened)[0][0] > 0)
    assert rows(office_map, opened)[0][0] > 0
    with running(Dsn(office_map), ros_entry(tmp_path, domain=number, tell=[])):
        until(lambda: rows(office_map, opened)[0][0] == 0)
    player.close()


def test_settings_that_cannot_be_are_refused(tmp_path: Path) -> None:
    for settings in (
        {"domain": 300},
        {"interface": "a b"},
        {"topics": {"scan": "scan"}},
        {"tell": ["all"]},
        {"people_hz": 0},
    ):
        with pytest.raises(InvalidInput):
            ros_entry(tmp_path, **settings)


def test_the_config_of_the_documentation_is_one(tmp_path: Path) -> None:
    """And its table of settings has them all, but those that each bridge has."""
    page = (Path(__file__).parents[2] / "docs/bridges/ros.md").read_text()
    (tmp_path / "robot.yaml").write_text(page.partition('title="robot.yaml"\n')[2].partition("```")[0])
    (entry,) = read_config(tmp_path / "robot.yaml").bridges
    assert (entry.map_name, entry.settings.name, entry.settings.kind) == ("office", "robot", "ros2")
    own = (Ros2Settings.model_fields.keys() | Ros1Settings.model_fields.keys()) - Settings.model_fields.keys()
    of_recordings = {"image_layout", "class_names", "person_classes", "floor_z_m"}
    assert {name for name in own if f"`{name}`" not in page} <= of_recordings
