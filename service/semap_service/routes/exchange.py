"""/maps/import, /maps/{name}/instances/import and /maps/{name}/export: maps and instances as files"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePath
from typing import Annotated, Literal
from urllib.parse import quote

from fastapi import APIRouter, File, Query, Response, UploadFile
from fastapi.responses import FileResponse
from sqlalchemy import Connection
from starlette.background import BackgroundTask

from semap.errors import InvalidInput, NotFound
from semap.formats import write_map
from semap.formats.geojson_system import Crs as Coordinates
from semap.formats.gltf import write_gltf
from semap.store.database.connection import see_one_state
from semap.store.exchange.map_export import export_map, placed_instances
from semap.store.map.maps import get_map
from semap_service.database.transaction import Database, Write, transaction
from semap_service.documents.document import Name
from semap_service.documents.file_import import ImportDocument, InstanceImportDocument, import_document
from semap_service.exchange.crs import Crs
from semap_service.exchange.file_name import file_name
from semap_service.exchange.instance_file import write_instances
from semap_service.exchange.map_file import bring_in, name_of, read_file
from semap_service.exchange.placed_geojson import placed_geojson
from semap_service.exchange.zip_archive import pack
from semap_service.http.problem import problems
from semap_service.jobs.acceptance import Later, or_later

router = APIRouter(tags=["maps"])

ExportFormat = Literal["yaml", "glb", "geojson"]
MEDIA_TYPES: dict[ExportFormat, str] = {
    "yaml": "application/zip",
    "glb": "model/gltf-binary",
    "geojson": "application/geo+json",
}
SUFFIXES: dict[ExportFormat, str] = {"yaml": "zip", "glb": "glb", "geojson": "geojson"}
FILE = (
    "A map: .yaml, or .zip of its folder as an export gives it; or a building: .geojson, .ifc or .gml. "
    "At most 64 MiB, or with `Prefer: respond-async` what the service is set to."
)
INSTANCES = (
    ".ndjson: on each line an instance as `POST /maps/{name}/instances` takes it, without a mesh; or "
    ".geojson: a floor plan. At most 64 MiB, or with `Prefer: respond-async` what the service is set to."
)


@router.post(
    "/maps/import",
    operation_id="import_map",
    status_code=201,
    response_model=ImportDocument,
    responses=or_later(problems(400, 409, 413)),
)
def import_file(
    write: Write,
    later: Later,
    file: Annotated[UploadFile, File(description=FILE)],
    response: Response,
    name: Annotated[
        Name | None,
        Query(
            pattern=r"^[^/\x00]*$", description="Of the map. [default: named in the file, else as the file]"
        ),
    ] = None,
    crs: Annotated[
        Coordinates | None,
        Query(description="The unit of GeoJSON's coordinates. [default: found from the file]"),
    ] = None,
) -> ImportDocument | Response:
    """Bring in a map or a building, all of it or nothing.

    A map becomes a new one. A building goes into the map of the name, which is made if there is none.
    """
    given = file_name(file)
    if later is not None:
        return later("map_import", file, write, map_name=name, options={"name": name, "crs": crs})
    with _kept(file, given) as path:
        scratch = path.parent / "unpacked"
        scratch.mkdir()
        try:
            found = read_file(path, scratch=scratch, crs=crs)
        except (InvalidInput, NotFound) as error:
            told = (
                str(error).replace(f"{scratch}/", "").replace(str(path), given).replace(f"{path.parent}/", "")
            )
            raise InvalidInput(told, error.remedy) from error
    stem = PurePath(given).stem
    with write.to(name_of(found, name, stem), is_new=True).begin() as connection:
        report = bring_in(connection, found, name, stem)
    response.headers["Location"] = f"/maps/{quote(report.map, safe='')}"
    return import_document(report)


@router.post(
    "/maps/{name}/instances/import",
    operation_id="import_instances",
    status_code=201,
    response_model=InstanceImportDocument,
    responses=or_later(problems(400, 404, 409, 413)),
)
def import_instances(
    write: Write,
    later: Later,
    name: str,
    file: Annotated[UploadFile, File(description=INSTANCES)],
) -> InstanceImportDocument | Response:
    """Make many instances on a map that exists, all of them or none."""
    given = file_name(file)
    if later is not None:
        with write.begin() as connection:
            get_map(connection, name)
        return later("instance_import", file, write, map_name=name, options={"map": name})
    with _kept(file, given) as path, write.begin() as connection:
        return write_instances(connection, name, path, given, lambda share, message: None)


@router.get(
    "/maps/{name}/export",
    operation_id="export_map",
    response_class=Response,
    responses={
        **problems(404, 409),
        200: {"description": "The file.", "content": {each: {} for each in MEDIA_TYPES.values()}},
    },
)
def export(
    database: Database,
    name: str,
    format: Annotated[  # noqa: A002
        ExportFormat,
        Query(
            description="yaml: the whole map without loss, a zip of map.yaml and meshes; "
            "glb: its meshes; geojson: its outlines."
        ),
    ] = "yaml",
    crs: Crs = None,
) -> Response:
    """A whole map as a file. `crs` is for geojson only."""
    if crs is not None and format != "geojson":
        raise InvalidInput(f"{format} in another system", "Ask for geojson.", "crs")
    named = f"attachment; filename*=UTF-8''{quote(name, safe='')}.{SUFFIXES[format]}"
    headers = {"Content-Disposition": named}
    with transaction(database) as connection:
        see_one_state(connection)
        if format == "yaml":
            return _zipped(connection, name, headers)
        placed = placed_instances(connection, name)
        document = placed_geojson(connection, name, placed, crs) if format == "geojson" else None
    body = write_gltf(placed) if document is None else json.dumps(document, ensure_ascii=False).encode()
    return Response(body, media_type=MEDIA_TYPES[format], headers=headers)


def _zipped(connection: Connection, name: str, headers: dict[str, str]) -> FileResponse:
    document = export_map(connection, name)
    folder = Path(tempfile.mkdtemp(prefix="semap-export-"))
    try:
        write_map(document, folder / "map")
        pack(folder / "map", folder / "map.zip")
        shutil.rmtree(folder / "map")
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    gone = BackgroundTask(shutil.rmtree, folder, ignore_errors=True)
    return FileResponse(folder / "map.zip", media_type=MEDIA_TYPES["yaml"], headers=headers, background=gone)


@contextmanager
def _kept(file: UploadFile, given: str) -> Iterator[Path]:
    """An upload as a file, for those who read files."""
    with tempfile.TemporaryDirectory(prefix="semap-import-") as folder:
        path = Path(folder) / f"upload{PurePath(given).suffix}"
        with path.open("wb") as copy:
            shutil.copyfileobj(file.file, copy)
        yield path
