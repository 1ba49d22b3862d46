"""The clients against the service as it runs: what they give is what is there, whatever is killed meanwhile."""

from __future__ import annotations

import asyncio
import threading
from datetime import timedelta
from pathlib import Path

import pytest
import trimesh
from killable import Serving
from rule_work import running_worker
from semap_service import demo
from semap_service.cli import commands
from typer.testing import CliRunner

from semap import AsyncClient, Client
from semap.client import Event, Job, NewObjectState, Pose, Selection
from semap.errors import ChangedMeanwhile, Conflict, InvalidInput, NoLongerKept, NotFound
from semap.store.database.connection import connect
from semap.timeline.stamp import parse_stamp, to_datetime

FOLDER = Path(demo.__file__).parent
NOON = to_datetime(parse_stamp("2026-01-05T09:00:00Z"))
PATIENCE_S = 60.0
OPENED = {
    "input": ["track_in_room", "door"],
    "partition_by": "room",
    "pattern": "O followed by E",
    "define": {"O": "input = 'door' and type = 'open'", "E": "input = 'track_in_room' and type = 'began'"},
    "within": "6 s",
    "emit": "opened_then_entered",
}
SQUARE = {"type": "Polygon", "coordinates": [[[20, 0], [24, 0], [24, 3], [20, 3], [20, 0]]]}


def happen(dsn: str, first: int, count: int) -> None:
    """Events with these numbers, committed as the rule worker does."""
    with connect(dsn) as connection:
        connection.execute(
            "with made as (insert into semap.event (seq, event_id, map_id, rule_name, rule_version, type, stamp, since)"
            " select seq, gen_random_uuid(), map_id, 'room_visits', 1, 'entered', %s, %s from semap.map,"
            " generate_series(%s::int, %s::int) seq returning 1)"
            " select pg_notify('semap_event', '') from (select count(*) from made) done",
            [NOON, NOON, first, first + count - 1],
        )


def test_a_building_that_people_walk_through(serving: Serving, tmp_path: Path) -> None:
    told: list[Job] = []
    with Client(serving.url) as client, running_worker(serving.dsn):
        report = client.import_map(FOLDER / "office.geojson", "office", progress=told.append)
        assert dict(report.concepts) == {"Door": 7, "Room": 6, "Storey": 1}
        assert told[-1].state == "done"
        (tmp_path / "no.geojson").write_text("{")
        with pytest.raises(InvalidInput, match=r"no\.geojson"):
            client.import_map(tmp_path / "no.geojson")

        rooms = {each.name: each for each in client.rooms("office")}
        assert len(rooms) == 6
        hallway = client.features("office", "Room", filter="name = 'hallway'")
        assert hallway.to_geopandas().geometry.area.tolist() == [36.0]
        shapes = client.shapes("office").to_geopandas().set_index("name").geometry
        assert shapes["entrance"].length == pytest.approx(1.0)
        assert shapes["hallway"].equals(hallway.to_geopandas().geometry[0])

        walk_in(serving.dsn)
        tracks = {each.name: each for each in client.tracks("office")}
        assert sorted(tracks) == ["ann", "bob", "eve"]
        followed = []
        for event in client.events("office", after=0, follow=True):
            followed.append(event)
            if len(followed) == 33:
                break
        assert followed == list(client.events("office"))
        entered = client.events("office", filter="type = 'entered' AND track = 'ann'")
        assert [event.seq for event in entered] == [
            each.seq
            for each in followed
            if each.type == "entered" and each.track and each.track.name == "ann"
        ]
        frame = entered.to_pandas()
        assert frame.instance_name.tolist() == [
            "office_1",
            "hallway",
            "kitchen",
            "hallway",
            "office_2",
            "office_1",
        ]
        assert str(frame.stamp.dtype).startswith("datetime64")
        now = {(each.track, each.instance) for each in client.relations("office")}
        assert now == {("ann", "office_1"), ("bob", "office_2"), ("eve", "hallway")}
        assert [each.name for each in client.occupants(rooms["hallway"].id)] == ["eve"]

        history = client.history(tracks["ann"].id)
        with connect(serving.dsn) as connection:
            states = connection.execute(
                "select count(*) from semap.stored_state where track_id = %s", [tracks["ann"].id]
            ).fetchone()
        assert states is not None
        assert len(history) == states[0] > 600
        part = client.history(
            tracks["ann"].id, start=NOON + timedelta(seconds=10), end=NOON + timedelta(seconds=20)
        )
        assert list(part) == [each for each in history if 10 <= (each.stamp - NOON).total_seconds() <= 20]
        assert client.extent("office").first == NOON
        route = client.route(tracks["ann"], rooms["kitchen"].id)
        assert [each.room for each in route.steps] == ["office_1", "hallway", "kitchen"]

        by_hand(client, tmp_path)
        rule = client.add_rule("office", "opened", OPENED)
        assert client.rule(rule.id) == rule
        assert client.try_rule("office", OPENED).count == 0
        explained = client.explain_rule(rule.id, NOON + timedelta(seconds=10), key={"room": "hallway"})
        assert not explained.found
        with pytest.raises(Conflict):
            client.add_rule("office", "opened", OPENED)
        with pytest.raises(InvalidInput):
            client.add_rule("office", "other", {**OPENED, "pattern": "O followed"})
        assert not client.change_rule(rule.id, enabled=False).enabled
        client.delete_rule(rule.id)
        assert [each.name for each in client.rules("office")] == ["room_visits"]
        assert client.export_map("office")[:2] == b"PK"
        client.delete_map("office")
        with pytest.raises(NotFound):
            client.map("office")


