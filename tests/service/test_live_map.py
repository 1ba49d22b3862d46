"""The live map: a snapshot and deltas that together are what the tables say, whatever was skipped."""

import json
import math
import time
from contextlib import contextmanager
from datetime import timedelta
from typing import Any

import pytest
import shapely
from following import narrow
from jsonschema import Draft202012Validator
from patience import PATIENCE_S
from running import START, Service
from semap_service.documents.live_map import Delta, LiveHeartbeat, Snapshot
from web_socket import connect
from websockets.exceptions import ConnectionClosed

from semap.store.motion.live import LiveMap, live_map
from semap.timeline.stamp import rfc3339

SCHEMAS = {
    kind: Draft202012Validator(
        model.model_json_schema(mode="serialization"), format_checker=Draft202012Validator.FORMAT_CHECKER
    )
    for kind, model in (("snapshot", Snapshot), ("delta", Delta), ("heartbeat", LiveHeartbeat))
}


class Drawn:
    """A page's copy of the map."""

    def __init__(self, socket) -> None:
        self.socket = socket
        self.deltas = 0
        while (first := self.next())["type"] == "heartbeat":
            pass  # the first look takes its time on a busy machine
        assert first["type"] == "snapshot"
        self.tracks = {each["track_id"]: each for each in first["tracks"]}
        self.doors = {each["instance_id"]: each for each in first["doors"]}
        self.rooms = dict(first["rooms"])
        self.change_set = first["change_set"]
        self.stamp = first["stamp"]
        self.first = first

    def next(self) -> dict:
        received = json.loads(self.socket.recv(timeout=PATIENCE_S))
        if received["type"] != "error":
            SCHEMAS[received["type"]].validate(received)
        return received

    def draw(self) -> dict:
        """The next message, drawn."""
        while (message := self.next())["type"] == "heartbeat":
            pass
        assert message["type"] == "delta", message
        self.deltas += 1
        changed = {each["track_id"]: each for each in message["tracks"]}
        assert all(self.tracks.get(each) != now for each, now in changed.items())
        assert set(message["gone"]) <= set(self.tracks)
        self.tracks = {
            each: track for each, track in {**self.tracks, **changed}.items() if each not in message["gone"]
        }
        self.doors |= {each["instance_id"]: each for each in message["doors"]}
        self.rooms = {room: count for room, count in {**self.rooms, **message["rooms"]}.items() if count}
        self.change_set = message.get("change_set", self.change_set)
        self.stamp = message["stamp"]
        return message

    def until(self, shows) -> None:
        deadline_s = time.monotonic() + 10
        while not shows():
            assert time.monotonic() < deadline_s
            self.draw()

    def places(self) -> dict[str, tuple[float, float]]:
        return {each["name"]: (each["x_m"], each["y_m"]) for each in self.tracks.values()}


@contextmanager
def watching(service: Service, name: str = "office"):
    with connect(f"{service.url.replace('http', 'ws')}/maps/{name}/live") as socket:
        yield Drawn(socket)


def move(service: Service, track_id: int, second: float, x_m: float, y_m: float, **more: object) -> None:
    given = {"track_id": track_id, "stamp": START + timedelta(seconds=second), "x_m": x_m, "y_m": y_m, **more}
    names = ", ".join(given)
    values = ", ".join(f"%({name})s" for name in given)
    service.plain.execute(f"insert into semap.track_state ({names}) values ({values})", given)


def placed(page: Drawn) -> set[tuple[float, float]]:
    """Where those of the crowd are."""
    return {place for name, place in page.places().items() if name != "first"}


def crowd(service: Service, count: int) -> list[int]:
    """Tracks with long names, which no connection takes much of at once."""
    service.walk([(0, 0)], "first")
    return [
        each
        for (each,) in service.plain.execute(
            "with made as (insert into semap.track (uid, source_id, map_id, name)"
            " select gen_random_uuid(), source_id, map_id, n || repeat('x', 180)"
            " from semap.source, generate_series(1, %s) n returning track_id),"
            " seen as (select track_id from made) select track_id from seen",
            [count],
        )
    ]


