"""/maps/{name}/grids: occupancy grids, backdrops of a map"""

from __future__ import annotations

import hashlib
import re
import tempfile
from collections.abc import Callable
from pathlib import Path, PurePath
from typing import Annotated, Literal

from fastapi import APIRouter, File, Query, UploadFile
from fastapi import Path as InPath
from fastapi import Request as HttpRequest
from fastapi.responses import Response
from pydantic import Field
from sqlalchemy import Connection

from semap.errors import InvalidInput, NotFound
from semap.formats.occupancy_grid import read_grid, write_pgm
from semap.model.map_document import OccupancyGrid
from semap.store import grids
from semap_service.database.transaction import Database, Edit, transaction
from semap_service.documents.document import Document
from semap_service.http.etag import Representation, TaggedRoute, edits, reads

router = APIRouter(tags=["maps"], route_class=TaggedRoute)

WHERE = "/maps/{name}/grids/{grid}"
PGM = "image/x-portable-graymap"
IMAGE_NAME = re.compile(r"\w[\w .+-]{0,60}")
GridName = Annotated[str, InPath(min_length=1, max_length=200, pattern=r"^[^/\x00]*$")]


class GridDocument(Document):
    """An occupancy grid, as map_server describes it; its pixels are available as PGM."""

    name: str = Field(examples=["floor_1"])
    resolution_m: float = Field(description="Side of a pixel.", examples=[0.05])
    width: int
    height: int
    origin_x_m: float = Field(description="Of the lower left corner in the map frame.")
    origin_y_m: float
    origin_yaw_rad: float
    negate: bool
    occupied_thresh: float
    free_thresh: float
    mode: Literal["trinary", "scale", "raw"]
    sha256: str = Field(description="Of the pixels, row by row from the top.")


class GridList(Document):
    grids: list[GridDocument] = Field(description="By name.")
    next: str | None = Field(description="`after` of the next page; null where this is the last one.")


@router.get("/maps/{name}/grids", operation_id="list_grids", responses=reads(404))
def list_grids(
    database: Database,
    name: str,
    limit: Annotated[int, Query(ge=1, le=100, description="At most so many.")] = 100,
    after: Annotated[
        str, Query(max_length=200, pattern=r"^[^\x00]*$", description="Go on after this name.")
    ] = "",
) -> GridList:
    """The occupancy grids of a map."""
    with transaction(database) as connection:
        found = grids.read_grids(connection, name, after=after, limit=limit)
    return GridList(
        grids=[_document(each) for each in found], next=found[-1].name if len(found) == limit else None
    )


@router.get(
    WHERE,
    operation_id="get_grid",
    response_model=GridDocument,
    responses={**reads(404), 200: {"content": {PGM: {}}}},
)
def get_grid(
    request: HttpRequest,
    response: Response,
    database: Database,
    name: str,
    grid: GridName,
    format: Annotated[  # noqa: A002
        Literal["json", "pgm"] | None, Query(description="Metadata or pixels. [default: by Accept]")
    ] = None,
) -> GridDocument | Response:
    """An occupancy grid: where it lies, or (pgm) its pixels."""
    with transaction(database) as connection:
        found = _find(connection, name, grid)
    if format == "pgm" or (format is None and PGM in request.headers.get("accept", "")):
        return Response(write_pgm(found.pixels), media_type=PGM, headers={"Vary": "Accept"})
    response.headers["Vary"] = "Accept"
    return _document(found)


@router.put(WHERE, operation_id="put_grid", responses=edits(400, 404, 413))
def put_grid(
    edit: Edit,
    name: str,
    grid: GridName,
    image: Annotated[UploadFile, File(description="The image, PGM, under the name in the YAML file.")],
    yaml: Annotated[UploadFile, File(description="The YAML file that map_server writes beside it.")],
) -> GridDocument:
    """Add a grid to a map, or replace the one of this name, from the two files that map_server writes."""
    made = _read(image, yaml, grid)
    with edit.begin(_forms(name, grid)) as connection:
        grids.put_grid(connection, name, made)
    return _document(made)


@router.delete(WHERE, operation_id="delete_grid", status_code=204, responses=edits(404))
def delete_grid(edit: Edit, name: str, grid: GridName) -> None:
    """Take a grid off a map."""
    with edit.begin(_forms(name, grid)) as connection:
        grids.delete_grid(connection, name, grid)


def _read(image: UploadFile, yaml: UploadFile, name: str) -> OccupancyGrid:
    with tempfile.TemporaryDirectory(prefix="semap-grid-") as folder:
        description = Path(folder, "grid.yaml")
        description.write_bytes(yaml.file.read())
        image_name = PurePath(image.filename or "").name
        if not IMAGE_NAME.fullmatch(image_name) or image_name == description.name:
            raise InvalidInput(
                f"an image named {image_name!r}", "Give it a short name of letters and digits.", "image"
            )
        Path(folder, image_name).write_bytes(image.file.read())
        try:
            return read_grid(description, name)
        except (InvalidInput, NotFound) as error:
            raise InvalidInput(str(error).replace(f"{folder}/", ""), error.remedy) from error


def _find(connection: Connection, map_name: str, name: str) -> OccupancyGrid:
    for each in grids.read_grids(connection, map_name, name):
        return each
    raise NotFound("grid", name, f"List the grids of the map {map_name}.")


def _forms(map_name: str, name: str) -> Callable[[Connection], tuple[Callable[[], Representation], ...]]:
    """The grid in each form in which a reader may have got it."""

    def current(connection: Connection) -> tuple[Callable[[], Representation], ...]:
        found = _find(connection, map_name, name)
        return (lambda: _document(found), lambda: write_pgm(found.pixels))

    return current


def _document(grid: OccupancyGrid) -> GridDocument:
    height, width = grid.pixels.shape
    x_m, y_m, yaw_rad = grid.origin
    return GridDocument(
        name=grid.name,
        resolution_m=grid.resolution_m,
        width=width,
        height=height,
        origin_x_m=x_m,
        origin_y_m=y_m,
        origin_yaw_rad=yaw_rad,
        negate=grid.negate,
        occupied_thresh=grid.thresholds[0],
        free_thresh=grid.thresholds[1],
        mode=grid.mode,
        sha256=hashlib.sha256(grid.pixels.tobytes()).hexdigest(),
    )
