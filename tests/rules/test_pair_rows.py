"""Changes of relations as rows: what each column becomes, and what begins and ends an interval."""

from __future__ import annotations

from types import MappingProxyType
from uuid import UUID

import pytest

from semap.intake.input_row import relation_row
from semap.intake.map_facts import MapFacts
from semap.rules.engine.presence import Presence
from semap.rules.interval.holding import begins, subject_of
from semap.rules.row import RANKS

CHANGE = {
    "uid": str(UUID(int=1)), "query_name": "q", "kind": "began", "cause": "moved",
    "track_id": None, "track_name": None, "subject_instance_id": None, "subject_instance_name": None,
    "instance_id": None, "instance_name": None, "object_track_id": None, "object_track_name": None,
    "stamp": "1970-01-01 00:00:02+00", "since": "1970-01-01 00:00:01.5+00", "transition_at": "1970-01-01 00:00:01.5+00",
    "x_m": None, "y_m": None, "direction": None, "door_id": None, "door_name": None, "edge": None,
}  # fmt: skip
TRACK = {"track_id": "31", "track_name": "ann"}
CUP = {"subject_instance_id": "21", "subject_instance_name": "cup"}
DESK = {"instance_id": "22", "instance_name": "desk"}
OTHER = {"object_track_id": "32", "object_track_name": "bob"}
SAID = {
    "input": "q", "cause": "moved", "stamp": 1_500_000, "confirmed": 2_000_000, "since": 1_500_000,
    "duration_s": 0.0,
}  # fmt: skip
AS_TRACK, AS_CUP = {"track": "ann", "track_id": 31}, {"subject": "cup", "subject_id": 21}
AS_DESK, AS_OTHER = {"instance": "desk", "instance_id": 22}, {"other": "bob", "other_id": 32}


def row(**columns: str | None):
    return relation_row(MappingProxyType({**CHANGE, **columns}), MapFacts())


@pytest.mark.parametrize(
    ("columns", "values"),
    [
        (TRACK | DESK, AS_TRACK | AS_DESK),
        (TRACK | OTHER, AS_TRACK | AS_OTHER),
        (CUP | DESK, AS_CUP | AS_DESK),
        (CUP | OTHER, AS_CUP | AS_OTHER),
    ],
)
def test_each_side_has_its_own_names(columns: dict[str, str], values: dict[str, object]) -> None:
    found = row(**columns)
    assert found.values == {**SAID, "type": "began", **values}
    assert (found.stamp_us, found.rank, found.source) == (2_000_000, RANKS["relation"] + 1, "relation")


def test_a_crossing_says_where_in_which_direction_and_by_which_door() -> None:
    given = {
        "direction": "left_to_right",
        "x_m": "2.5",
        "y_m": "-1e-3",
        "door_id": "9",
        "door_name": "gate",
        "edge": "4",
    }
    found = row(**TRACK, **DESK, kind="crossed", **given)
    assert found.values == {
        **SAID, "type": "crossed", **AS_TRACK, **AS_DESK, "direction": "left_to_right", "x_m": 2.5, "y_m": -0.001,
        "door": "gate", "door_id": 9, "edge": 4,
    }  # fmt: skip
    assert found.rank == RANKS["relation"]
    assert subject_of(found) is None
    assert not begins(found)


def test_what_has_fewer_columns_has_fewer_properties() -> None:
    """The batch layer makes changes of its own, of tracks in instances."""
    known = (
        "uid",
        "query_name",
        "track_id",
        "track_name",
        "instance_id",
        "instance_name",
        "kind",
        "cause",
        "stamp",
        "since",
    )
    found = relation_row({name: {**CHANGE, **TRACK, **DESK}[name] for name in known}, MapFacts())
    assert found.values == {
        "input": "q", "type": "began", "cause": "moved", "stamp": 2_000_000, "since": 1_500_000, "duration_s": 0.5,
        **AS_TRACK, **AS_DESK,
    }  # fmt: skip


def test_relations_of_one_track_to_others_are_told_apart() -> None:
    """What is stored of intervals of a track in an instance is as it was."""
    subjects = [
        subject_of(row(**a, **b))
        for a in (TRACK, CUP)
        for b in (DESK, OTHER, {**OTHER, "object_track_id": "33"})
    ]
    assert len(set(subjects)) == len(subjects)
    assert subjects[0] == ("q", 31, 22)


def test_subjects_of_an_instance_are_counted_whatever_they_are() -> None:
    presence = Presence()
    sides = [(TRACK, "began", 1), ({**CUP, "subject_instance_id": "31"}, "began", 2), (TRACK, "crossed", 2),
             (TRACK, "began", 2), (TRACK, "ended", 1)]  # fmt: skip
    for subject, kind, count in sides:
        assert presence.after(row(**subject, **DESK, kind=kind)).values["occupants"] == count
    assert "occupants" not in presence.after(row(**TRACK, **OTHER)).values
    again = Presence()
    for text, tracks in presence.changes():
        again.load(text, tracks)  # type: ignore[arg-type]
    assert again.after(row(**CUP, **DESK)).values["occupants"] == 2