def test_a_page_that_follows_draws_what_the_tables_say(service: Service) -> None:
    service.make_map()
    room = service.make_room("Room07", shapely.box(0, 0, 4, 3))["id"]
    door = service.post_instance({"name": "Door07", "concept": "Door"}).json()["id"]
    cat = service.walk([(-1, 1), (1, 1)], "cat")
    with watching(service) as page:
        assert page.first["tracks"] == [
            {
                "track_id": cat, "name": "cat", "stamp": rfc3339(START + timedelta(seconds=1)),
                "x_m": 1.0, "y_m": 1.0, "z_m": None, "heading_rad": None, "speed_mps": None,
                "length_m": None, "width_m": None, "cov_xx_m2": None, "cov_xy_m2": None, "cov_yy_m2": None,
                "rooms": [room], "ended": False,
            }
        ]  # fmt: skip
        assert page.doors == {
            door: {"instance_id": door, "name": "Door07", "state": "unknown", "since": None}
        }
        assert page.rooms == {str(room): 1}
        newest = service.plain.execute("select max(change_set_id) from semap.row_version").fetchone()[0]
        assert (page.change_set, page.first["event_cursor"]) == (newest, 0)
        assert page.stamp == rfc3339(START + timedelta(seconds=1))

        dog = service.walk([(9, 9)], "dog")
        page.until(lambda: page.places() == {"cat": (1, 1), "dog": (9, 9)})
        move(service, dog, 5, 2, 2, std_m=0.5, heading_rad=1, speed_mps=2, length_m=1, width_m=0.5, z_m=0.5)
        page.until(lambda: page.rooms == {str(room): 2})
        assert page.tracks[dog]["rooms"] == [room]
        kept = (
            "heading_rad",
            "speed_mps",
            "length_m",
            "width_m",
            "z_m",
            "cov_xx_m2",
            "cov_xy_m2",
            "cov_yy_m2",
        )
        assert [page.tracks[dog][name] for name in kept] == [1, 2, 1, 0.5, 0.5, 0.25, 0, 0.25]
        move(service, dog, 5.5, 2, 1, std_m=0.5, std_across_m=0.25, std_yaw_rad=math.pi / 2)
        page.until(lambda: page.places()["dog"] == (2, 1))
        known = [page.tracks[dog][name] for name in ("cov_xx_m2", "cov_xy_m2", "cov_yy_m2")]
        assert known == pytest.approx([0.0625, 0, 0.25], abs=1e-7)
        move(service, dog, 5.75, 2, 2)
        move(service, cat, 6, 2, 2, is_last=True)
        page.until(lambda: page.places() == {"dog": (2, 2)})
        assert page.rooms == {str(room): 1}
        assert page.stamp == rfc3339(START + timedelta(seconds=5.75))

        opened = {"instance": "Door07", "property": "door", "value": "open", "stamp": rfc3339(START)}
        document = {"map": "office", "source": "switch", "states": [opened]}
        assert service.raw.post("/object-states", json=document).is_success
        page.until(lambda: page.doors[door]["state"] == "open")
        assert page.doors[door]["since"] == rfc3339(START)

        service.make_thing("Table1")
        page.until(lambda: page.change_set > newest)
        assert page.places() == {"dog": (2, 2)}


def test_all_who_watch_share_one_look(service: Service) -> None:
    service.make_map()
    service.make_map("other")
    person = service.walk([(0, 0)])
    with watching(service) as one, watching(service) as two, watching(service, "other") as three:
        (watches,) = (service.app.state.watches,)
        assert sorted(count for _, _, count in watches._open.values()) == [1, 2]
        for second in range(1, 6):
            move(service, person, second, second, 0)
            for page in (one, two):
                page.until(lambda page=page, second=second: page.places()["person"] == (second, 0))
        assert three.first["tracks"] == []
        assert service.server_feed.clients["live"] == 3
    service.until(lambda: not watches._open and not +service.server_feed.clients)


