"""The published description of the interface, made to say what the service does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from semap_service.access.description import describe_access
from semap_service.problem import Problem

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
            problem = Problem.model_json_schema(ref_template="#/components/schemas/{model}")
            schemas.update(problem.pop("$defs"))
            schemas["Problem"] = problem
            describe_access(described)
            app.openapi_schema = described
        return app.openapi_schema

    return describe
