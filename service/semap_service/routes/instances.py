"""/instances and /maps/{name}/instances"""

from __future__ import annotations

from pathlib import PurePath
from typing import Annotated

from fastapi import APIRouter, File, Form, Query, Response, UploadFile
from pydantic import Json
from sqlalchemy import Connection

from semap.errors import InvalidInput
from semap.model.building import Mesh
from semap.store import history, instance_links, instances
from semap.store.instance_edit import Carried, Changes, create_instance, delete_instance, edit_instance
from semap.store.maps import get_map
from semap_service.database.transaction import Database, Edit, Write, transaction
from semap_service.documents.document import (
    After,
    FewValues,
    Id,
    InStamp,
    Limit,
    MapFilter,
    Name,
    Request,
    next_after,
)
from semap_service.documents.instance import (
    InstanceChanges,
    InstanceDocument,
    InstanceList,
    InstanceSummary,
    NewInstance,
    PastInstanceDocument,
    detail,
    past_detail,
    past_summary,
)
from semap_service.exchange.crs import Crs, footprint_in
from semap_service.exchange.mesh_upload import Unit, UpAxis, read_upload
from semap_service.http.etag import TaggedRoute, edits, reads
from semap_service.http.problem import problems
from semap_service.jobs.acceptance import Later, or_later

router = APIRouter(tags=["instances"], route_class=TaggedRoute)

MESH = (
    "A mesh in the instance's own frame, in the format of the file's ending. "
    "Without textures; at most 64 MiB."
)
AsOf = Annotated[InStamp | None, Query(description="As it was at this time (RFC 3339). [default: now]")]


class CopyName(Request):
    name: Name


@router.get("/instances", operation_id="list_instances", responses=reads(404))
def list_instances(
    database: Database,
    map_name: MapFilter = None,
    concept: Annotated[Name | None, Query(description="Only of this concept, or of one below it.")] = None,
    name: Annotated[Name | None, Query(description="Only with this name or alias, in any case.")] = None,
    as_of: AsOf = None,
    limit: Limit = 100,
    after: After = 0,
) -> InstanceList:
    """The instances of the maps, in the order of ids. With `as_of`: those of one map at a time."""
    with transaction(database) as connection:
        if map_name is not None:
            get_map(connection, map_name)
        if as_of is not None:
            if map_name is None or concept is not None or name is not None:
                raise InvalidInput(
                    "a past time goes with a map and no other filter", "Give map and as_of.", "as_of"
                )
            past = history.instances_as_of(connection, map_name, as_of, after=after, limit=limit)
            return InstanceList(
                instances=[past_summary(map_name, each) for each in past],
                next=next_after([each.instance_id for each in past], limit),
            )
        found = instances.list_instances(
            connection, map_name=map_name, concept_name=concept, name=name, after=after, limit=limit
        )
    return InstanceList(
        instances=[InstanceSummary.model_validate(each) for each in found],
        next=next_after([each.instance_id for each in found], limit),
    )


@router.post(
    "/maps/{name}/instances",
    operation_id="create_instance",
    status_code=201,
    responses=problems(400, 404, 409, 413),
)
def create(
    write: Write,
    name: str,
    document: Annotated[Json[NewInstance], FewValues, Form(description="The instance, as JSON.")],
    response: Response,
    mesh: Annotated[UploadFile | None, File(description=MESH)] = None,
    unit: Unit = None,
    up: UpAxis = None,
) -> InstanceDocument:
    """Make an instance of a mesh, of a footprint, of a blueprint, or of nothing.

    Its absolute footprint is derived at once, and every relation of tracks to it holds with the answer.
    """
    item = document.item(None if mesh is None else _uploaded(mesh, unit, up))
    with write.begin() as connection:
        instance_id = create_instance(connection, name, item)
        if document.frame is not None:
            instance_links.carry_by(connection, instance_id, document.frame)
        if document.local_pose is not None:
            instance_links.place_locally(connection, instance_id, document.local_pose.pose())
        if document.description is not None:
            instance_links.describe_as(connection, instance_id, document.description)
        made = _read(connection, instance_id)
    response.headers["Location"] = f"/instances/{instance_id}"
    return made


