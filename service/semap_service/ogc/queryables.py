"""What can be asked and sorted by, as JSON Schema (OGC API Features, parts 3 and 8)."""

from __future__ import annotations

from typing import Any

from fastapi import Request

from semap.cql2 import Kind
from semap.store.features.collection import Collection
from semap.store.features.source import GEOMETRY, Source
from semap_service.documents.ogc_features import PropertiesSchema
from semap_service.ogc.links import address
from semap_service.ogc.parameters import sortable

DIALECT = "https://json-schema.org/draft/2020-12/schema"

FORMS: dict[Kind, dict[str, Any]] = {
    "text": {"type": "string"},
    "number": {"type": "number"},
    "boolean": {"type": "boolean"},
    "instant": {"type": "string", "format": "date-time"},
    "shape": {"format": "geometry-any"},
    "any": {"type": "object"},
}


def queryables(request: Request, collection: Collection, source: Source) -> PropertiesSchema:
    """Everything that a filter may ask; of an object also what is in it, as attributes.seats."""
    return _schema(request, collection, source, "queryables", list(source.thing.kinds))


def sortables(request: Request, collection: Collection, source: Source) -> PropertiesSchema:
    return _schema(request, collection, source, "sortables", sortable(source))


def _schema(
    request: Request, collection: Collection, source: Source, what: str, names: list[str]
) -> PropertiesSchema:
    return PropertiesSchema(
        dialect=DIALECT,
        address=address(request, "collections", collection.id, what),
        type="object",
        title=collection.id,
        properties={name: _property(name, source.thing.kinds[name]) for name in names},
        additionalProperties=False,
    )


def _property(name: str, kind: Kind) -> dict[str, Any]:
    found = {"title": name, **FORMS[kind]}
    if name == GEOMETRY:
        found["x-ogc-role"] = "primary-geometry"
    return found
