"""The Foxglove app is given the whole map, who is on it and what happens: seen by a client that trusts schemas alone."""

from __future__ import annotations

import json
import math
import re
import socket
import ssl
from base64 import b64encode
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from pathlib import Path

import foxglove
import numpy as np
import pytest
from bridging import config, report, running, self_signed
from foxglove.websocket import Capability
from foxglove_client import AppClient, app_client
from furnished import TABLE_M, furnish
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from patience import until
from robots import LOOPBACK, Robot, domain, scanning
from scipy.stats import chi2
from semap_bridge.adapters.foxglove.bridge import LAYOUT
from semap_bridge.adapters.foxglove.channels import OWN_TOPICS, Channels
from semap_bridge.adapters.foxglove.listening import Listening
from semap_bridge.adapters.foxglove.sensors import box_annotations, laser_scan
from semap_bridge.checking import check_bridge
from semap_bridge.config import Entry, read_config
from semap_bridge.context import Context
from semap_bridge.ros.dds import Dds, network_config
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.scan import Scan
from semap_service.processes.port import free_port
from sqlalchemy import create_engine
from stateful_oracle import Sample
from websockets.exceptions import ConnectionClosed
from world import SECOND_US, World

FIRST_US = 1_700_000_000 * SECOND_US
EVENT = (
    "insert into semap.event (seq, event_id, map_id, type, stamp, rule_version, rule_name, track_name,"
    " instance_name, since) select coalesce((select max(seq) from semap.event), 0) + 1, gen_random_uuid(), %s,"
    " 'went_in', to_timestamp(%s), 1, 'room_visits', 'cat', 'kitchen', now() returning event_id"
)
DOOR = (
    "insert into semap.object_state (uid, map_id, source_id, instance_id, instance_name, property, value, stamp)"
    " select gen_random_uuid(), map_id, %s, instance_id, name, 'door', 'open', to_timestamp(%s)"
    " from semap.instance where name = 'door'"
)
OPS = st.sampled_from(["advertise", "unadvertise", "subscribe", "unsubscribe", "getParameters", "nonsense"])
JSON = st.recursive(
    st.none() | st.integers(-2, 2**33) | st.text(max_size=5) | st.sampled_from(["/semap/people", "/scan"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(
        st.sampled_from(["op", "channels", "id", "topic", "encoding", "schemaName", "schema", "channelIds"]), inner
    ),
)  # fmt: skip
SAID = (
    st.builds(lambda op, rest: json.dumps({**(rest if isinstance(rest, dict) else {}), "op": op}), OPS, JSON)
    | st.binary(max_size=40)
    | st.text(max_size=40)
)


def serving(folder: Path, **settings: object) -> Entry:
    written = "".join(f"    {name}: {json.dumps(value)}\n" for name, value in settings.items())
    return read_config(config(folder, f"  - name: app\n    kind: foxglove\n{written}")).bridges[0]


@contextmanager
def served(world: World, folder: Path, **settings: object) -> Iterator[int]:
    """The port of a bridge that runs as long as this lasts."""
    port = free_port()
    with running(world, serving(folder, port=port, **settings)):
        yield port


@contextmanager
def shown(port: int) -> Iterator[AppClient]:
    """A client that has subscribed to all of semap's topics."""
    with app_client(port) as client:
        until(lambda: client.hear() or client.topics.keys() >= OWN_TOPICS)
        client.subscribe(OWN_TOPICS)
        yield client


def entities(client: AppClient, topic: str) -> dict[str, object]:
    """What a scene shows: the newest of each id, without those that were deleted."""
    there: dict[str, object] = {}
    for update in client.of(topic):
        for each in update.deletions:
            there.pop(each.id, None)
        for each in update.entities:
            there[each.id] = each
    return there


def named(client: AppClient, topic: str) -> dict[str, object]:
    return {
        next(pair.value for pair in each.metadata if pair.key == "name"): each
        for each in entities(client, topic).values()
    }


def test_every_topic_is_decoded_by_its_own_schema(world: World, tmp_path: Path) -> None:
    furnish(world)
    cat = world.add_track("cat")
    with served(world, tmp_path) as port, shown(port) as client:
        until(lambda: named(client, "/semap/building").keys() == {"kitchen", "hall", "table"})
        until(lambda: named(client, "/semap/doors").keys() == {"door"})
        world.add_samples(
            cat, [Sample(FIRST_US, 1.0, 2.0, 1.2, std_m=0.3, std_across_m=0.1, std_yaw_rad=0.5)]
        )
        event_id = world.one(EVENT, world.map_id, FIRST_US // SECOND_US)
        until(lambda: named(client, "/semap/people").keys() == {"cat"})
        until(lambda: client.of("/semap/events") and client.of("/semap/log"))
        until(lambda: client.of("/semap/state")[-1]["people"] == [{"label": "cat", "value": "kitchen"}])
        until(lambda: client.of("/tf_static"))
    building = named(client, "/semap/building")
    corners = np.array([(p.x, p.y, p.z) for p in building["table"].triangles[0].points])
    assert len(building["table"].triangles[0].indices) == 36
    assert np.allclose(np.ptp(corners, axis=0), (TABLE_M[1], TABLE_M[0], TABLE_M[2]))
    assert np.allclose((corners.max(axis=0) + corners.min(axis=0)) / 2, (2, 2, 0.35))
    floor = building["kitchen"].triangles[0]
    assert {(p.x, p.y, p.z) for p in floor.points} == {(0, 0, 0), (4, 0, 0), (4, 3, 0), (0, 3, 0)}
    assert {line.points[0].z for line in building["kitchen"].lines} == {0, 2.5}
    cube = named(client, "/semap/doors")["door"].cubes[0]
    assert (cube.pose.position.x, cube.pose.position.y, cube.size.x) == pytest.approx((4, 1.5, 1.0))
    assert abs(2 * math.atan2(cube.pose.orientation.z, cube.pose.orientation.w)) == pytest.approx(math.pi / 2)
    body, ellipse = named(client, "/semap/people")["cat"].cylinders
    assert (body.pose.position.x, body.pose.position.y, body.pose.position.z) == (1.0, 2.0, 1.2)
    turn = ellipse.pose.orientation
    covariance_m2 = np.array([[0.3**2, 0], [0, 0.1**2]])
    radius = math.sqrt(chi2.ppf(0.95, 2))
    assert (ellipse.size.x, ellipse.size.y) == pytest.approx(2 * radius * np.sqrt(np.diag(covariance_m2)))
    assert 2 * math.atan2(turn.z, turn.w) == pytest.approx(0.5)
    frames = {each.child_frame_id: each for each in client.of("/tf_static")[-1].transforms}
    assert (frames["table"].translation.x, frames["table"].translation.z) == pytest.approx((2, 0.35))
    (event,) = client.of("/semap/events")
    assert (event["id"], event["data"]["type"]) == (str(event_id), "went_in")
    (line,) = client.of("/semap/log")
    assert (line.message, line.name, line.timestamp.seconds) == (
        "cat went in kitchen",
        "room_visits",
        FIRST_US // SECOND_US,
    )
    assert {rooms["label"]: rooms["value"] for rooms in client.of("/semap/state")[-1]["rooms"]} == {
        "kitchen": 1,
        "hall": 0,
    }
    times = {log_time_ns for topic, log_time_ns, _ in client.came if topic == "/semap/people"}
    assert times == {FIRST_US * 1000}


def test_who_comes_later_sees_all_and_what_is_gone_is_taken_away(world: World, tmp_path: Path) -> None:
    furnish(world)
    cat, dog = world.add_track("cat"), world.add_track("dog")
    world.add_states([(cat, FIRST_US, 1.0, 2.0, 1.2), (dog, FIRST_US, 8.0, 1.0, 1.2)])
    with served(world, tmp_path) as port, shown(port) as first:
        until(lambda: named(first, "/semap/people").keys() == {"cat", "dog"})
        with shown(port) as second:
            until(lambda: named(second, "/semap/people").keys() == {"cat", "dog"})
            until(lambda: named(second, "/semap/building").keys() == {"kitchen", "hall", "table"})
            until(lambda: named(second, "/semap/doors").keys() == {"door"} and second.of("/semap/state"))
        world.add_states([(dog, FIRST_US + SECOND_US, 8.0, 1.0, 1.2, True)])
        world.run("delete from semap.instance where name = 'table'")
        until(lambda: named(first, "/semap/people").keys() == {"cat"})
        until(lambda: named(first, "/semap/building").keys() == {"kitchen", "hall"})
        until(lambda: first.of("/semap/state")[-1]["people"] == [{"label": "cat", "value": "kitchen"}])
        world.run(DOOR, world.source_id, FIRST_US // SECOND_US + 2)
        until(lambda: first.of("/semap/state")[-1]["doors"] == [{"label": "door", "value": "open"}])


def test_scans_and_boxes_come_from_whoever_publishes_them(world: World, tmp_path: Path) -> None:
    """A node of a robot publishes; the app, which came before it, sees them; what is semap's own stays so."""
    seen = Scan(FIRST_US, "laser", -1.0, 0.5, 0.1, 10.0, np.array([1.0, np.nan, 3.0, 20.0, 2.0], np.float32))
    found = Boxes(
        FIRST_US, "camera", np.array([[10.0, 20.0, 30.0, 40.0]]), np.array([0.9]), ("person",), np.array([7])
    )
    with served(world, tmp_path, relay=True) as port, app_client(port) as app, app_client(port) as robot:
        for number, (topic, made) in enumerate(
            {
                "/scan": laser_scan(seen),
                "/image/boxes": box_annotations(found),
                "/semap/people": laser_scan(seen),
            }.items()
        ):
            schema = made.get_schema()
            robot.advertise(
                number, topic, encoding="protobuf", schemaName=schema.name, schemaEncoding=schema.encoding,
                schema=b64encode(schema.data).decode(),
            )  # fmt: skip
            if topic not in OWN_TOPICS:
                until(lambda topic=topic: app.hear() or topic in app.topics)
                app.subscribe([topic])
            until(
                lambda topic=topic, number=number, made=made: (
                    robot.publish(number, made.encode()) or topic in OWN_TOPICS or app.of(topic)
                )
            )
        until(lambda: "topic of semap's own" in str(report(world, "app")["refusals"]))
    scan = app.of("/scan")[0]
    assert (scan.frame_id, scan.start_angle, scan.end_angle) == ("laser", -1.0, 1.0)
    assert list(scan.ranges) == [1.0, math.inf, 3.0, math.inf, 2.0]
    boxes = app.of("/image/boxes")[0]
    assert [(p.x, p.y) for p in boxes.points[0].points] == [(10, 20), (30, 20), (30, 40), (10, 40)]
    assert boxes.texts[0].text == "person 0.90 #7"


def test_a_robots_own_topics_are_seen_while_somebody_looks(world: World, tmp_path: Path) -> None:
    """Frames once and for all come to each that subscribes; what nobody looks at is not heard."""
    number = domain()
    with (
        closing(Dds(number, "robot", network_config(LOOPBACK, []))) as graph,
        served(world, tmp_path, ros2={"domain": number, "interface": LOOPBACK}) as port,
    ):
        robot = Robot(graph)
        robot.fix(("base_link", "laser"))
        for _ in range(2):
            with app_client(port) as app:
                until(lambda: app.hear() or app.topics.keys() >= {"/scan", "/robot/tf_static"})
                app.subscribe(["/scan", "/robot/tf_static"])
                scanning(robot, lambda: app.of("/scan") and app.of("/robot/tf_static"))
                scan, fixed = app.of("/scan")[-1], app.of("/robot/tf_static")[-1]
            assert (scan.header.frame_id, len(scan.ranges)) == ("laser", 181)
            assert "laser" in {each.child_frame_id for each in fixed.transforms}
            until(lambda: robot.scans.listeners() == 0)


def test_nobody_publishes_unless_that_is_allowed(world: World, tmp_path: Path) -> None:
    with served(world, tmp_path) as port, app_client(port) as robot:
        until(lambda: robot.hear() or robot.server)
        assert "clientPublish" not in robot.server["capabilities"]


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(said=st.lists(SAID, max_size=20))
def test_whatever_a_client_says_the_others_are_served(relaying: int, said: list[str | bytes]) -> None:
    with app_client(relaying) as hostile:
        with suppress(ConnectionClosed):
            for each in said:
                hostile.socket.send(each)
        with app_client(relaying) as app:
            until(lambda: app.hear() or app.topics.keys() >= OWN_TOPICS)


@pytest.fixture(scope="module")
def relaying() -> Iterator[int]:
    """The port of a server whose clients may publish."""
    told = Context("map", "app", "app", create_engine("sqlite://"), ThreadPoolExecutor(1))
    scene = foxglove.Context()
    Channels(scene)
    server = foxglove.start_server(
        port=0, context=scene, server_listener=Listening(scene, told, relay=True),
        capabilities=[Capability.ClientPublish], supported_encodings=["json"],
    )  # fmt: skip
    yield server.port
    server.stop()


def test_topics_of_who_went_away_go_with_them(relaying: int) -> None:
    with app_client(relaying) as app:
        with app_client(relaying) as robot:
            robot.advertise(1, "/passing")
            until(lambda: app.hear() or "/passing" in app.topics)
        until(lambda: app.hear() or "/passing" not in app.topics)


def test_a_port_that_is_taken_is_waited_for(world: World, tmp_path: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with running(world, serving(tmp_path, port=port)):
            until(lambda: f"127.0.0.1:{port} cannot be served" in str(report(world, "app").get("trouble")))
            other.close()
            with shown(port) as client:
                until(lambda: client.of("/tf_static"))


def test_a_check_says_what_there_is(world: World, tmp_path: Path) -> None:
    furnish(world)
    sights = check_bridge(world.dsn, serving(tmp_path, port=0), 0.1)
    assert {each.what: each.is_a for each in sights if not each.what.startswith("ws://")} == {
        "rooms": "2", "doors": "1", "furniture and other things": "1"
    }  # fmt: skip
    assert not any(each.trouble for each in sights)
    assert world.one("select count(*) from semap.bridge") == 0


def test_with_a_certificate_it_is_encrypted(world: World, tmp_path: Path) -> None:
    made = self_signed(tmp_path)
    with (
        served(world, tmp_path, tls={"certificate_file": "server.pem", "key_file": "server.key"}) as port,
        app_client(port, ssl.create_default_context(cafile=made)) as client,
    ):
        until(lambda: client.hear() or client.topics.keys() >= OWN_TOPICS)


def test_the_layout_shows_topics_that_there_are() -> None:
    """Those of semap, and those under which the page on it publishes scans and images."""
    shown_topics = set(re.findall(r'"(/[a-z/]+)', LAYOUT.read_text()))
    assert {each for each in shown_topics if each.startswith("/semap/")} <= OWN_TOPICS
    assert shown_topics - OWN_TOPICS == {"/scan", "/image", "/image/boxes"}
    assert json.loads(LAYOUT.read_text())["version"] == 1
