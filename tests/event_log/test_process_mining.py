"""XES and OCEL 2.0 as pm4py reads them: another's reader gives back what was written."""

from __future__ import annotations

import json
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from uuid import UUID

from semap.event_log.ocel import write_ocel
from semap.event_log.xes import write_xes
from semap.model.event_log import Entry

T = datetime(2026, 1, 31, 12, tzinfo=UTC)
ENTRIES = [
    Entry(UUID(int=1), "entered", T, T, "office", "room_visits", 1, 3, "ann <1>", 7, "Room07", "Room", "moved"),
    Entry(UUID(int=2), "entered", T + timedelta(seconds=1), T, "office", "room_visits", 1, 4, "bob & co", 7,
          "Room07", "Room", "moved"),
    Entry(UUID(int=3), "opened_then_entered", T + timedelta(seconds=1.5), T, "office", "openings", 2, 4, "bob & co", 7,
          "Room07", "Room", confidence=0.25, verdict="confirmed", measures={"gap_s": 1.5, "who": "bob \x00", "n": 2}),
    Entry(UUID(int=4), "dark", T + timedelta(seconds=9), T, "office", "nobody", 1),
]  # fmt: skip

READ_XES = """
import json, sys, pm4py
log = pm4py.read_xes(sys.argv[1], return_legacy_log_object=True)
print("\\n" + json.dumps([[trace.attributes, [dict(event) for event in trace]] for trace in log], default=str))
"""
READ_OCEL = """
import json, sys, pm4py
log = pm4py.read_ocel2_json(sys.argv[1])
tables = {"events": log.events, "objects": log.objects, "relations": log.relations}
print("\\n" + json.dumps({name: json.loads(table.to_json(orient="records", date_format="iso", date_unit="us"))
                          for name, table in tables.items()}))
"""


def read(script: str, path: Path):
    """What pm4py reads, in a process of its own: it prints, warns and patches what it likes."""
    done = subprocess.run(
        [sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_pm4py_reads_the_traces_of_rooms(tmp_path: Path) -> None:
    path = tmp_path / "log.xes"
    assert write_xes(ENTRIES, path, "instance") == 3
    [[attributes, events]] = read(READ_XES, path)
    assert attributes == {"concept:name": "Room07", "semap:instance_id": 7}
    assert [(e["concept:name"], e["org:resource"]) for e in events] == [
        ("entered", "ann <1>"), ("entered", "bob & co"), ("opened_then_entered", "bob & co")
    ]  # fmt: skip
    assert [datetime.fromisoformat(e["time:timestamp"]) for e in events] == [e.stamp for e in ENTRIES[:3]]
    last = events[2]
    assert (last["semap:confidence"], last["semap:verdict"], last["measure:gap_s"], last["measure:n"]) == (
        0.25, "confirmed", 1.5, 2
    )  # fmt: skip
    assert last["measure:who"] == "bob \N{REPLACEMENT CHARACTER}"
    assert last["identity:id"] == str(UUID(int=3))


def test_pm4py_reads_the_traces_of_tracks(tmp_path: Path) -> None:
    path = tmp_path / "log.xes"
    write_xes(ENTRIES, path, "track")
    traces = read(READ_XES, path)
    assert [(attributes["concept:name"], len(events)) for attributes, events in traces] == [
        ("ann <1>", 1),
        ("bob & co", 2),
    ]


def test_pm4py_reads_events_objects_and_how_they_are_related(tmp_path: Path) -> None:
    path = tmp_path / "log.json"
    assert write_ocel(ENTRIES, path) == 4
    log = read(READ_OCEL, path)
    assert [
        (e["ocel:eid"], e["ocel:activity"], datetime.fromisoformat(e["ocel:timestamp"]))
        for e in log["events"]
    ] == [(str(e.event_id), e.type, e.stamp) for e in ENTRIES]
    assert {(o["ocel:oid"], o["ocel:type"], o["name"]) for o in log["objects"]} == {
        ("track:3", "Track", "ann <1>"), ("track:4", "Track", "bob & co"), ("instance:7", "Room", "Room07"), ("map:office", "Map", "office"),
    }  # fmt: skip
    assert {(r["ocel:eid"], r["ocel:oid"], r["ocel:qualifier"]) for r in log["relations"]} == {
        (str(e.event_id), oid, qualifier)
        for e in ENTRIES if e.track_id is not None
        for oid, qualifier in ((f"track:{e.track_id}", "actor"), (f"instance:{e.instance_id}", "place"))
    } | {(str(e.event_id), "map:office", "map") for e in ENTRIES}  # fmt: skip
    assert log["events"][2]["measure:gap_s"] == 1.5


def test_an_empty_log_is_a_log(tmp_path: Path) -> None:
    assert write_xes([], tmp_path / "log.xes", "track") == 0
    assert read(READ_XES, tmp_path / "log.xes") == []
    assert write_ocel([], tmp_path / "log.json") == 0
    assert json.loads((tmp_path / "log.json").read_text()) == {
        "events": [], "objects": [], "objectTypes": [], "eventTypes": []
    }  # fmt: skip
