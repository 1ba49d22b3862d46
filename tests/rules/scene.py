"""A small scene for rules: three rooms, two doors between them, persons; rows of it, and rules over it."""

from __future__ import annotations

from collections.abc import Mapping
from uuid import UUID, uuid5

from semap.rules.engine.rule import Rule
from semap.rules.row import RANKS, Row

S = 1_000_000
SCENE = UUID(int=7)
MAP = 1
ROOMS = {"kitchen": 11, "hall": 12, "office": 13}
DOORS = {"kitchen_door": (21, ("kitchen", "hall")), "office_door": (22, ("hall", "office"))}
TRACKS = {"ann": 31, "bob": 32}
QUERIES = {"track_in_room": 5}


def visit(
    track: str, room: str, kind: str, at_s: float, since_s: float | None = None, **values: object
) -> Row:
    """A track enters (began) or leaves (ended) a room."""
    stamp_us = round(at_s * S)
    since_us = stamp_us if since_s is None else round(since_s * S)
    found = {
        "input": "track_in_room", "type": kind, "stamp": stamp_us, "since": since_us, "cause": "moved",
        "track": track, "track_id": TRACKS[track], "instance": room, "instance_id": ROOMS[room],
        "room": room, "room_id": ROOMS[room], "room_uid": room, "concept": "Room", **values,
    }  # fmt: skip
    uid = str(uuid5(SCENE, f"{track} {room} {kind} {stamp_us}"))
    rank = RANKS["relation"] + (kind == "began")
    return Row(stamp_us, rank, uid, "relation", found, ("Room", "Space"))


def door(
    name: str,
    state: str,
    at_s: float,
    actor: str | None = None,
    distance_m: float = 0.5,
    previous: str | None = None,
) -> Row:
    """A door is opened or closed, by somebody if it is known by whom."""
    stamp_us = round(at_s * S)
    instance_id, rooms = DOORS[name]
    found: dict[str, object] = {
        "input": "door", "type": state, "stamp": stamp_us, "instance": name, "instance_id": instance_id,
        "concept": "Door",
        "rooms": [{"room": room, "room_id": ROOMS[room], "room_uid": room, "neighbours": []} for room in rooms],
    }  # fmt: skip
    if previous is not None:
        found["previous"] = previous
    if actor is not None:
        found |= {
            "actor": actor, "actor_id": TRACKS[actor], "actor_likelihood": 0.9, "actor_distance_m": distance_m,
        }  # fmt: skip
    uid = str(uuid5(SCENE, f"{name} {state} {stamp_us}"))
    return Row(stamp_us, RANKS["object_state"], uid, "object_state", found, ("Door",))


def rule(rule_id: int, document: Mapping[str, object], version: int = 1, enabled: bool = True) -> Rule:
    """A rule of the scene, as the database would give it."""
    name = str(document["name"])
    clauses = {clause: value for clause, value in document.items() if clause != "name"}
    return Rule.from_json(
        rule_id,
        {
            "map_id": MAP, "name": name, "version": version, "enabled": enabled, "declaration": clauses,
            "queries": {query: QUERIES[query] for query in QUERIES if query in str(document["input"])},
        },
    )  # fmt: skip


VISITS = {"name": "visits", "input": "track_in_room", "emit": {"began": "entered", "ended": "left"}}
OPENED_THEN_ENTERED = {
    "name": "opened_then_entered",
    "input": ["track_in_room", {"object_state": "door", "actor_within_m": 1.5}],
    "partition_by": "room",
    "pattern": "O followed by E",
    "define": {
        "O": "input = 'door' and type = 'open'",
        "E": "input = 'track_in_room' and type = 'began' and track = first(O.actor)",
    },
    "measures": {"gap_s": "seconds_between(first(O.stamp), last(E.stamp))"},
    "within": "6 s",
    "emit": "entered_by_door",
}
STAYED = {
    "name": "stayed",
    "input": "track_in_room",
    "partition_by": ["track", "room"],
    "pattern": "B not followed by L",
    "define": {"B": "type = 'began'", "L": "type = 'ended'"},
    "within": "3 s",
    "emit": "stayed",
}
BOTH_STAYED = {
    "name": "both_stayed",
    "input": [{"rule": "stayed"}, "track_in_room"],
    "partition_by": "room",
    "pattern": "A followed by B",
    "define": {"A": "input = 'stayed'", "B": "input = 'stayed' and track <> last(A.track)"},
    "within": "10 s",
    "emit": "both_stayed",
}
CROWDED = {
    "name": "crowded",
    "input": "track_in_room",
    "where": "occupants > 1",
    "emit": {"began": "crowded"},
}
TIMED_OUT = {
    "name": "entered_only",
    "input": "track_in_room",
    "partition_by": "track",
    "pattern": "B next L",
    "define": {"B": "type = 'began' and room = 'kitchen'", "L": "type = 'ended'"},
    "within": "2 s",
    "emit": {"match": "short_visit", "timeout": "no_short_visit"},
}
DURING = {
    "name": "there_while_open",
    "input": ["track_in_room", {"object_state": "door"}],
    "partition_by": "room",
    "pattern": "P during|overlaps|overlappedBy|contains D",
    "define": {"P": "input = 'track_in_room'", "D": "input = 'door' and type = 'open'"},
    "emit": "there_while_open",
}
CLOSES_SOON = {
    "name": "closes_soon",
    "input": {"object_state": "door"},
    "partition_by": "instance",
    "when": "O",
    "formula": "eventually[0 s, 2 s] C",
    "define": {"O": "type = 'open'", "C": "type = 'closed'"},
    "emit": {"holds": "closed_soon", "fails": "left_open"},
}
ALL = (VISITS, OPENED_THEN_ENTERED, STAYED, BOTH_STAYED, CROWDED, TIMED_OUT, DURING, CLOSES_SOON)
