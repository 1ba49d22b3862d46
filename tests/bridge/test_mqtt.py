"""The bridge to MQTT, against a real broker: what comes in is stored as it was said, events go out with their ids."""

from __future__ import annotations

import gc
import json
import subprocess
from collections import Counter
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
import shapely
from bridging import config, report, running, stored
from making import make_events
from mosquitto import Mosquitto, Peer, broker, needs_mosquitto, peer
from patience import until
from semap_bridge.checking import check_bridge
from semap_bridge.config import Entry, read_config
from watched_rooms import EAST, WEST, Eye
from world import SECOND_US, World

from semap.timeline.stamp import rfc3339, to_datetime, to_us

pytestmark = needs_mosquitto
FIRST_US = 1_700_000_000 * SECOND_US
UWB = {
    "topic": "uwb/{tag}/position", "track": "{tag}", "x": "$.pos.x", "y": "$.pos.y", "z": "$.pos.z", "unit": "cm",
    "std": "$.accuracy", "stamp": "$.t",
}  # fmt: skip


@pytest.fixture
def mosquitto(tmp_path: Path) -> Iterator[Mosquitto]:
    with broker(tmp_path) as made:
        yield made


def entry(folder: Path, port: int, **settings: object) -> Entry:
    """The one bridge of a config, `lines` as the other tests call it."""
    given = {"broker": {"host": "127.0.0.1", "port": port}, **settings}
    written = "".join(f"    {name}: {json.dumps(value)}\n" for name, value in given.items())
    return read_config(config(folder, f"  - name: lines\n    kind: mqtt\n{written}")).bridges[0]


def uwb(stamp_us: int, x_cm: float, y_cm: float, **more: object) -> str:
    return json.dumps({"pos": {"x": x_cm, "y": y_cm}, "t": stamp_us / 1000, **more})


def is_connected(world: World) -> bool:
    return report(world)["state"] == "connected"


def until_read(world: World, speak, wanted: int) -> None:
    """Say something again until the bridge has subscribed and it is in: what is told twice is there once."""

    def is_in() -> bool:
        speak()
        return len(stored(world)) >= wanted

    until(is_in)


def test_any_json_comes_into_the_map_frame(world: World, tmp_path: Path, mosquitto: Mosquitto) -> None:
    """By named parts of the topic, paths, units, and where the sender's origin is."""
    origin = {"x_m": 10.0, "y_m": 20.0, "yaw_deg": 90.0}
    one = entry(tmp_path, mosquitto.port, read=[{**UWB, "origin": origin, "names": {"a1": "anna"}}])
    with running(world, one), peer(mosquitto.port) as tracker:
        until_read(world, lambda: tracker.say("uwb/a1/position", uwb(FIRST_US, 300, 100)), 1)
        tracker.say("uwb/b2/position", uwb(FIRST_US + SECOND_US, 0, 0, accuracy=20))
        tracker.say("uwb/b2/elsewhere", uwb(FIRST_US, 0, 0))
        until(lambda: len(stored(world)) == 2)
    rows = stored(world)
    assert [row[:2] for row in rows] == [("anna", FIRST_US), ("b2", FIRST_US + SECOND_US)]
    assert rows[0][2:] == pytest.approx((9.0, 23.0))
    assert rows[1][2:] == pytest.approx((10.0, 20.0))
    assert world.one("select std_m from semap.stored_state where x_m > 9.5") == pytest.approx(0.2)


