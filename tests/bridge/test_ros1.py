"""A robot of ROS 1, with a real roscore: the same in and out."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event as Signal

import pytest
from bridging import running
from patience import until
from robots import STRING, Robot, closing, hearing, marks, ros_entry, rows, scanning, told
from rule_work import running_worker
from semap_bridge.adapters.ros.playing import play
from semap_bridge.checking import check_bridge
from semap_bridge.config import Entry, read_config
from semap_bridge.ros.master import Rospy
from semap_bridge.ros.message import messages
from semap_ingest.simulation.office import OfficePaths
from semap_service.processes.port import free_port
from test_ros2 import Dsn

from semap.errors import ServiceUnreachable

PYTHON = "/usr/bin/python3"

pytestmark = pytest.mark.skipif(
    shutil.which("roscore") is None,
    reason="there is no roscore: apt-get install python3-roslaunch python3-rospy python3-std-msgs",
)


@contextmanager
def roscore(port: int, folder: Path) -> Iterator[str]:
    uri = f"http://127.0.0.1:{port}"
    environment = {**os.environ, "ROS_MASTER_URI": uri, "ROS_IP": "127.0.0.1", "ROS_HOME": str(folder)}
    process = subprocess.Popen(
        ["roscore", "-p", str(port)], env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        until(lambda: _answers(port), lambda: process.poll() or "")
        yield uri
    finally:
        process.terminate()
        process.wait()


def _answers(port: int) -> bool:
    try:
        socket.create_connection(("127.0.0.1", port)).close()
    except OSError:
        return False
    return True


@pytest.fixture(scope="module")
def master(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with roscore(free_port(), tmp_path_factory.mktemp("ros")) as uri:
        yield uri


def joined(master: str, node: str) -> Rospy:
    made: list[Rospy] = []

    def tried() -> bool:
        try:
            made.append(Rospy(master, node, "127.0.0.1", PYTHON))
        except ServiceUnreachable:
            return False
        return True

    until(tried)
    return made[0]


def documented(folder: Path, master: str) -> Entry:
    """The config of the documentation, with the master of this test."""
    page = (Path(__file__).parents[2] / "docs/bridges/ros.md").read_text()
    written = page.partition('title="robot-ros1.yaml"\n')[2].partition("```")[0]
    assert "http://127.0.0.1:11311" in written
    (folder / "robot-ros1.yaml").write_text(written.replace("http://127.0.0.1:11311", master))
    (entry,) = read_config(folder / "robot-ros1.yaml").bridges
    return entry


def entry_of(folder: Path, master: str, **settings: object) -> Entry:
    return ros_entry(folder, kind="ros1", master=master, own_address="127.0.0.1", python=PYTHON, **settings)


def test_a_recording_played_by_rospy_is_understood_and_told_of(
    master: str, office_map: str, office: OfficePaths, tmp_path: Path
) -> None:
    with running_worker(office_map), running(Dsn(office_map), documented(tmp_path, master)):
        with closing(joined(master, "player")) as player:
            play(office.recording, player, Signal(), speed=1.0, wait_s=60.0)
            until(lambda: rows(office_map, "select from semap.event"), lambda: str(told(office_map)))
        with closing(joined(master, "listener")) as listener:
            people = hearing(listener, "/semap/people", lambda heard: any(each.people for each in heard))
            (grid, *_) = hearing(listener, "/semap/map", bool)
            found = hearing(
                listener, "/semap/detections", lambda heard: any(each.detections for each in heard)
            )
            (markers, *_) = hearing(listener, "/semap/markers", bool)
            rooms = hearing(listener, "/semap/room", lambda heard: heard and heard[-1].data)
    assert people
    assert found
    assert grid.info.width * grid.info.height == len(grid.data)
    assert rooms[-1].data in {each.text for each in markers.markers}
    said = told(office_map)
    # What is dropped depends on the machine: the recording is played at the pace of a robot.
    assert (said["refused"], said["reconnects"]) == (0, 0)
    kinds = {kind for (kind,) in rows(office_map, "select distinct type from semap.event")}
    assert {"entered"} <= kinds or {"person_entered"} <= kinds


def test_what_rospy_publishes_itself_is_heard(master: str) -> None:
    """By its own message classes and its own codec, with the definition that it tells."""
    script = (
        "import rospy; from std_msgs.msg import String; rospy.init_node('plain');"
        "p = rospy.Publisher('/said', String, latch=True, queue_size=1); p.publish('Küche'); rospy.spin()"
    )
    environment = {**os.environ, "ROS_MASTER_URI": master, "ROS_IP": "127.0.0.1"}
    process = subprocess.Popen([PYTHON, "-c", script], env=environment, stderr=subprocess.DEVNULL)
    try:
        with closing(joined(master, "listener")) as listener:
            (said, *_) = hearing(listener, "/said", bool)
        assert said.data == "Küche"
    finally:
        process.terminate()
        process.wait()


def test_rospys_own_subscriber_takes_our_event(master: str) -> None:
    m = messages(is_ros1=True)
    with closing(joined(master, "teller")) as teller:
        topic = teller.publish("/semap/events", STRING, is_latched=True)
        topic.send(m.write(m.new(STRING, data='{"id": "ä"}')))
        script = (
            "import rospy; from std_msgs.msg import String; rospy.init_node('plain');"
            "print(rospy.wait_for_message('/semap/events', String, 60).data)"
        )
        environment = {
            **os.environ, "ROS_MASTER_URI": master, "ROS_IP": "127.0.0.1", "PYTHONIOENCODING": "utf-8"
        }  # fmt: skip
        done = subprocess.run(
            [PYTHON, "-c", script], env=environment, capture_output=True, check=True, encoding="utf-8"
        )
    assert done.stdout.strip() == '{"id": "ä"}'


def test_a_master_that_goes_away_and_comes_back_is_waited_for(office_map: str, tmp_path: Path) -> None:
    port = free_port()
    with running(Dsn(office_map), entry_of(tmp_path, f"http://127.0.0.1:{port}", tell=[])):
        until(lambda: "No master of ROS answers" in told(office_map)["trouble"])
        for _ in range(2):
            before = marks(office_map).get("robot/lines", 0)
            with roscore(port, tmp_path / "ros") as master, closing(joined(master, "laser")) as graph:
                robot = Robot(graph)
                robot.fix(("map", "laser"))
                robot.stamp_us = max(robot.stamp_us, before)
                scanning(robot, lambda before=before: marks(office_map).get("robot/lines", 0) > before)
            until(lambda: told(office_map)["state"] == "waiting")
    assert told(office_map)["reconnects"] >= 3


def test_a_python_without_rospy_is_told_with_the_remedy(master: str, office_map: str, tmp_path: Path) -> None:
    (sight,) = check_bridge(
        office_map, ros_entry(tmp_path, kind="ros1", master=master, python=sys.executable, tell=[]), 1.0
    )
    assert "rospy could not be started" in sight.trouble
    assert "apt-get install python3-rospy" in sight.remedy
