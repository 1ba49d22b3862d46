"""Every document of REST and of the feeds as one JSON Schema, of which the page's interfaces are made.

`python -m semap_service.serving.document_schemas` prints it.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from semap_service.documents.asyncapi import asyncapi
from semap_service.serving.app import create_app

OPENAPI, JSON_SCHEMA = "#/components/schemas/", "#/$defs/"
NAMES_BELOW = ("properties", "$defs")
IGNORED = ("title", "examples", "discriminator", "minItems", "maxItems")


def document_schemas() -> dict[str, Any]:
    """The schemas by their names, without titles, examples and lengths of lists: no interface has them."""
    rest = create_app("").openapi()["components"]["schemas"]
    feeds = asyncapi("", secure=False)["components"]["schemas"]
    return {"title": "Documents", "type": "object", "$defs": _shapes({**rest, **feeds}, are_names=True)}


def _shapes(part: Any, *, are_names: bool = False) -> Any:
    """are_names  the keys are names of documents or members, and no words of JSON Schema"""
    if isinstance(part, list):
        return [_shapes(each) for each in part]
    if not isinstance(part, dict):
        return part
    if not are_names and "$ref" in part:
        return {"$ref": part["$ref"].replace(OPENAPI, JSON_SCHEMA)}
    return {
        key: _shapes(value, are_names=not are_names and key in NAMES_BELOW)
        for key, value in part.items()
        if are_names or key not in IGNORED
    }


if __name__ == "__main__":
    json.dump(document_schemas(), sys.stdout)