def test_doors_and_lists_and_texts(world: World, tmp_path: Path, mosquitto: Mosquitto) -> None:
    door = world.add_room("kitchen_door", shapely.box(0, 0, 1, 1))
    contacts = {
        "topic": "zigbee/{door}", "instance": "{door}", "value": "$.contact", "values": {"true": "closed", "false": "open"},
        "names": {"sensor 1": "kitchen_door"},
    }  # fmt: skip
    lamps = {
        "topic": "lamp/{of}",
        "payload": "text",
        "instance": "kitchen_door",
        "property": "lamp",
        "value": "$",
    }
    crowd = {"topic": "crowd", "each": "$.all", "track": "$.id", "x": "$.x", "y": "$.y", "stamp": "$.at"}
    one = entry(tmp_path, mosquitto.port, read=[contacts, lamps, crowd])
    at = rfc3339(to_datetime(FIRST_US))
    people = {"all": [{"id": each, "x": each, "y": 0, "at": at} for each in range(1, 4)]}
    with running(world, one), peer(mosquitto.port) as house:
        until_read(world, lambda: house.say("crowd", json.dumps(people)), 3)
        house.say("zigbee/sensor 1", '{"contact": false}')
        house.say("zigbee/" + "x" * 5000, '{"contact": true}')
        house.say("lamp/x", "O" * 1001)
        house.say("lamp/x", "ON")
        house.say("zigbee/sensor 1", '{"contact": true}')
        states = (
            "select property, value from semap.object_state where instance_id = %s order by object_state_id"
        )
        until(lambda: len(world.rows(states, door)) == 3)
    assert world.rows(states, door) == [("door", "open"), ("lamp", "ON"), ("door", "closed")]
    assert [row[0] for row in stored(world)] == ["1", "2", "3"]


def test_what_cannot_be_used_is_counted_and_keeps_no_other_out(
    world: World, tmp_path: Path, mosquitto: Mosquitto
) -> None:
    bad = [
        "no json", "[1]", "{}", '{"pos": {"x": "far", "y": 1}, "t": 1700000000}', '{"pos": {"x": NaN, "y": 1}, "t": 1700000000}',
        '{"pos": {"x": 1, "y": true}, "t": 1700000000}', '{"pos": {"x": 1, "y": 1}, "t": "noon"}', b"\xff\xfe",
        '{"pos": {"x": 1e15, "y": 1}, "t": 1700000000}', '{"pos": {"x": 1, "y": 1}, "t": 4000000000}', "",
    ]  # fmt: skip
    one = entry(tmp_path, mosquitto.port, read=[{**UWB, "unit": "m"}])
    with running(world, one), peer(mosquitto.port) as tracker:
        until_read(world, lambda: tracker.say("uwb/a/position", uwb(FIRST_US, 1, 2)), 1)
        for each in bad:
            tracker.say("uwb/a/position", each)
        tracker.say("uwb/a/position", uwb(FIRST_US + SECOND_US, 3, 4))
        until(lambda: len(stored(world)) == 2)
    refusals = dict(report(world)["refusals"])
    refusals.pop("repeated", None)
    assert refusals == {
        "not JSON": 3, "no stamp": 3, "x is no number": 2, "y is no number": 1, "x_m out of range": 1,
        "stamp in the future": 1,
    }  # fmt: skip


def test_what_a_broker_keeps_meanwhile_is_not_lost(
    world: World, tmp_path: Path, mosquitto: Mosquitto
) -> None:
    """A stamped position that was sent while the bridge was away is in; one without a stamp is not taken for new."""
    live = {"topic": "live/{tag}", "track": "{tag}", "x": "$.x", "y": "$.y"}
    one = entry(tmp_path, mosquitto.port, read=[UWB, live])
    with peer(mosquitto.port) as tracker:
        with running(world, one):
            until_read(world, lambda: tracker.say("uwb/a/position", uwb(FIRST_US, 0, 0)), 1)
        for i in range(1, 6):
            tracker.say("uwb/a/position", uwb(FIRST_US + i * SECOND_US, 100.0 * i, 0))
        tracker.say("live/b", '{"x": 1, "y": 1}')
        with running(world, one):
            until(lambda: len(stored(world)) == 6)
    assert [(row[0], row[2]) for row in stored(world)] == [("a", float(i)) for i in range(6)]


