"""/instances and /maps/{name}/instances"""

from __future__ import annotations

from pathlib import PurePath
from typing import Annotated

from fastapi import APIRouter, File, Form, Query, Response, UploadFile
from pydantic import Json

from semap.formats.mesh_file import read_mesh
from semap.model.building import Mesh
from semap.store import instances
from semap.store.instance_edit import Changes, create_instance, delete_instance, edit_instance
from semap.store.maps import get_map
from semap_service.document import After, Id, Limit, MapFilter, Name, next_after
from semap_service.problem import problems
from semap_service.routes.instance_document import (
    InstanceChanges,
    InstanceDocument,
    InstanceList,
    NewInstance,
    detail,
    summary,
)
from semap_service.transaction import Database, transaction
from semap_service.upload import LIMIT_BYTES

router = APIRouter(tags=["instances"])

MESH = (
    "A mesh in the instance's own frame: glb, obj, ply or stl, as the ending of the file's name says, "
    "in metres, z up (glb: y up, as glTF demands). Without textures; at most 64 MiB."
)


@router.get("/instances", operation_id="list_instances", responses=problems(404))
def list_instances(
    database: Database,
    map_name: MapFilter = None,
    concept: Annotated[Name | None, Query(description="Only of this concept, or of one below it.")] = None,
    name: Annotated[Name | None, Query(description="Only with this name or alias, in any case.")] = None,
    limit: Limit = 100,
    after: After = 0,
) -> InstanceList:
    """What is on the maps, in the order of ids."""
    with transaction(database) as connection:
        if map_name is not None:
            get_map(connection, map_name)
        found = instances.list_instances(
            connection, map_name=map_name, concept_name=concept, name=name, after=after, limit=limit
        )
    return InstanceList(
        instances=[summary(each) for each in found],
        next=next_after([each.instance_id for each in found], limit),
    )


@router.post(
    "/maps/{name}/instances",
    operation_id="create_instance",
    status_code=201,
    responses=problems(400, 404, 409, 413),
)
def create(
    database: Database,
    name: str,
    document: Annotated[Json[NewInstance], Form(description="The instance, as JSON.")],
    response: Response,
    mesh: Annotated[UploadFile | None, File(description=MESH)] = None,
) -> InstanceDocument:
    """Make an instance of a mesh, or of a footprint, or of neither.

    Its absolute footprint is derived at once, and every relation of tracks to it holds with the answer.
    """
    item = document.item(None if mesh is None else _mesh_of(mesh))
    with transaction(database) as connection:
        instance_id = create_instance(connection, name, item)
        made = instances.get_instance(connection, instance_id)
    response.headers["Location"] = f"/instances/{instance_id}"
    return detail(made)


@router.get("/instances/{id}", operation_id="get_instance", responses=problems(404))
def get(database: Database, id: Id) -> InstanceDocument:  # noqa: A002
    """All that is known of an instance, in the map frame."""
    with transaction(database) as connection:
        return detail(instances.get_instance(connection, id))


@router.patch("/instances/{id}", operation_id="change_instance", responses=problems(404, 409))
def change(database: Database, id: Id, changes: InstanceChanges) -> InstanceDocument:  # noqa: A002
    """Change an instance. Its footprint follows its pose, and relations follow its footprint."""
    wanted = changes.changes()
    with transaction(database) as connection:
        edit_instance(connection, id, wanted)
        return detail(instances.get_instance(connection, id))


@router.put("/instances/{id}/mesh", operation_id="put_mesh", responses=problems(400, 404, 409, 413))
def put_mesh(
    database: Database,
    id: Id,  # noqa: A002
    mesh: Annotated[UploadFile, File(description=MESH)],
) -> InstanceDocument:
    """Give an instance another mesh; the mesh's outline and heights replace those that were there."""
    body = _mesh_of(mesh)
    with transaction(database) as connection:
        edit_instance(connection, id, Changes(body=body))
        return detail(instances.get_instance(connection, id))


@router.delete(
    "/instances/{id}", operation_id="delete_instance", status_code=204, responses=problems(404, 409)
)
def delete(database: Database, id: Id) -> None:  # noqa: A002
    """Delete an instance; relations to it end. One that carries others, such as a storey, is refused."""
    with transaction(database) as connection:
        delete_instance(connection, id)


def _mesh_of(upload: UploadFile) -> Mesh:
    return read_mesh(upload.file.read(), PurePath(upload.filename or "").suffix, max_bytes=LIMIT_BYTES)