def walk_in(dsn: str) -> None:
    call = ["ingest", "tracks", str(FOLDER / "walk.csv"), "--map", "office", "--keep-open", "--dsn", dsn]
    ran = CliRunner().invoke(commands(), call)
    assert ran.exit_code == 0, ran.output


def by_hand(client: Client, folder: Path) -> None:
    """Instances that are made, changed and deleted, and states of a door."""
    made = client.add_instance(
        "office", "annex", "Room", footprint=SQUARE, height_m=2.5, attributes={"seats": 4}
    )
    seen = client.instance(made.id)
    assert (seen.name, dict(seen.attributes), seen.footprint["coordinates"][0][0]) == (
        "annex",
        {"seats": 4},
        [20, 0],
    )
    client.change_instance(made.id, alias="extension", if_match=seen.etag)
    with pytest.raises(ChangedMeanwhile):
        client.change_instance(made.id, alias="other", if_match=seen.etag)
    assert [each.name for each in client.instances("office", concept="Room", name="extension")] == ["annex"]
    (folder / "table.stl").write_bytes(trimesh.creation.box(extents=[1, 1, 1]).export(file_type="stl"))
    table = client.add_instance(
        "office", "table", "Thing", mesh=folder / "table.stl", pose=Pose(x_m=21, y_m=1)
    )
    assert [each.name for each in client.where(table.id).rooms] == ["annex"]
    rows = client.ask(
        "office", "in_objects", references=Selection(concept="Room"), targets=Selection(names=("table",))
    )
    assert [(row["reference"], row["target"]) for row in rows] == [("annex", "table")]
    client.delete_instance(table.id)
    client.delete_instance(made.id)
    states = [
        NewObjectState("entrance", "door", value, NOON + timedelta(seconds=n))
        for n, value in enumerate(("closed", "open"))
    ]
    assert client.add_object_states("office", "contacts", states, watermark=NOON) == 2
    assert client.add_object_states("office", "contacts", states) == 0
    assert [(each.instance, each.value) for each in client.object_states("office")] == [
        ("entrance", "closed"),
        ("entrance", "open"),
    ]


@pytest.mark.slow
def test_a_follower_misses_and_repeats_nothing_when_the_service_is_killed(serving: Serving) -> None:
    with Client(serving.url) as client:
        client.create_map("office")
    happen(serving.dsn, 1, 300)
    followed: list[Event] = []
    came = threading.Condition()

    def follow() -> None:
        with Client(serving.url) as client:
            for event in client.events("office", after=0, follow=True):
                with came:
                    followed.append(event)
                    came.notify()
                if event.seq == 1500:
                    return

    def until(seq: int) -> None:
        with came:
            assert came.wait_for(lambda: bool(followed) and followed[-1].seq >= seq, PATIENCE_S)

    thread = threading.Thread(target=follow)
    thread.start()
    until(300)
    for first in (301, 701):
        happen(serving.dsn, first, 200)
        serving.kill()
        happen(serving.dsn, first + 200, 200)
        serving.start()
        until(first + 399)
    happen(serving.dsn, 1500, 1)
    thread.join(PATIENCE_S)
    assert [event.seq for event in followed] == [*range(1, 1101), 1500]


def test_awaiting(serving: Serving) -> None:
    async def use() -> None:
        async with AsyncClient(serving.url) as client:
            made = await client.create_map("office")
            assert await client.map("office") == made
            assert list(await client.maps()) == [made]
            happen(serving.dsn, 1, 3)
            stored = await client.events("office")
            assert [event.seq for event in stored] == [1, 2, 3]
            followed = []
            async for event in client.events("office", after=0, follow=True):
                followed.append(event)
                if len(followed) == 3:
                    happen(serving.dsn, 4, 2)
                if len(followed) == 5:
                    break
            assert followed[:3] == list(stored)
            assert [event.seq for event in followed] == [1, 2, 3, 4, 5]
            both = await asyncio.gather(client.rooms("office"), client.tracks("office"))
            assert [len(each) for each in both] == [0, 0]
            with pytest.raises(NotFound):
                await client.rule(99)
            with connect(serving.dsn) as connection:
                connection.execute("delete from semap.event where seq < 4")
            with pytest.raises(NoLongerKept) as raised:
                await anext(aiter(client.events("office", after=1, follow=True)))
            assert (raised.value.after, raised.value.oldest) == (1, 4)
            assert (await anext(aiter(client.events("office", after=1, follow=True, gaps="skip")))).seq == 4

    asyncio.run(use())
