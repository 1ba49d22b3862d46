"""/descriptions/{id}/geometries/{geometry}: what a description consists of, in its own frame"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import PurePath
from typing import Annotated

from fastapi import APIRouter, File, Form, Path, UploadFile
from fastapi import Request as HttpRequest
from fastapi.responses import Response
from pydantic import Field, Json
from sqlalchemy import Connection

from semap.errors import InvalidInput, NotFound
from semap.model.building import HeightBand
from semap.model.source_geometry import GeometryType, SourceGeometry
from semap.store import blueprints
from semap_service.document import BandDocument, Document, FewValues, Id, PoseDocument, Request
from semap_service.etag import Representation, TaggedRoute, edits, reads
from semap_service.jobs.acceptance import Later, or_later
from semap_service.mesh_answer import MEDIA_TYPES, Format, format_of, mesh_bytes, mesh_response
from semap_service.mesh_upload import FindingDocument, Unit, UpAxis, findings, read_upload
from semap_service.shape_document import ShapeDocument, fits_json, shape_document, shape_of
from semap_service.transaction import Database, Edit, transaction

router = APIRouter(tags=["descriptions"], route_class=TaggedRoute)

WHERE = "/descriptions/{id}/geometries/{geometry}"
GeometryName = Annotated[
    str, Path(min_length=1, max_length=200, pattern=r"^[^/\x00]*$", description="Such as Body or Outline.")
]
MESH: dict[str, dict[str, object]] = {MEDIA_TYPES["glb"]: {}, MEDIA_TYPES["ply"]: {}}


class GeometryDocument(Document):
    """A source geometry of a description."""

    name: str = Field(examples=["Body"])
    type: GeometryType
    pose: PoseDocument = Field(description="description_T_geometry")
    band: BandDocument | None = Field(
        description="Heights of a POLYGON2D in its own frame; null: every height."
    )
    shape: ShapeDocument = Field(description="In its own frame, before the pose.")


class BandRequest(Request):
    """Heights from z_min_m up to, but not including, z_max_m."""

    z_min_m: float
    z_max_m: float


class NewGeometry(Request):
    """A source geometry. The orientation of POSE2D and POSE3D is that of `pose`; their shape is a point."""

    type: GeometryType
    shape: ShapeDocument
    pose: PoseDocument = Field(PoseDocument(), description="description_T_geometry")
    band: BandRequest | None = Field(None, description="Heights over which a POLYGON2D holds.")

    def source(self, name: str) -> SourceGeometry:
        """raises InvalidInput if the shape is not of the type, or the heights do not rise"""
        if self.band is not None and self.type != "POLYGON2D":
            raise InvalidInput(f"heights of a {self.type}", "Only a POLYGON2D has heights.", "band")
        if self.band is not None and not self.band.z_min_m < self.band.z_max_m:
            raise InvalidInput("heights that do not rise", "Let z_min_m be below z_max_m.", "band")
        band = None if self.band is None else HeightBand(self.band.z_min_m, self.band.z_max_m)
        return SourceGeometry(name, self.type, shape_of(self.shape, self.type), self.pose.pose(), band)


class UploadedGeometry(Document):
    """What became of an upload, and what was repaired in it."""

    name: str = Field(examples=["Body"])
    faces: int = Field(description="How many triangles it has.")
    findings: list[FindingDocument]


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
        found = _find(connection, id, geometry)
    wanted = format_of(request, format)
    response.headers["Vary"] = "Accept"
    return _document(found) if wanted == "json" else mesh_response(found.shape, wanted)


@router.put(WHERE, operation_id="put_geometry", responses=edits(404))
def put_geometry(edit: Edit, id: Id, geometry: GeometryName, new: NewGeometry) -> GeometryDocument:  # noqa: A002
    """Add a geometry, or replace the one of this name. Every instance of the description follows."""
    source = new.source(geometry)
    with edit.begin(geometry_forms(id, geometry)) as connection:
        blueprints.put_geometry(connection, id, source)
        return _document(_find(connection, id, geometry))


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


def _find(connection: Connection, description_id: int, name: str) -> SourceGeometry:
    for each in blueprints.geometries_of(connection, description_id):
        if each.name == name:
            return each
    raise NotFound("geometry", name, f"The description {description_id} says what geometries it has.")


def geometry_forms(
    description_id: int, name: str
) -> Callable[[Connection], tuple[Callable[[], Representation], ...]]:
    """The geometry in each form in which a reader may have got it."""

    def current(connection: Connection) -> tuple[Callable[[], Representation], ...]:
        found = _find(connection, description_id, name)
        as_json = (lambda: _document(found),) if fits_json(found.shape) else ()
        if found.type not in ("TRIANGLEMESH3D", "POLYGONMESH3D"):
            return as_json
        as_files = (lambda: mesh_bytes(found.shape, "glb"), lambda: mesh_bytes(found.shape, "ply"))
        return (*as_json, *as_files)

    return current


def _document(found: SourceGeometry) -> GeometryDocument:
    return GeometryDocument(
        name=found.name,
        type=found.type,
        pose=PoseDocument.model_validate(found.pose),
        band=None if found.band is None else BandDocument.model_validate(found.band),
        shape=shape_document(found.shape),
    )