def test_rules_need_not_wait_for_more(world: World, tmp_path: Path, mosquitto: Mosquitto) -> None:
    """A stamp is complete once nothing more comes of it, and what has no stamp up to now."""
    live = {"topic": "live/{tag}", "track": "{tag}", "x": "$.x", "y": "$.y"}
    said = "select coalesce((extract(epoch from watermark) * 1000000)::bigint, 0) from semap.source where name = %s"
    one = entry(tmp_path, mosquitto.port, read=[UWB, live], settle_s=1)
    with running(world, one), peer(mosquitto.port) as tracker:
        until_read(world, lambda: tracker.say("uwb/a/position", uwb(FIRST_US, 0, 0)), 1)
        until(lambda: world.one(said, "lines") == FIRST_US)
        for tag in "abc":
            tracker.say(f"uwb/{tag}/position", uwb(FIRST_US + SECOND_US, 0, 0))
        until(lambda: world.one(said, "lines") == FIRST_US + SECOND_US)
        until(lambda: world.one(said, "lines live") > FIRST_US + SECOND_US)
        before = world.one(said, "lines live")
        until(lambda: world.one(said, "lines live") > before)
        assert len(stored(world)) == 4
        assert world.one("select count(*) from semap.late_state") == 0
        tracker.say("live/d", '{"x": 1, "y": 2}')
        until(lambda: len(stored(world)) == 5)
    newest = stored(world)[-1]
    assert newest[0] == "d"
    assert world.one(said, "lines live") >= newest[1] > before


def test_a_broker_that_goes_is_waited_for(world: World, tmp_path: Path, mosquitto: Mosquitto) -> None:
    one = entry(tmp_path, mosquitto.port, read=[UWB], write="semap/events", from_start=True)
    with running(world, one):
        with peer(mosquitto.port) as tracker:
            until_read(world, lambda: tracker.say("uwb/a/position", uwb(FIRST_US, 0, 0)), 1)
        mosquitto.stop()
        until(lambda: report(world)["state"] == "waiting")
        assert f"127.0.0.1:{mosquitto.port} is away" in str(report(world)["trouble"])
        made = make_events(world, 5)
        mosquitto.start()
        with peer(mosquitto.port, "semap/events") as tracker:
            until_read(world, lambda: tracker.say("uwb/a/position", uwb(FIRST_US + SECOND_US, 0, 0)), 2)
            until(lambda: report(world).get("delivered") == 5)
            made += make_events(world, 3)
            until(lambda: report(world).get("delivered") == 8)
            heard = {json.loads(tracker.heard.get(timeout=60).payload)["id"] for _ in range(3)}
    assert heard <= set(made)


def test_a_broker_whose_disk_is_full_is_used_all_the_same(
    world: World, tmp_path: Path, mosquitto: Mosquitto
) -> None:
    """Mosquitto goes on from its memory. When it starts again it knows no session: the bridge subscribes anew."""
    mosquitto.stop()
    mosquitto.more += "autosave_interval 1\nautosave_on_changes true\n"
    mosquitto.disk_is_full = True
    mosquitto.start()
    one = entry(tmp_path, mosquitto.port, read=[UWB], write="semap/events", from_start=True)
    with running(world, one):
        for time in range(2):
            stamp_us = FIRST_US + time * SECOND_US
            with peer(mosquitto.port, "semap/events") as tracker:
                until_read(world, lambda at=stamp_us: tracker.say("uwb/a/position", uwb(at, 0, 0)), time + 1)
                made = make_events(world, 5)
                heard: list[str] = []
                while made[-1] not in heard:
                    heard.append(json.loads(tracker.heard.get(timeout=60).payload)["id"])
                assert [each for each in heard if each in made] == made
            mosquitto.stop()
            until(lambda: report(world)["state"] == "waiting")
            mosquitto.start()
    assert not list(tmp_path.glob("mosquitto.db*")) or not sum(
        each.stat().st_size for each in tmp_path.glob("mosquitto.db*")
    )


