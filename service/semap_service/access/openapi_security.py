"""Scopes and refusals of each operation, in the published description of the interface."""

from __future__ import annotations

from collections.abc import Iterator
from http import HTTPStatus
from typing import Any

from semap_service.access.policy import demand_of
from semap_service.http.problem import problems

SCHEME = "token"
FOR_ALL = (
    HTTPStatus.REQUEST_URI_TOO_LONG,
    HTTPStatus.MISDIRECTED_REQUEST,
    HTTPStatus.TOO_MANY_REQUESTS,
    HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE,
)
FOR_TOKENS = (HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN, HTTPStatus.GATEWAY_TIMEOUT)
FOR_BODIES = (HTTPStatus.REQUEST_TIMEOUT, HTTPStatus.REQUEST_ENTITY_TOO_LARGE)


def describe_access(described: dict[str, Any]) -> None:
    """Add to a document of OpenAPI which token each operation asks for, and how it may be refused."""
    described["components"].setdefault("securitySchemes", {})[SCHEME] = {
        "type": "http",
        "scheme": "bearer",
        "bearerFormat": "semap_...",
        "description": "Made by `semap token add`; it has scopes, and may be for some maps only.",
    }
    described["security"] = [{SCHEME: []}]
    for method, path, operation in _operations(described):
        demand = demand_of(method, path)
        answers = [*FOR_ALL]
        if demand.scope is None:
            operation["security"] = []
        else:
            operation["x-semap-scope"] = demand.scope
            answers += FOR_TOKENS
        if "requestBody" in operation:
            answers += FOR_BODIES
        for status, answer in problems(*answers).items():
            operation["responses"].setdefault(str(status), answer)


def _operations(described: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    for path, methods in described["paths"].items():
        for method, operation in methods.items():
            yield method.upper(), path, operation
