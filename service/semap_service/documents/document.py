"""What the documents of the service have in common: strictness, stamps, pages, shapes.

Lengths are metres in the map frame (z up); stamps are RFC 3339 in UTC with microseconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Annotated, Any, Literal

import shapely
from fastapi import Path, Query
from pydantic import (
    AfterValidator,
    AliasPath,
    AwareDatetime,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    PlainSerializer,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import CoreSchema, PydanticCustomError
from shapely import MultiPolygon, Polygon
from shapely.geometry import mapping, shape

from semap.errors import InvalidInput
from semap.model.building import HeightBand
from semap.model.pose import Pose
from semap.timeline.stamp import rfc3339
from semap_service.documents.json_values import require_few_values

LARGEST_ID = 2**63 - 1
LARGEST_SMALL_ID = 2**31 - 1


class Document(BaseModel):
    """What semap gives out; always complete. `model_validate` makes it of a stored value."""

    model_config = ConfigDict(
        from_attributes=True, populate_by_name=True, json_schema_serialization_defaults_required=True
    )


def stored(*path: str, **said: Any) -> Any:
    """A member that the stored value has by another name, or further inside."""
    return Field(validation_alias=AliasPath(*path), **said)


MANY_UNKNOWN = "many_unknown"
MOST_UNKNOWN = 20


def _fail_fast(schema: object) -> None:
    """Let every list in a schema end at its first member that is wrong."""
    if isinstance(schema, list | tuple):
        for each in schema:
            _fail_fast(each)
    elif isinstance(schema, dict):
        if schema.get("type") == "list":
            schema["fail_fast"] = True
        for each in schema.values():
            _fail_fast(each)


class Request(BaseModel):
    """What semap takes in; nothing unknown, nothing infinite.

    Of what is wrong there is an end: a list ends at its first member that is wrong, and of members that are
    not known some are named and the others counted. To make a hundred thousand errors takes a second, in
    which nobody else is answered.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _require_known(cls, given: object) -> object:
        if isinstance(given, dict) and len(given) > MOST_UNKNOWN:
            known = {each.alias or name for name, each in cls.model_fields.items()}
            unknown = [name for name in given if name not in known]
            if len(unknown) > MOST_UNKNOWN:
                raise PydanticCustomError(
                    MANY_UNKNOWN,
                    "{count} members are not known",
                    {"count": len(unknown), "names": unknown[:MOST_UNKNOWN]},
                )
        return given

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: type[BaseModel], handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        schema = handler(source)
        _fail_fast(schema)
        return schema


def _in_utc(stamp: datetime) -> datetime:
    """raises ValueError for a stamp that is in no year of UTC"""
    try:
        return stamp.astimezone(UTC)
    except OverflowError as error:
        raise ValueError("in UTC it is in no year from 1 to 9999") from error


_AS_RFC3339 = PlainSerializer(rfc3339, return_type=str)
_RFC3339 = WithJsonSchema(
    {"type": "string", "format": "date-time", "examples": ["2026-01-31T12:00:00.000000Z"]},
    mode="serialization",
)

Stamp = Annotated[datetime, _AS_RFC3339, _RFC3339]

InStamp = Annotated[AwareDatetime, AfterValidator(_in_utc), _AS_RFC3339, _RFC3339]
"""A stamp that a client gives."""

Name = Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[^\x00]*$")]

MapFilter = Annotated[str | None, Query(alias="map", description="Only what is on the map of this name.")]
Limit = Annotated[int, Query(ge=1, le=1000, description="At most so many.")]
After = Annotated[
    int, Query(ge=0, le=LARGEST_ID, description="Go on after this id: `next` of the page before.")
]
Id = Annotated[int, Path(ge=1, le=LARGEST_ID)]
SmallId = Annotated[int, Path(ge=1, le=LARGEST_SMALL_ID)]
Next = Annotated[int | None, Field(description="`after` of the next page; null where this is the last one.")]


def _of_few_values(text: object) -> object:
    """raises TooLarge, InvalidInput"""
    if isinstance(text, str):
        require_few_values(text.encode())
    return text


FewValues = BeforeValidator(_of_few_values)
"""Of JSON that comes in a form."""


def next_after(ids: Sequence[int], limit: int) -> int | None:
    """Where the next page begins; None where this one was not full."""
    return ids[-1] if len(ids) == limit else None


def require_order(start: datetime, end: datetime) -> None:
    """raises InvalidInput where `to` is before `from`"""
    if end < start:
        raise InvalidInput("it is before `from`", "Give the earlier moment first.", "to")


class PoseDocument(Request):
    """Translation and quaternion (x y z w) in the map frame: right-handed, z up."""

    model_config = ConfigDict(
        from_attributes=True, json_schema_extra={"examples": [{"x_m": 12.5, "y_m": 3.0, "z_m": 0.0}]}
    )

    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0
    qx: float = 0.0
    qy: float = 0.0
    qz: float = 0.0
    qw: float = 1.0

    def pose(self) -> Pose:
        return Pose(self.x_m, self.y_m, self.z_m, self.qx, self.qy, self.qz, self.qw)


class BandDocument(Document):
    """Heights from z_min_m up to, but not including, z_max_m."""

    z_min_m: float
    z_max_m: float


Position = Annotated[list[float], Field(min_length=2, max_length=3)]
Ring = Annotated[list[Position], Field(min_length=4)]
Rings = Annotated[list[Ring], Field(min_length=1)]


class PolygonDocument(Request):
    """GeoJSON polygon: an outer ring and its holes; metres in the map frame instead of degrees."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]]}]
        }
    )

    type: Literal["Polygon"]
    coordinates: Rings


class MultiPolygonDocument(Request):
    """GeoJSON multipolygon: metres in the map frame instead of degrees."""

    type: Literal["MultiPolygon"]
    coordinates: Annotated[list[Rings], Field(min_length=1)]


AreaDocument = Annotated[PolygonDocument | MultiPolygonDocument, Field(discriminator="type")]


def area_of(document: PolygonDocument | MultiPolygonDocument) -> Polygon | MultiPolygon:
    """The area of a document, without heights.

    raises  InvalidInput if a ring is open or no shape
    """
    try:
        area = shapely.force_2d(shape(document.model_dump()))
    except (ValueError, shapely.errors.GEOSException) as error:
        raise InvalidInput(str(error), "Close each ring with its first point.", "footprint") from error
    assert isinstance(area, Polygon | MultiPolygon)  # noqa: S101  (the document's type says so)
    return area


def area_document(area: shapely.Geometry) -> PolygonDocument | MultiPolygonDocument:
    """The document of a polygon or multipolygon."""
    kind = PolygonDocument if isinstance(area, Polygon) else MultiPolygonDocument
    return kind.model_validate(_as_lists(mapping(area)))


def _of_shape(found: object) -> object:
    return area_document(found) if isinstance(found, shapely.Geometry) else found


OfShape = BeforeValidator(_of_shape)
"""Of an area that is made of a stored shape."""


def band_of(elevation_m: float | None, height_m: float | None) -> HeightBand | None:
    """The heights of a thing that begins at an elevation, 0 if not given; None without a height.

    raises  InvalidInput for an elevation without a height
    """
    if height_m is None:
        if elevation_m is not None:
            raise InvalidInput("an elevation without a height", "Give height_m too.", "elevation_m")
        return None
    return HeightBand(elevation_m or 0.0, (elevation_m or 0.0) + height_m)


def _as_lists(part: object) -> object:
    if isinstance(part, dict):
        return {key: _as_lists(value) for key, value in part.items()}
    return [_as_lists(each) for each in part] if isinstance(part, list | tuple) else part
