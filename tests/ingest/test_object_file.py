"""States of objects from files: in order, once, and with the watermark of their source."""

from __future__ import annotations

from pathlib import Path

import pyarrow
import pytest
import shapely
from pyarrow import parquet
from semap_ingest.object_file import (
    ObjectLayout,
    ObjectPlan,
    ObjectStates,
    ingest_object_states,
    read_object_states,
)
from world import SECOND_US, World

from semap.errors import InvalidInput, NotFound
from semap.model.object_state import NewObjectState
from semap.timeline.stamp import parse_stamp, to_datetime

NOON_US = parse_stamp("2026-01-31T12:00:00Z")
ISO = """
instance,property,value,stamp,attributes
door,door,closed,2026-01-31T12:00:05Z,"{""by"": ""ann""}"
door,door,open,2026-01-31T13:00:00+01:00,
gate,lock,off,2026-01-31T12:00:02Z,
"""
STATES = (
    NewObjectState("door", "door", "open", to_datetime(NOON_US)),
    NewObjectState("gate", "lock", "off", to_datetime(NOON_US + 2 * SECOND_US)),
    NewObjectState("door", "door", "closed", to_datetime(NOON_US + 5 * SECOND_US), {"by": "ann"}),
)


def write(folder: Path, text: str, name: str = "doors.csv") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_states_come_in_the_order_of_their_stamps(tmp_path: Path) -> None:
    assert read_object_states(write(tmp_path, ISO), ObjectLayout()).states == STATES


def test_parquet_says_the_same(tmp_path: Path) -> None:
    path = tmp_path / "doors.parquet"
    rows = [
        {"instance": s.instance, "property": s.property, "value": s.value, "stamp": s.stamp}
        for s in STATES[:2]
    ]
    parquet.write_table(pyarrow.Table.from_pylist(rows), path)
    assert read_object_states(path, ObjectLayout()).states == STATES[:2]


def test_other_columns_units_and_one_property(tmp_path: Path) -> None:
    layout = ObjectLayout(
        columns={"instance": "which", "value": "how"}, names=("which", "how", "t"), property="door",
        stamp_unit="s", epoch_us=NOON_US,
    )  # fmt: skip
    states = read_object_states(write(tmp_path, "door;open;0\n"), layout)
    assert states.states == STATES[:1]


@pytest.mark.parametrize(
    ("text", "layout", "words"),
    [
        ("instance,value,stamp\nd,open,2026-01-31T12:00:00Z\n", ObjectLayout(), "no column for the property"),
        ("instance,property,value,t\nd,door,open,\n", ObjectLayout(stamp_unit="s"), "doors.csv, line 2: there is no stamp"),
        ("instance,property,value,t\n\"\",door,open,1\n", ObjectLayout(stamp_unit="s"), "line 2: the instance has no name"),
        ("instance,property,value,t\nd,,open,1\n", ObjectLayout(stamp_unit="s"), "line 2: the property has no name"),
        ("instance,property,value,t\nd,d\0,open,1\n", ObjectLayout(stamp_unit="s"), "line 2: the property is no text"),
        ("instance,property,value,t,attributes\nd,door,open,1,\"{\"\"a\"\": NaN}\"\n", ObjectLayout(stamp_unit="s"), "no JSON object"),
        ("instance,property,value,t,attributes\nd,door,open,1,\"{\"\"a\"\": \"\"\\u0000\"\"}\"\n", ObjectLayout(stamp_unit="s"), "no JSON object"),
        ("instance,property,value,t,attributes\nd,door,open,1,[1]\n", ObjectLayout(stamp_unit="s"), "no JSON object"),
        ("instance,property,value,t\nd,door,open,noon\n", ObjectLayout(), "not an ISO 8601 stamp"),
        ("instance,property,value,t\nd,door\n", ObjectLayout(), "line 2: 2 values"),
        ("", ObjectLayout(), "no states"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_told(tmp_path: Path, text: str, layout: ObjectLayout, words: str) -> None:
    with pytest.raises(InvalidInput, match=words) as told:
        read_object_states(write(tmp_path, text), layout)
    assert told.value.remedy


READ = ObjectStates(STATES, tuple(f"doors.csv, line {line}" for line in (2, 3, 4)))


def stored(world: World) -> list[tuple]:
    return world.rows(
        "select instance_name, value, previous, attributes from semap.object_state order by stamp"
    )


def test_batches_carry_their_watermark_and_are_passed_over_when_known(world: World) -> None:
    """Stopped after each batch and given again, the file is in once; its watermark is always what is certain."""
    for name in ("door", "gate"):
        world.add_room(name, shapely.box(0, 0, 1, 1))
    plan = ObjectPlan("world", "contacts", batch_size=1)
    marks = []

    def advance(done: int, total: int) -> None:
        mark = world.one("select watermark from semap.source where name = 'contacts'")
        marks.append((done, total, mark))
        if len(marks) <= 3:
            raise InterruptedError

    for _ in range(3):
        with pytest.raises(InterruptedError):
            ingest_object_states(world.dsn, plan, READ, advance)
    assert len(stored(world)) == 1
    assert ingest_object_states(world.dsn, plan, READ, advance) == 2
    assert ingest_object_states(world.dsn, plan, READ) == 0
    assert marks[-3:] == [
        (done, 3, to_datetime(NOON_US + after_us))
        for done, after_us in ((1, 2 * SECOND_US - 1), (2, 5 * SECOND_US - 1), (3, 5 * SECOND_US))
    ]
    assert stored(world) == [
        ("door", "open", None, {}), ("gate", "off", None, {}), ("door", "closed", "open", {"by": "ann"}),
    ]  # fmt: skip


def test_kept_open_a_source_says_nothing_of_how_far_it_is(world: World) -> None:
    for name in ("door", "gate"):
        world.add_room(name, shapely.box(0, 0, 1, 1))
    plan = ObjectPlan("world", "contacts", keep_open=True)
    assert ingest_object_states(world.dsn, plan, READ) == 3
    assert world.one("select watermark = '-infinity' from semap.source where name = 'contacts'") is True


def test_a_file_with_an_unknown_instance_leaves_no_trace(world: World) -> None:
    world.add_room("door", shapely.box(0, 0, 1, 1))
    with pytest.raises(NotFound, match=r"doors\.csv, line 3: There is no instance gate on the map world"):
        ingest_object_states(world.dsn, ObjectPlan("world", "contacts", batch_size=1), READ)
    assert stored(world) == []
    assert world.one("select count(*) from semap.source where name = 'contacts'") == 0
    with pytest.raises(NotFound, match="no map nowhere"):
        ingest_object_states(world.dsn, ObjectPlan("nowhere", "contacts"), READ)