def test_what_happens_before_a_broker_first_answers_goes_out(
    world: World, tmp_path: Path, mosquitto: Mosquitto
) -> None:
    mosquitto.stop()
    with running(world, entry(tmp_path, mosquitto.port, write="semap/events")):
        until(lambda: report(world)["state"] == "waiting")
        made = make_events(world, 3)
        mosquitto.start()
        until(lambda: report(world).get("delivered") == len(made))


def test_events_go_out_in_their_order(world: World, tmp_path: Path, mosquitto: Mosquitto) -> None:
    with peer(mosquitto.port, "semap/events") as listener:
        made = make_events(world, 700)
        with running(world, entry(tmp_path, mosquitto.port, write="semap/events", from_start=True)):
            until(lambda: listener.heard.qsize() == 700)
        heard = [json.loads(listener.heard.get().payload) for _ in range(700)]
    assert [each["id"] for each in heard] == made
    assert heard[0]["specversion"] == "1.0"


def test_frigate_is_kept_as_it_comes(world: World, tmp_path: Path, mosquitto: Mosquitto) -> None:
    seen = {"id": "1607123955.475377-mxklsc", "camera": "front_door", "frame_time": 1607123961.837752, "label": "person",
            "box": [424, 500, 536, 712], "current_zones": ["driveway"]}  # fmt: skip
    events = [{"type": kind, "before": seen, "after": {**seen, "frame_time": seen["frame_time"] + i}}
              for i, kind in enumerate(["new", "update", "end"])]  # fmt: skip
    kept = "select document from semap.camera_report where camera = 'front_door' order by stamp"
    one = entry(tmp_path, mosquitto.port, read=[{"format": "frigate"}])
    with running(world, one), peer(mosquitto.port) as frigate:

        def is_in() -> bool:
            frigate.say("frigate/events", json.dumps(events[0]))
            return bool(world.rows(kept))

        until(is_in)
        bad = [
            {"type": "new", "after": {**seen, "score": score}}
            for score in (float("nan"), "\0", "\ud800", "9" * 70000)
        ]
        bad.append({"type": "new", "after": {**seen, "id": "\U0001f600" * 900}})
        refused = {"no event of Frigate": 1, "not to be stored": 3, "id is too long": 1}
        for each in [*events, {"type": "strange"}, *bad, *events]:
            frigate.say("frigate/events", json.dumps(each))
        until(lambda: len(world.rows(kept)) == 4 and report(world)["refusals"] == refused)
    assert [row[0] for row in world.rows(kept) if row[0] != bad[3]] == events
    assert world.one("select source from semap.camera_report limit 1") == "lines"


def test_boxes_of_frigate_are_persons_where_a_rig_places_its_cameras(
    world: World, tmp_path: Path, mosquitto: Mosquitto
) -> None:
    """The whole way: what Frigate says of two cameras, and where one person is on the map."""
    (tmp_path / "rig.yaml").write_text("sensors:\n" + WEST.entry() + EAST.entry())
    began_us = to_us(datetime.now(UTC))
    said = Counter[str]()

    def tell(house: Peer, eye: Eye, label: str = "person") -> None:
        box = eye.sees((5.0, 0.4), 0.0)
        after = {"id": f"{eye.name}-1", "camera": eye.name, "frame_time": to_us(datetime.now(UTC)) / 1e6,
                 "label": label, "false_positive": False, "score": 0.8, "box": list(box.corners_px)}  # fmt: skip
        house.say("frigate/events", json.dumps({"type": "update", "before": after, "after": after}))
        said[label] += 1

    one = entry(tmp_path, mosquitto.port, read=[{"format": "frigate", "rig": "rig.yaml", "kept_s": 1.0}])
    with running(world, one), peer(mosquitto.port) as frigate:

        def is_in() -> bool:
            for eye in (WEST, EAST):
                tell(frigate, eye)
            tell(frigate, WEST, "dog")
            return len(stored(world)) >= 3

        until(is_in)
        until(lambda: world.one("select bool_and(ended_at is not null) from semap.track"))
    rows = stored(world)
    assert len({name for name, *_ in rows}) == 1
    assert world.rows("select distinct s.name from semap.track t join semap.source s using (source_id)") == [
        ("lines/persons",)
    ]
    for _, stamp_us, x_m, y_m in rows:
        assert stamp_us >= began_us
        assert (x_m, y_m) == pytest.approx((5.0, 0.4), abs=0.4)
    assert world.one("select count(*) from semap.camera_report") >= said["dog"] > 0


