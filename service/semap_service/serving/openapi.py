"""The published description of the interface, made to say what the service does."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from typing import Any

from fastapi import FastAPI, Response
from fastapi.openapi.utils import get_openapi

from semap_service.access.openapi_security import describe_access
from semap_service.documents.problem import Problem
from semap_service.documents.state import NewStates

JSON = "application/json"
FRAMEWORK_ERRORS = ("HTTPValidationError", "ValidationError")


def describer(app: FastAPI) -> Callable[[], dict[str, Any]]:
    """What FastAPI derives from the endpoints, with semap's errors in place of FastAPI's own."""

    def describe() -> dict[str, Any]:
        if app.openapi_schema is None:
            described = get_openapi(
                title=app.title,
                version=app.version,
                summary=app.summary,
                description=app.description,
                routes=app.routes,
                tags=app.openapi_tags,
                license_info=app.license_info,
            )
            schemas = described["components"]["schemas"]
            for name in FRAMEWORK_ERRORS:
                schemas.pop(name, None)
            for model in (Problem, NewStates):
                schema = model.model_json_schema(ref_template="#/components/schemas/{model}")
                schemas.update(schema.pop("$defs"))
                schemas[model.__name__] = schema
            describe_access(described)
            app.openapi_schema = described
        return app.openapi_schema

    return describe


def add_description(app: FastAPI) -> None:
    """Serve /openapi.json: made in a thread when it is first asked for, which takes a second, and kept."""

    @cache
    def written() -> bytes:
        return json.dumps(app.openapi(), ensure_ascii=False, separators=(",", ":")).encode()

    @app.get("/openapi.json", include_in_schema=False)
    def openapi() -> Response:
        return Response(written(), media_type=JSON)
