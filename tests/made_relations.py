"""Relations of any two sides written by hand, for tests of those who read them.

Their queries rest, so that nothing else writes relations of theirs.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from uuid import NAMESPACE_OID, uuid5

from world import SECOND_US, World

from semap.timeline.stamp import to_datetime

KINDS = (("track", "instance"), ("track", "track"), ("instance", "instance"), ("instance", "track"))
COLUMNS = {
    ("subject", "track"): "track", ("subject", "instance"): "subject_instance",
    ("object", "track"): "object_track", ("object", "instance"): "instance",
}  # fmt: skip
"""What a side's columns are called, less _id and _name."""

Thing = tuple[str, int, str]
"""Kind, id and name."""


def at(second: float) -> Any:
    return to_datetime(round(second * SECOND_US))


def pair_query(world: World, name: str, subject: str, object_: str, **columns: object) -> int:
    """A query whose relations are kept as pairs, and that rests; gives its id."""
    given = {
        "predicate": "nearest", "count": 3, "subject_kind": subject, "object_kind": object_,
        "object_concept_id": None, "enabled": False, **columns,
    }  # fmt: skip
    names = ", ".join(given)
    marks = ", ".join(["%s"] * len(given))
    return world.one(
        f"insert into semap.continuous_query (map_id, name, {names}) values (%s, %s, {marks}) returning query_id",
        world.map_id, name, *given.values(),
    )  # fmt: skip


def sides(subject: Thing, object_: Thing, named: bool = True) -> Mapping[str, object]:
    """The columns of both sides."""
    found: dict[str, object] = {}
    for side, (kind, number, name) in (("subject", subject), ("object", object_)):
        column = COLUMNS[side, kind]
        found[f"{column}_id"] = number
        if named:
            found[f"{column}_name"] = name
    return found


def insert(world: World, table: str, values: Mapping[str, object]) -> None:
    names, marks = ", ".join(values), ", ".join(["%s"] * len(values))
    world.run(f"insert into semap.{table} ({names}) values ({marks})", *values.values())


def hold(world: World, query_id: int, subject: Thing, object_: Thing, since_s: float) -> None:
    """It holds from then on."""
    insert(world, "relation", {
        "in_pairs": True, "map_id": world.map_id, "query_id": query_id, **sides(subject, object_, named=False), "confirmed": True,
        "since": at(since_s), "pending": True, "raw": True,
    })  # fmt: skip


def past(
    world: World, query_id: int, name: str, subject: Thing, object_: Thing, since_s: float, until_s: float
) -> None:
    """It held."""
    insert(world, "relation_past", {
        "map_id": world.map_id, "query_id": query_id, "query_name": name, **sides(subject, object_),
        "since": at(since_s), "until": at(until_s),
    })  # fmt: skip


def change(
    world: World,
    query_id: int,
    name: str,
    kind: str,
    subject: Thing,
    object_: Thing,
    stamp_s: float,
    since_s: float | None = None,
    cause: str = "moved",
    **more: object,
) -> str:
    """It began, ended or was crossed; gives the uid of the change."""
    uid = str(uuid5(NAMESPACE_OID, f"{query_id}|{kind}|{cause}|{subject}|{object_}|{stamp_s}"))
    insert(world, "relation_change", {
        "uid": uid, "map_id": world.map_id, "query_id": query_id, "query_name": name, "kind": kind,
        "cause": cause, **sides(subject, object_), "stamp": at(stamp_s), "transition_at": at(stamp_s),
        "since": at(stamp_s if since_s is None else since_s), **more,
    })  # fmt: skip
    return uid
