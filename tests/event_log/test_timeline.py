"""The log in the database as lanes, and lanes as a picture; the commands that write both."""

from __future__ import annotations

import csv
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import shapely
from rule_work import await_progress, running_worker
from semap_service.cli import commands
from typer.testing import CliRunner
from world import SECOND_US, World

from semap.errors import InvalidInput, NotFound
from semap.model.event_log import Lane, Mark, Stay
from semap.picture.timeline import MOST_DRAWN, MOST_LANES, draw_timeline
from semap.store.database.connection import one_transaction
from semap.store.event.event_log import Selection, lanes, log_entries

DAY_US = 1_767_225_600 * SECOND_US
OPENED = (
    '{"input": ["track_in_room", {"object_state": "door"}], "pattern": "O followed by E", "within": "6 s",'
    ' "define": {"O": "type = \'open\'", "E": "type = \'began\'"}, "emit": "opened_then_entered"}'
)


def at(second: float) -> datetime:
    return datetime(2026, 1, 1, tzinfo=UTC) + timedelta(seconds=second)


@pytest.fixture
def scene(world: World) -> World:
    """A door that opens at 1 s and closes at 5 s; ann in the den from 2 s to 7 s, and from 9 s on."""
    world.add_room("den", shapely.box(0, 0, 4, 4))
    door_id = world.add_room("gate", shapely.box(20, 20, 21, 21))
    world.run("insert into semap.rule (map_id, name, queries, declaration)"
              " values (%s, 'openings', jsonb_build_object('track_in_room', %s::int), %s)", world.map_id, world.query_id, OPENED)  # fmt: skip
    track_id = world.add_track("ann")
    world.run("update semap.source set watermark = '-infinity'")
    with running_worker(world.dsn):
        for value, second in (("closed", 0), ("open", 1), ("open", 3), ("closed", 5)):
            world.run(
                "insert into semap.object_state (source_id, instance_id, property, value, stamp) values (%s, %s, 'door', %s, %s)",
                world.source_id, door_id, value, at(second),
            )  # fmt: skip
        world.add_states(
            [
                (track_id, DAY_US + s * SECOND_US, x, 1.0, None)
                for s, x in ((0, -1), (2, 1), (7, 5), (9, 1), (10, 2))
            ]
        )
        world.run("update semap.source set watermark = %s", at(11))
        await_progress(world.dsn)
    return world


def test_lanes_say_what_held_and_what_happened(scene: World) -> None:
    with one_transaction(scene.dsn) as connection:
        found = lanes(connection, Selection(scene.name, at(0), at(11)))
        assert found == (
            Lane(
                "den",
                False,
                (Stay(at(2), at(7), "ann"), Stay(at(9), None, "ann")),
                (Mark(at(2), "opened then entered (ann)"),),
            ),
            Lane("gate", True, (Stay(at(1), at(5), "open"),), ()),
        )
        assert lanes(connection, Selection(scene.name, at(7.5), at(8))) == ()
        with pytest.raises(NotFound):
            lanes(connection, Selection("nowhere", at(0), at(1)))


def test_entries_in_order_of_time_or_case_by_case(scene: World) -> None:
    with one_transaction(scene.dsn) as connection:
        entries = list(log_entries(connection, Selection(scene.name)))
        assert [(e.type, e.stamp, e.track, e.instance, e.concept) for e in entries] == [
            ("opened_then_entered", at(2), "ann", "den", "Room"), ("entered", at(2), "ann", "den", "Room"),
            ("left", at(7), "ann", "den", "Room"), ("entered", at(9), "ann", "den", "Room"),
        ]  # fmt: skip
        some = list(log_entries(connection, Selection(scene.name, at(2.5), at(9), ["room_visits"]), "track"))
        assert some == [entries[2]]


def test_commands_write_whole_files_or_none(scene: World, tmp_path: Path) -> None:
    run = CliRunner()
    common = ["--map", scene.name, "--dsn", scene.dsn]
    for suffix in (".xes", ".json", ".csv", ".parquet"):
        done = run.invoke(
            commands(), ["log", "export", str(tmp_path / f"log{suffix}"), *common], catch_exceptions=False
        )
        assert done.output == f"4 events written to {tmp_path / f'log{suffix}'}.\n"
    assert "semap:track_id" in (tmp_path / "log.xes").read_text()
    with (tmp_path / "log.csv").open() as file:
        assert [row["type"] for row in csv.DictReader(file)] == [
            "opened_then_entered",
            "entered",
            "left",
            "entered",
        ]
    done = run.invoke(
        commands(), ["plot", "timeline", str(tmp_path / "log.svg"), *common], catch_exceptions=False
    )
    assert done.output.startswith("2 lanes drawn")
    before = sorted(tmp_path.iterdir())
    for wrong in (
        ["log", "export", "log.txt"],
        ["log", "export", "log.xes", "--case", "cat"],
        ["plot", "timeline", "log.gif"],
    ):
        assert isinstance(
            run.invoke(
                commands(), [wrong[0], wrong[1], str(tmp_path / wrong[2]), *wrong[3:], *common]
            ).exception,
            InvalidInput,
        )
    assert isinstance(
        run.invoke(commands(), ["log", "export", str(tmp_path / "no" / "log.csv"), *common]).exception,
        InvalidInput,
    )
    assert isinstance(
        run.invoke(
            commands(), ["log", "export", str(tmp_path / "b.csv"), "--map", "no", "--dsn", scene.dsn]
        ).exception,
        NotFound,
    )
    assert sorted(tmp_path.iterdir()) == before


def test_a_picture_shows_names_and_events(tmp_path: Path) -> None:
    some = [Lane("Room07", False, [Stay(at(0), at(3), "ann"), Stay(at(1), None, "bob")], [Mark(at(2), "entered then closed")]),
            Lane("door", True, [Stay(at(1), at(2), "open")], [])]  # fmt: skip
    draw_timeline(some, at(0), at(10), "office", tmp_path / "a.svg")
    picture = (tmp_path / "a.svg").read_text()
    for text in ("Room07", "door", "ann", "bob", "open", "entered then closed", "office"):
        assert f"<!--  {text} -->" in picture or f"<!-- {text} -->" in picture
    draw_timeline([], at(0), at(10), "nothing", tmp_path / "b.png")
    assert (tmp_path / "b.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(InvalidInput, match="at most"):
        draw_timeline(
            [Lane(str(n), False, [], []) for n in range(MOST_LANES + 1)], at(0), at(1), "", tmp_path / "c.svg"
        )
    crowded = Lane("lab", False, [], [Mark(at(0), "came")] * (MOST_DRAWN + 1))
    with pytest.raises(InvalidInput, match="5001 bars and events; at most 5000"):
        draw_timeline([crowded], at(0), at(1), "", tmp_path / "c.svg")
