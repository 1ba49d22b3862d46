"""What the kinds of jobs do: first what needs no database, then what writes, in one transaction."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from sqlalchemy import Connection

from semap.errors import InvalidInput, NotFound
from semap.formats.geojson_system import Crs
from semap.formats.mesh_file import MAX_BYTES, MeshFile, read_mesh_file
from semap.model.pose import Pose
from semap.model.source_geometry import SourceGeometry
from semap.store.map import blueprints, instances
from semap.store.map.instance_edit import Changes, edit_instance
from semap.store.operate.jobs import Kind
from semap.store.operate.shards import place_new_map
from semap_service.documents.file_import import import_document
from semap_service.documents.geometry import UploadedGeometry
from semap_service.documents.instance import detail
from semap_service.exchange.geometry_forms import geometry_forms
from semap_service.exchange.instance_file import write_instances
from semap_service.exchange.map_file import bring_in, name_of, read_file
from semap_service.exchange.mesh_upload import findings
from semap_service.http.etag import Representation
from semap_service.jobs.task import Task

Progress = Callable[[float, str], None]
"""Told how far a job is, 0 to 1, and what it does; raises where it is to stop."""

READ, SHAPED, WRITTEN = 0.45, 0.8, 0.95
"""How far a map import is when its file is read, its shapes are derived, its rows are written."""


@dataclass(frozen=True)
class Work:
    """prepare  reads the file
    write    brings what was read into the database; returns what a synchronous request would have answered
    current  what If-Match is compared with
    shard_of  the database where the map is or is to be made; None: that of the job
    """

    prepare: Callable[[Task, Progress], Any]
    write: Callable[[Connection, Task, Any, Progress], dict[str, Any]]
    current: Callable[[Connection, Task], Representation | tuple[Callable[[], Representation], ...]]
    shard_of: Callable[[Task, Any], str | None] = lambda task, prepared: task.shard_dsn


def _read_map(task: Task, say: Progress) -> object:
    say(0, "reading the file")
    with tempfile.TemporaryDirectory(prefix="unpacked-", dir=task.path.parent) as scratch:
        try:
            crs = cast("Crs | None", task.options.get("crs"))
            return read_file(task.path, _counted(say, 0, READ, "objects read"), Path(scratch), crs)
        except (InvalidInput, NotFound) as error:
            told = str(error).replace(f"{scratch}/", "").replace(str(task.path), task.file)
            raise InvalidInput(told.replace(f"{task.path.parent}/", ""), error.remedy) from error


def _write_map(connection: Connection, task: Task, found: Any, say: Progress) -> dict[str, Any]:
    say(READ, "deriving shapes")
    shaped = _counted(say, READ, SHAPED, "objects shaped")

    def progress(done: int, total: int) -> None:
        shaped(done, total)
        if done == total:
            say(SHAPED, "writing")

    name = task.options.get("name")
    report = bring_in(
        connection, found, None if name is None else str(name), Path(task.file).stem, progress=progress
    )
    say(WRITTEN, "deriving regions")
    return import_document(report).model_dump(mode="json")


def _shard_of_map(task: Task, found: Any) -> str | None:
    """It is the file that says the name of its map, where nobody else does."""
    name = task.options.get("name")
    stem = Path(task.file).stem
    shard = place_new_map(task.dsn, name_of(found, None if name is None else str(name), stem))
    return None if shard is None else shard.dsn


def _read_mesh(task: Task, say: Progress) -> MeshFile:
    say(0, "reading the mesh")
    return read_mesh_file(
        task.path.read_bytes(),
        task.path.suffix,
        unit=str(task.options.get("unit") or "file"),
        up=None if task.options.get("up") is None else str(task.options["up"]),
        max_bytes=MAX_BYTES,
    )


def _write_mesh(connection: Connection, task: Task, mesh: MeshFile, say: Progress) -> dict[str, Any]:
    say(READ, "deriving shapes and writing")
    if "instance_id" in task.options:
        id_ = _number(task.options, "instance_id")
        edit_instance(connection, id_, Changes(body=mesh.mesh))
        return detail(instances.get_instance(connection, id_)).model_dump(mode="json")
    name = str(task.options["geometry"])
    pose = Pose(**dict(task.options["pose"]))  # type: ignore[call-overload]
    source = SourceGeometry(name, "TRIANGLEMESH3D", mesh.mesh, pose)
    blueprints.put_geometry(connection, _number(task.options, "description_id"), source)
    return UploadedGeometry(name=name, faces=len(mesh.mesh.faces), findings=findings(mesh)).model_dump(
        mode="json"
    )


def _present_mesh(
    connection: Connection, task: Task
) -> Representation | tuple[Callable[[], Representation], ...]:
    if "instance_id" in task.options:
        return detail(instances.get_instance(connection, _number(task.options, "instance_id")))
    forms = geometry_forms(_number(task.options, "description_id"), str(task.options["geometry"]))
    return forms(connection)


def _write_instances(connection: Connection, task: Task, _: object, say: Progress) -> dict[str, Any]:
    found = write_instances(connection, str(task.options["map"]), task.path, task.file, say)
    return found.model_dump(mode="json")


def _nothing(connection: Connection, task: Task) -> tuple[Callable[[], Representation], ...]:
    """A new thing is compared with nothing."""
    return ()


def _counted(say: Progress, start: float, end: float, what: str) -> Callable[[int, int], None]:
    def progress(done: int, total: int) -> None:
        say(start + (end - start) * done / max(total, 1), f"{done} of {total} {what}")

    return progress


def _number(options: Mapping[str, object], key: str) -> int:
    return int(str(options[key]))


KINDS: dict[Kind, Work] = {
    "map_import": Work(_read_map, _write_map, _nothing, _shard_of_map),
    "instance_import": Work(lambda task, say: None, _write_instances, _nothing),
    "mesh_upload": Work(_read_mesh, _write_mesh, _present_mesh),
}
