"""What is on a map: instances, rooms, and questions of space about them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from semap.client.exchange import (
    Answer,
    Plan,
    Request,
    Upload,
    ask,
    given,
    pages,
    read,
    segment,
    without_none,
)
from semap.client.table import Table
from semap.client.values import (
    Instance,
    InstanceDetail,
    Occupant,
    Operator,
    Pose,
    Room,
    Selection,
    Shape,
)

MeshUnit = Literal["file", "m", "cm", "mm", "inch", "foot"]
UpAxis = Literal["x", "y", "z"]
Carried = Literal["refuse", "delete", "keep"]


def list_rooms(map: str | None = None, *, limit: int | None = None) -> Plan[Table[Room]]:  # noqa: A002
    """Rooms, with how many are in them now."""
    return Table(Room, (yield from pages(Room, "/rooms", "rooms", limit, map=map)))


def list_occupants(room_id: int, *, limit: int | None = None) -> Plan[Table[Occupant]]:
    """Who is in a room now, and since when. raises NotFound"""
    path = f"/rooms/{room_id}/occupants"
    return Table(Occupant, (yield from pages(Occupant, path, "occupants", limit)))


def list_instances(
    map: str | None = None,  # noqa: A002
    *,
    concept: str | None = None,
    name: str | None = None,
    as_of: datetime | None = None,
    limit: int | None = None,
) -> Plan[Table[Instance]]:
    """What is on the maps; a concept stands for those below it, too.

    as_of  what was on one map at a time; goes with no filter but `map`
    """
    wanted = {"map": map, "concept": concept, "name": name, "as_of": as_of}
    return Table(Instance, (yield from pages(Instance, "/instances", "instances", limit, **wanted)))


def get_instance(instance_id: int) -> Plan[InstanceDetail]:
    """All that is known of an instance. raises NotFound"""
    return _detail((yield from ask(Request("GET", f"/instances/{instance_id}"))))


def add_instance(
    map: str,  # noqa: A002
    name: str,
    concept: str,
    *,
    mesh: Path | str | None = None,
    unit: MeshUnit | None = None,
    up: UpAxis | None = None,
    footprint: Shape | None = None,
    height_m: float | None = None,
    pose: Pose | None = None,
    **more: Any,
) -> Plan[InstanceDetail]:
    """Put something on a map; what it looks like is a mesh file, an outline with a height, or a blueprint.

    mesh    in the instance's own frame; `unit` and `up` where the file does not say them
    more    alias, storey, joins, attributes, description, frame, local_pose, elevation_m
    raises  NotFound, Conflict, InvalidInput
    """
    document = without_none(
        {
            "name": name,
            "concept": concept,
            "footprint": footprint,
            "height_m": height_m,
            "pose": None if pose is None else asdict(pose),
            **more,
        }
    )
    form = {"document": json.dumps(document), **given({"unit": unit, "up": up})}
    request = Request("POST", f"/maps/{segment(map)}/instances", form=form, files=_mesh(mesh))
    return _detail((yield from ask(request)))


def change_instance(instance_id: int, *, if_match: str | None = None, **changes: Any) -> Plan[InstanceDetail]:
    """Change an instance: name, alias, concept, attributes, pose, footprint, height_m, storey, joins, ...

    if_match  the etag of what was read; ChangedMeanwhile where it has been changed since
    """
    if isinstance(changes.get("pose"), Pose):
        changes["pose"] = asdict(changes["pose"])
    headers = {} if if_match is None else {"If-Match": if_match}
    request = Request("PATCH", f"/instances/{instance_id}", body=changes, headers=headers)
    return _detail((yield from ask(request)))


def put_mesh(
    instance_id: int, mesh: Path | str, *, unit: MeshUnit | None = None, up: UpAxis | None = None
) -> Plan[InstanceDetail]:
    """Give an instance another mesh, from a file. raises NotFound, InvalidInput, TooLarge"""
    request = Request(
        "PUT",
        f"/instances/{instance_id}/mesh",
        form=given({"unit": unit, "up": up}),
        files=_mesh(mesh),
        repeatable=True,
    )
    return _detail((yield from ask(request)))


def delete_instance(instance_id: int, *, carried: Carried = "refuse") -> Plan[None]:
    """Delete an instance; `carried` says what becomes of what stands on it. raises NotFound, Conflict"""
    yield from ask(Request("DELETE", f"/instances/{instance_id}", {"carried": carried}))


def list_operators() -> Plan[Table[Operator]]:
    """The questions of space that `ask` asks."""
    answer = yield from ask(Request("GET", "/operators"))
    return Table(Operator, read(tuple[Operator, ...], answer.document()["operators"]))


def ask_operator(
    map: str,  # noqa: A002
    operator: str,
    *,
    references: Selection | None = None,
    targets: Selection | None = None,
    limit: int | None = None,
    **parameters: Any,
) -> Plan[Sequence[Mapping[str, Any]]]:
    """Ask an operator about a map: rows by column, of all pages or the first `limit`.

    references, targets  what is asked about and what is looked for; None: everything on the map
    raises               NotFound, InvalidInput
    """
    path = f"/maps/{segment(map)}/operators/{segment(operator)}"
    body: dict[str, Any] = {
        "references": _selection(references),
        "targets": _selection(targets),
        "parameters": parameters,
    }
    rows: list[Mapping[str, Any]] = []
    while limit is None or len(rows) < limit:
        body["limit"] = 1000 if limit is None else min(1000, limit - len(rows))
        document = (yield from ask(Request("POST", path, body=body))).document()
        rows += document["rows"]
        if document["next"] is None:
            break
        body["after"] = document["next"]
    return tuple(rows)


def _selection(selection: Selection | None) -> dict[str, Any] | None:
    return None if selection is None else without_none(asdict(selection))


def _mesh(mesh: Path | str | None) -> dict[str, Upload]:
    if mesh is None:
        return {}
    return {"mesh": Upload(Path(mesh).name, Path(mesh))}


def _detail(answer: Answer) -> InstanceDetail:
    return replace(answer.read(InstanceDetail), etag=answer.headers.get("etag", ""))
