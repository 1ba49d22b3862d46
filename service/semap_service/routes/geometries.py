"""/descriptions/{id}/geometries/{geometry}: what a description consists of, in its own frame"""

from __future__ import annotations

from pathlib import PurePath
from typing import Annotated

from fastapi import APIRouter, File, Form, Path, UploadFile
from fastapi import Request as HttpRequest
from fastapi.responses import Response
from pydantic import Json

from semap.model.source_geometry import SourceGeometry
from semap.store import blueprints
from semap_service.database.transaction import Database, Edit, transaction
from semap_service.documents.document import FewValues, Id, PoseDocument
from semap_service.documents.geometry import (
    GeometryDocument,
    NewGeometry,
    UploadedGeometry,
    geometry_document,
)
from semap_service.exchange.geometry_forms import find_geometry, geometry_forms
from semap_service.exchange.mesh_response import MEDIA_TYPES, Format, format_of, mesh_response
from semap_service.exchange.mesh_upload import Unit, UpAxis, findings, read_upload
from semap_service.http.etag import TaggedRoute, edits, reads
from semap_service.jobs.acceptance import Later, or_later

router = APIRouter(tags=["descriptions"], route_class=TaggedRoute)

WHERE = "/descriptions/{id}/geometries/{geometry}"
GeometryName = Annotated[
    str, Path(min_length=1, max_length=200, pattern=r"^[^/\x00]*$", description="Such as Body or Outline.")
]
MESH: dict[str, dict[str, object]] = {MEDIA_TYPES["glb"]: {}, MEDIA_TYPES["ply"]: {}}


@router.get(
    WHERE,
    operation_id="get_geometry",
    response_model=GeometryDocument,
    responses={**reads(404, 413), 200: {"content": MESH}},
)
def get_geometry(
    request: HttpRequest,
    response: Response,
    database: Database,
    id: Id,  # noqa: A002
    geometry: GeometryName,
    format: Format = None,  # noqa: A002
) -> GeometryDocument | Response:
    """A geometry as JSON, or a mesh as a file: in its own frame, before the pose."""
    with transaction(database) as connection:
        found = find_geometry(connection, id, geometry)
    wanted = format_of(request, format)
    response.headers["Vary"] = "Accept"
    return geometry_document(found) if wanted == "json" else mesh_response(found.shape, wanted)


@router.put(WHERE, operation_id="put_geometry", responses=edits(404))
def put_geometry(edit: Edit, id: Id, geometry: GeometryName, new: NewGeometry) -> GeometryDocument:  # noqa: A002
    """Add a geometry, or replace the one of this name. Every instance of the description follows."""
    source = new.source(geometry)
    with edit.begin(geometry_forms(id, geometry)) as connection:
        blueprints.put_geometry(connection, id, source)
        return geometry_document(find_geometry(connection, id, geometry))


@router.put(
    f"{WHERE}/mesh",
    operation_id="put_geometry_mesh",
    response_model=UploadedGeometry,
    responses=or_later(edits(400, 404, 413)),
)
def put_geometry_mesh(
    edit: Edit,
    later: Later,
    id: Id,  # noqa: A002
    geometry: GeometryName,
    mesh: Annotated[
        UploadFile,
        File(
            description="A mesh file, of the format of its ending; at most 64 MiB, or with "
            "`Prefer: respond-async` 256 MiB."
        ),
    ],
    unit: Unit = None,
    up: UpAxis = None,
    pose: Annotated[
        Json[PoseDocument] | None, FewValues, Form(description="description_T_geometry, as JSON.")
    ] = None,
) -> UploadedGeometry | Response:
    """Upload a mesh as a geometry of this name. Every instance of the description follows."""
    placed = pose or PoseDocument()
    if later is not None:
        options = {
            "description_id": id,
            "geometry": geometry,
            "pose": placed.model_dump(),
            "unit": unit,
            "up": up,
        }
        return later("mesh_upload", mesh, edit.writing, if_match=edit.if_match, options=options)
    read = read_upload(mesh.file.read(), PurePath(mesh.filename or "").suffix, unit, up)
    source = SourceGeometry(geometry, "TRIANGLEMESH3D", read.mesh, placed.pose())
    with edit.begin(geometry_forms(id, geometry)) as connection:
        blueprints.put_geometry(connection, id, source)
    return UploadedGeometry(name=geometry, faces=len(read.mesh.faces), findings=findings(read))


@router.delete(WHERE, operation_id="delete_geometry", status_code=204, responses=edits(404))
def delete_geometry(edit: Edit, id: Id, geometry: GeometryName) -> None:  # noqa: A002
    """Take a geometry out of a description. Every instance of it follows."""
    with edit.begin(geometry_forms(id, geometry)) as connection:
        blueprints.remove_geometry(connection, id, geometry)