def test_a_slow_page_skips_what_is_overtaken(service: Service) -> None:
    """It reads rarely; what it draws is the newest all the same, in fewer messages than there were states."""
    service.make_map()
    people = crowd(service, 60)
    url = f"{service.url.replace('http', 'ws')}/maps/office/live"
    with narrow(service) as made, connect(url, sock=made, max_queue=1) as socket:
        page = Drawn(socket)
        with watching(service) as other:
            for second in range(1, 41):
                service.plain.execute(
                    "insert into semap.track_state (track_id, stamp, x_m, y_m)"
                    " select id, %s, %s, 0 from unnest(%s::bigint[]) id",
                    [START + timedelta(seconds=second), second, people],
                )
                other.until(lambda second=second: placed(other) == {(second, 0)})
        page.until(lambda: placed(page) == {(40, 0)})
        assert page.deltas < 38


def test_a_page_that_takes_nothing_is_told_and_cut_off(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("semap_service.http.connection.CLOSE_S", 0.2)
    service.make_map()
    service.pace(patience_s=1)
    people = crowd(service, 100)
    url = f"{service.url.replace('http', 'ws')}/maps/office/live"
    with narrow(service) as made, connect(url, sock=made, max_queue=1, close_timeout=0.1):
        second = 0
        while service.server_feed.too_slow == 0:
            second += 1
            service.plain.execute(
                "insert into semap.track_state (track_id, stamp, x_m, y_m)"
                " select id, %s, %s, 0 from unnest(%s::bigint[]) id",
                [START + timedelta(seconds=second), second, people],
            )
        service.until(lambda: not service.app.state.watches._open)


def test_silence_is_filled_and_a_map_that_goes_is_told(service: Service) -> None:
    service.make_map()
    with watching(service) as page:
        assert page.next() == {"type": "heartbeat"}
        assert service.client.delete("/maps/office").status_code == 204
        while (told := page.next())["type"] != "error":
            pass
        assert told["detail"] == "There is no map office."
        with pytest.raises(ConnectionClosed) as caught:
            page.socket.recv(timeout=PATIENCE_S)
        assert caught.value.rcvd.code == 4400
    with connect(f"{service.url.replace('http', 'ws')}/maps/office/live") as socket:
        assert json.loads(socket.recv(timeout=PATIENCE_S))["type"] == "error"


def test_the_live_map_survives_the_loss_of_its_connections(service: Service) -> None:
    service.make_map()
    person = service.walk([(0, 0)])
    with watching(service) as page:
        service.plain.execute(
            "select pg_terminate_backend(pid) from pg_stat_activity"
            " where datname = current_database() and application_name = 'semap serve'"
        )
        move(service, person, 1, 7, 7)
        page.until(lambda: page.places() == {"person": (7, 7)})


def test_a_look_that_fails_in_a_way_that_nobody_expected_is_repeated(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    service.make_map()
    failures = [ValueError()]

    def fails_once(*asked: Any) -> LiveMap | None:
        if failures:
            raise failures.pop()
        return live_map(*asked)

    monkeypatch.setattr("semap_service.live.watch.live_map", fails_once)
    with connect(f"{service.url.replace('http', 'ws')}/maps/office/live") as socket:
        while (told := json.loads(socket.recv(timeout=PATIENCE_S)))["type"] == "heartbeat":
            pass
        assert told["type"] == "snapshot"


def test_looking_reads_no_track_that_has_ended(service: Service) -> None:
    service.make_map()
    service.plain.execute(
        "insert into semap.source (map_id, name) select map_id, 'lidar' from semap.map;"
        "insert into semap.track (uid, source_id, map_id, name)"
        " select gen_random_uuid(), source_id, map_id, 'p' || n from semap.source, generate_series(1, 3000) n;"
        "insert into semap.track_state (track_id, stamp, x_m, y_m, is_last)"
        " select track_id, now(), 0, 0, track_id % 1000 <> 0 from semap.track;"
        "analyze semap.track_now"
    )
    plan = service.plain.execute(
        "explain (analyze, format json) select n.track_id from semap.track_now n join semap.track t"
        " using (track_id) where n.map_id = (select map_id from semap.map) and n.live order by 1"
    ).fetchone()[0]
    assert "track_now_live" in json.dumps(plan)