@router.get("/instances/{id}", operation_id="get_instance", responses=reads(404, 409))
def get(
    database: Database,
    id: Id,  # noqa: A002
    as_of: AsOf = None,
    crs: Crs = None,
) -> InstanceDocument | PastInstanceDocument:
    """All that is known of an instance, in the map frame; with `as_of` what is known of its past."""
    with transaction(database) as connection:
        if as_of is not None:
            map_name, past = history.instance_as_of(connection, id, as_of)
            return past_detail(map_name, past, as_of)
        found = footprint_in(connection, instances.get_instance(connection, id), crs)
    return detail(found, crs)


@router.patch("/instances/{id}", operation_id="change_instance", responses=edits(404, 409))
def change(edit: Edit, id: Id, changes: InstanceChanges) -> InstanceDocument:  # noqa: A002
    """Change an instance. Its footprint follows its pose, and relations follow its footprint.

    In this order: its description, its frame, then all else.
    """
    wanted = changes.changes()
    with edit.begin(lambda connection: _read(connection, id)) as connection:
        if "description" in changes.model_fields_set:
            instance_links.describe_as(connection, id, changes.description)
        if changes.frame is not None:
            instance_links.carry_by(connection, id, changes.frame, changes.keep)
        if changes.local_pose is not None:
            instance_links.place_locally(connection, id, changes.local_pose.pose())
        if "storey" in changes.model_fields_set:
            instance_links.set_storey(connection, id, changes.storey)
        if changes.joins is not None:
            instance_links.set_joins(connection, id, changes.joins)
        edit_instance(connection, id, wanted)
        return _read(connection, id)


@router.put(
    "/instances/{id}/mesh",
    operation_id="put_mesh",
    response_model=InstanceDocument,
    responses=or_later(edits(400, 404, 409, 413)),
)
def put_mesh(
    edit: Edit,
    later: Later,
    id: Id,  # noqa: A002
    mesh: Annotated[UploadFile, File(description=MESH)],
    unit: Unit = None,
    up: UpAxis = None,
) -> InstanceDocument | Response:
    """Give an instance another mesh; the mesh's outline and heights replace those that were there.

    If-Match names the instance. With `Prefer: respond-async` the mesh may have 256 MiB.
    """
    if later is not None:
        options = {"instance_id": id, "unit": unit, "up": up}
        return later("mesh_upload", mesh, edit.writing, if_match=edit.if_match, options=options)
    body = _uploaded(mesh, unit, up)
    with edit.begin(lambda connection: _read(connection, id)) as connection:
        edit_instance(connection, id, Changes(body=body))
        return _read(connection, id)


@router.post(
    "/instances/{id}/copy", operation_id="copy_instance", status_code=201, responses=problems(404, 409)
)
def copy(write: Write, id: Id, new: CopyName, response: Response) -> InstanceDocument:  # noqa: A002
    """Make another instance that looks like this one, on the same frame at the same place."""
    with write.begin() as connection:
        made = instance_links.copy_instance(connection, id, new.name)
        document = _read(connection, made)
    response.headers["Location"] = f"/instances/{made}"
    return document


@router.delete("/instances/{id}", operation_id="delete_instance", status_code=204, responses=edits(404, 409))
def delete(
    edit: Edit,
    id: Id,  # noqa: A002
    carried: Annotated[
        Carried,
        Query(
            description="What becomes of what stands on it: delete it too, keep it in its place, or refuse."
        ),
    ] = "refuse",
) -> None:
    """Delete an instance; relations to it end."""
    with edit.begin(lambda connection: _read(connection, id)) as connection:
        delete_instance(connection, id, carried)


def _read(connection: Connection, instance_id: int) -> InstanceDocument:
    return detail(instances.get_instance(connection, instance_id))


def _uploaded(mesh: UploadFile, unit: str | None, up: str | None) -> Mesh:
    return read_upload(mesh.file.read(), PurePath(mesh.filename or "").suffix, unit, up).mesh