def test_espresense_and_omlox(world: World, tmp_path: Path, mosquitto: Mosquitto) -> None:
    at = rfc3339(to_datetime(FIRST_US))
    phone = {
        "source_type": "espresense",
        "x": 1.5,
        "y": 2.5,
        "z": 1.0,
        "fixes": 4,
        "confidence": 80,
        "last_seen": at,
    }
    tag = {"position": {"type": "Point", "coordinates": [4, 5]}, "source": "zone", "provider_type": "uwb",
           "provider_id": "tag-1", "crs": "local", "accuracy": 0.3, "course": 0, "speed": 1.0,
           "timestamp_generated": at}  # fmt: skip
    one = entry(
        tmp_path, mosquitto.port,
        read=[{"format": "espresense", "names": {"phone:a": "anna"}}, {"format": "omlox", "topic": "omlox/#"}],
    )  # fmt: skip
    ended = "select ended_at is not null from semap.track where name = 'anna'"
    with running(world, one), peer(mosquitto.port) as house:
        until_read(world, lambda: house.say("espresense/companion/phone:a/attributes", json.dumps(phone)), 1)
        house.say("omlox/locations", json.dumps([tag, {"position": 7}]))
        until(lambda: len(stored(world)) == 2)
        house.say("espresense/companion/phone:a", "kitchen")
        assert not world.one(ended)
        house.say("espresense/companion/phone:a", "not_home")
        until(lambda: world.one(ended))
    assert stored(world) == [("anna", FIRST_US, 1.5, 2.5), ("tag-1", FIRST_US, 4.0, 5.0)]
    row = world.rows("select std_m, heading_rad, speed_mps from semap.stored_state where x_m = 4")[0]
    assert row == pytest.approx((0.3, 1.5707963, 1.0))


def test_degrees_are_placed_by_the_anchor(world: World, tmp_path: Path, mosquitto: Mosquitto) -> None:
    gps = {"topic": "gps/{tag}", "track": "{tag}", "x": "$.lon", "y": "$.lat", "unit": "deg", "stamp": "$.t"}
    world.run(
        "insert into semap.map_anchor (map_id, epsg, x_m, y_m, z_m, qx, qy, qz, qw)"
        " values (%s, 25832, 500000, 5400000, 0, 0, 0, 0, 1)", world.map_id,
    )  # fmt: skip
    lon, lat = world.rows(
        "select st_x(p), st_y(p) from semap.to_earth(st_makepoint(30, 40), %s, 4326) p", world.map_id
    )[0]
    one = entry(tmp_path, mosquitto.port, read=[gps])
    with running(world, one), peer(mosquitto.port) as phone:
        said = json.dumps({"lon": lon, "lat": lat, "t": FIRST_US / 1e6})
        until_read(world, lambda: phone.say("gps/a", said), 1)
        phone.say("gps/a", json.dumps({"lon": 999, "lat": lat, "t": FIRST_US / 1e6}))
        until(lambda: "not on earth" in report(world)["refusals"])
    assert stored(world)[0][2:] == pytest.approx((30, 40), abs=1e-4)


