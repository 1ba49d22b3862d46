"""Shapes as documents: GeoJSON for points and areas, vertices and faces for surfaces in space; metres."""

from __future__ import annotations

from typing import Annotated, Literal, cast

import numpy as np
import shapely
from pydantic import Field
from shapely import MultiPolygon, Point, Polygon
from shapely.geometry import mapping, shape

from semap.errors import InvalidInput, TooLarge
from semap.model.building import Mesh
from semap.model.source_geometry import GeometryType, PolygonMesh, Shape
from semap_service.documents.document import (
    MultiPolygonDocument,
    PolygonDocument,
    Position,
    Request,
    area_document,
)

MAX_JSON_FACES = 200_000
FLAT = ("POINT2D", "POSE2D", "POLYGON2D")
SHAPES: dict[GeometryType, tuple[type, ...]] = {
    "POINT2D": (Point,),
    "POSE2D": (Point,),
    "POLYGON2D": (Polygon, MultiPolygon),
    "POINT3D": (Point,),
    "POSE3D": (Point,),
    "POLYGON3D": (Polygon,),
    "TRIANGLEMESH3D": (Mesh,),
    "POLYGONMESH3D": (PolygonMesh,),
}


class PointDocument(Request):
    """GeoJSON point: metres instead of degrees."""

    type: Literal["Point"]
    coordinates: Position


class SurfaceDocument(Request):
    """A surface of planar faces; triangles for a triangle mesh."""

    type: Literal["Surface"]
    vertices_m: list[Annotated[list[float], Field(min_length=3, max_length=3)]]
    faces: list[Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=3)]] = Field(
        description="Of each face the indices of its vertices, counter-clockwise seen from outside."
    )


ShapeDocument = Annotated[
    PointDocument | PolygonDocument | MultiPolygonDocument | SurfaceDocument, Field(discriminator="type")
]


def fits_json(found: shapely.Geometry | Mesh | PolygonMesh) -> bool:
    """Whether it is small enough for JSON; else it is given as a mesh file only."""
    return not isinstance(found, Mesh | PolygonMesh) or len(found.faces) <= MAX_JSON_FACES


def shape_document(
    found: shapely.Geometry | Mesh | PolygonMesh,
) -> PointDocument | PolygonDocument | MultiPolygonDocument | SurfaceDocument:
    """The document of a shape.

    raises  TooLarge for a surface of more faces than JSON is good for
    """
    if isinstance(found, Mesh | PolygonMesh):
        if not fits_json(found):
            raise TooLarge(
                f"It has {len(found.faces)} faces; as JSON at most {MAX_JSON_FACES} are given.",
                "Ask for it as a mesh file: ?format=glb or ?format=ply.",
            )
        faces = found.faces.tolist() if isinstance(found, Mesh) else [list(face) for face in found.faces]
        return SurfaceDocument(type="Surface", vertices_m=found.vertices_m.tolist(), faces=faces)
    if isinstance(found, Point):
        return PointDocument(type="Point", coordinates=list(mapping(found)["coordinates"]))
    return area_document(found)


def shape_of(
    document: PointDocument | PolygonDocument | MultiPolygonDocument | SurfaceDocument, type_: GeometryType
) -> Shape:
    """The shape of a source geometry of a type.

    raises  InvalidInput if the document is of another type, a ring is open, or a face names no vertex
    """
    made: shapely.Geometry | Mesh | PolygonMesh
    made = _surface(document, type_) if isinstance(document, SurfaceDocument) else _geojson(document)
    if not isinstance(made, SHAPES[type_]):
        raise InvalidInput(
            f"{document.type} is no shape of a {type_}", "See the types in the documentation.", "shape"
        )
    assert isinstance(made, Point | Polygon | MultiPolygon | Mesh | PolygonMesh)  # noqa: S101  (SHAPES says so)
    if isinstance(made, Mesh | PolygonMesh):
        return made
    if type_ in FLAT:
        if not made.is_valid:
            raise InvalidInput("an area that crosses itself", "Give a valid polygon.", "shape")
        return cast(Shape, shapely.force_2d(made))
    if not made.has_z:
        raise InvalidInput(f"a {type_} without heights", "Give each position as x, y, z.", "shape")
    return made


def _geojson(document: PointDocument | PolygonDocument | MultiPolygonDocument) -> shapely.Geometry:
    try:
        return shape(document.model_dump())
    except (ValueError, shapely.errors.GEOSException) as error:
        raise InvalidInput(
            str(error), "Close each ring with its first point; give x, y or x, y, z throughout.", "shape"
        ) from error


def _surface(document: SurfaceDocument, type_: GeometryType) -> Mesh | PolygonMesh:
    vertices_m = np.array(document.vertices_m, dtype=np.float64).reshape(-1, 3)
    if not document.faces or max(max(face) for face in document.faces) >= len(vertices_m):
        raise InvalidInput(
            "no faces, or one that names a vertex that is not there", "Give vertices and faces.", "shape"
        )
    if type_ == "POLYGONMESH3D":
        return PolygonMesh(vertices_m, tuple(tuple(face) for face in document.faces))
    if any(len(face) != 3 for face in document.faces):
        raise InvalidInput("a face that is no triangle", "Give it as POLYGONMESH3D.", "shape")
    return Mesh(vertices_m, np.array(document.faces, dtype=np.int64))
