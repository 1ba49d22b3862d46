"""The documents of OGC API Features (OGC 17-069r4, 18-058r1, 19-079r2)."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi.responses import JSONResponse
from pydantic import ConfigDict, Field

from semap_service.documents.document import Document

GEO_JSON = "application/geo+json"
SCHEMA_JSON = "application/schema+json"
OPENAPI_JSON = "application/vnd.oai.openapi+json;version=3.0"
JSON = "application/json"


class GeoJson(JSONResponse):
    media_type = GEO_JSON


class SchemaJson(JSONResponse):
    media_type = SCHEMA_JSON


class Link(Document):
    """Where to go from here (RFC 8288)."""

    href: str = Field(examples=["http://127.0.0.1:8000/collections"])
    rel: str = Field(examples=["data"])
    type: str = Field(examples=[JSON])
    title: str


class LandingPage(Document):
    """What there is."""

    title: str
    description: str
    name: Literal["semap"]
    version: str
    links: list[Link]


class Conformance(Document):
    """What of which standard holds here."""

    conformsTo: list[str]


Bounds = Annotated[list[float], Field(min_length=4, max_length=4)]
Ends = Annotated[list[str | None], Field(min_length=2, max_length=2)]


class SpatialExtent(Document):
    bbox: list[Bounds] = Field(description="West, south, east and north.")
    crs: str


class TemporalExtent(Document):
    interval: list[Ends] = Field(description="The first and the last time; null: without an end.")
    trs: str


class CollectionExtent(Document):
    """How far a collection reaches; what it has not is left out."""

    model_config = ConfigDict(json_schema_serialization_defaults_required=False)

    spatial: SpatialExtent | None = None
    temporal: TemporalExtent | None = None


class CollectionDocument(Document):
    """Features of one kind on one map."""

    model_config = ConfigDict(json_schema_serialization_defaults_required=False)

    id: str = Field(examples=["office.Room"])
    title: str
    description: str
    itemType: Literal["feature"]
    crs: list[str] = Field(description="The systems that it is offered in; the first is the default.")
    extent: CollectionExtent | None = None
    links: list[Link]


class Collections(Document):
    """Which collections there are."""

    collections: list[CollectionDocument]
    links: list[Link]
    numberReturned: int


class FeatureGeometry(Document):
    """A GeoJSON geometry (RFC 7946)."""

    type: Literal["Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon"]
    coordinates: list[Any]


class FeatureDocument(Document):
    """A GeoJSON feature."""

    type: Literal["Feature"]
    id: int | str
    geometry: FeatureGeometry | None
    properties: dict[str, Any]


class LinkedFeature(FeatureDocument):
    """A GeoJSON feature by itself."""

    links: list[Link]


class FeatureCollection(Document):
    """A page of features."""

    type: Literal["FeatureCollection"]
    features: list[FeatureDocument]
    links: list[Link]
    numberMatched: int = Field(description="On all pages.")
    numberReturned: int = Field(description="On this one.")


class PropertiesSchema(Document):
    """A JSON Schema of properties."""

    dialect: str = Field(serialization_alias="$schema")
    address: str = Field(serialization_alias="$id")
    type: Literal["object"]
    title: str
    properties: dict[str, dict[str, Any]]
    additionalProperties: bool