def test_a_password_that_expires_is_waited_for_and_never_told(
    world: World, tmp_path: Path, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("DEBUG")
    secret = tmp_path / "secret"
    secret.write_text("hunter-zwei\n")
    passwords = tmp_path / "passwords"
    _set_password(passwords, "hunter-drei")
    with broker(tmp_path, f"allow_anonymous false\npassword_file {passwords}\n") as made:
        login = {
            "host": "127.0.0.1",
            "port": made.port,
            "login": {"user": "semap", "password_file": "secret"},
        }
        one = entry(tmp_path, made.port, read=[UWB], broker=login)
        with running(world, one), peer(made.port, user="semap", password="hunter-drei") as tracker:
            until(lambda: "refuses the login" in str(report(world)["trouble"]))
            secret.write_text("hunter-drei\n")
            until(lambda: is_connected(world))
            until_read(world, lambda: tracker.say("uwb/a/position", uwb(FIRST_US, 0, 0)), 1)
    said = "".join(capfd.readouterr()) + caplog.text + json.dumps(report(world))
    assert "refuses the login" in said
    assert "hunter" not in said


def _set_password(path: Path, password: str) -> None:
    path.write_text("")
    subprocess.run(["mosquitto_passwd", "-b", str(path), "semap", password], check=True, capture_output=True)


def test_a_broker_that_refuses_a_topic_is_named(world: World, tmp_path: Path) -> None:
    rights = tmp_path / "rights"
    rights.write_text("topic read uwb/#\n")
    with broker(tmp_path, f"allow_anonymous true\nacl_file {rights}\n") as made:
        one = entry(tmp_path, made.port, write="semap/events", from_start=True)
        make_events(world, 1)
        with running(world, one):
            until(lambda: "refuses what is published" in str(report(world)["trouble"]))
    assert report(world)["delivered"] == 0


# paho leaves the socket of a handshake that failed to the garbage collector
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_tls_trusts_whom_its_file_says(world: World, tmp_path: Path) -> None:
    for name in ("good", "other"):
        subprocess.run(
            ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", f"{name}.key", "-out", f"{name}.pem",
             "-days", "2", "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost"],
            cwd=tmp_path, check=True, capture_output=True,
        )  # fmt: skip
    tls = f"allow_anonymous true\ncertfile {tmp_path}/good.pem\nkeyfile {tmp_path}/good.key\n"
    with broker(tmp_path, tls) as made:
        for name, wanted in (("other", "is away"), ("good", "")):
            at = {"host": "localhost", "port": made.port, "tls": {"ca_file": f"{name}.pem"}}
            with running(world, entry(tmp_path, made.port, read=[UWB], broker=at)):
                if wanted:
                    until(lambda: "certificate" in str(report(world)["trouble"]))
                else:
                    until(lambda: is_connected(world) and not report(world)["trouble"])
    gc.collect()


def test_check_says_what_it_sees_and_disturbs_no_bridge(
    world: World, tmp_path: Path, mosquitto: Mosquitto
) -> None:
    one = entry(tmp_path, mosquitto.port, read=[UWB])
    with peer(mosquitto.port) as tracker, running(world, one):
        until_read(world, lambda: tracker.say("uwb/a/position", uwb(FIRST_US, 0, 0)), 1)
        tracker.say("uwb/old/position", uwb(FIRST_US, 0, 0), retain=True)
        tracker.say("uwb/bad/position", "?", retain=True)
        until(lambda: len(stored(world)) == 2)
        seen = {each.what: each for each in check_bridge(world.dsn, one, 1.0)}
        assert report(world)["reconnects"] == 0
    assert (seen["uwb/old/position"].is_a, seen["uwb/old/position"].trouble) == ("read", "")
    assert "can be used" in seen["uwb/bad/position"].trouble
    assert seen["states"].is_a == "of 1 tracks"
    mosquitto.stop()
    assert "is away" in check_bridge(world.dsn, one, 1.0)[0].trouble
