"""/maps/{name}/anchor: where on the earth a map lies"""

from __future__ import annotations

from fastapi import APIRouter
from pydantic import Field
from sqlalchemy import Connection

from semap.errors import NotFound
from semap.model.anchor import Anchor
from semap.store.anchor import read_anchor, remove_anchor, set_anchor
from semap_service.database.transaction import Database, Edit, transaction
from semap_service.documents.document import PoseDocument, Request
from semap_service.http.etag import TaggedRoute, edits, reads

router = APIRouter(tags=["maps"], route_class=TaggedRoute)

WHERE = "/maps/{name}/anchor"


class AnchorDocument(Request):
    """Where the map frame stands in a metric system of the earth."""

    epsg: int = Field(ge=1024, le=32767, description="A projected system in metres.", examples=[25832])
    pose: PoseDocument = Field(PoseDocument(), description="earth_T_map")


@router.get(WHERE, operation_id="get_anchor", responses=reads(404))
def get_anchor(database: Database, name: str) -> AnchorDocument:
    """The anchor of a map, its place on the earth; 404 without one."""
    with transaction(database) as connection:
        return _read(connection, name)


@router.put(WHERE, operation_id="put_anchor", responses=edits(404))
def put_anchor(edit: Edit, name: str, anchor: AnchorDocument) -> AnchorDocument:
    """Set the anchor of a map; from then on shapes are available in other systems (`crs`)."""
    with edit.begin(lambda connection: _read(connection, name)) as connection:
        set_anchor(connection, name, Anchor(anchor.epsg, anchor.pose.pose()))
        return _read(connection, name)


@router.delete(WHERE, operation_id="delete_anchor", status_code=204, responses=edits(404))
def delete_anchor(edit: Edit, name: str) -> None:
    """Forget where on the earth a map lies."""
    with edit.begin(lambda connection: _read(connection, name)) as connection:
        _read(connection, name)
        remove_anchor(connection, name)


def _read(connection: Connection, name: str) -> AnchorDocument:
    found = read_anchor(connection, name)
    if found is None:
        raise NotFound("anchor of the map", name, f"Set one: PUT /maps/{name}/anchor.")
    return AnchorDocument(epsg=found.epsg, pose=PoseDocument.model_validate(found.pose))
