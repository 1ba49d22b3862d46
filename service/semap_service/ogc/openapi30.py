"""OpenAPI 3.1 said in OpenAPI 3.0, which the OGC's standards ask for."""

from __future__ import annotations

from typing import Any

OPENAPI = "3.0.3"
DROPPED = ("$schema", "$id", "prefixItems", "contentMediaType", "contentEncoding", "propertyNames")
NAMES = ("properties", "schemas", "paths", "responses", "content", "mapping")
"""Words whose members are named by somebody."""

NUMBERS = {"exclusiveMinimum": "minimum", "exclusiveMaximum": "maximum"}


def as_openapi30(described: dict[str, Any]) -> dict[str, Any]:
    """The same interface; what 3.0 cannot say is said more loosely."""
    found: dict[str, Any] = _part(described)
    found["openapi"] = OPENAPI
    for each in ("webhooks", "jsonSchemaDialect"):
        found.pop(each, None)
    info = found["info"]
    info.pop("summary", None)
    info.get("license", {}).pop("identifier", None)
    return found


def _part(value: Any, is_names: bool = False) -> Any:
    """is_names  whether the keys are names that somebody chose, and no words of OpenAPI"""
    if isinstance(value, list):
        return [_part(each) for each in value]
    if not isinstance(value, dict):
        return value
    if is_names:
        return {name: _part(each) for name, each in value.items()}
    found: dict[str, Any] = {}
    for name, each in value.items():
        found |= _member(name, each)
    if found.get("type") == "array":
        found.setdefault("items", {})
    return found


def _member(name: str, each: Any) -> dict[str, Any]:
    """What one word of 3.1 is in 3.0."""
    match name:
        case "example" | "default" | "enum":
            return {name: each}
        case "examples" if isinstance(each, list):
            return {"example": each[0]} if each else {}
        case "const":
            return {"enum": [each]}
        case "exclusiveMinimum" | "exclusiveMaximum" if not isinstance(each, bool):
            return {NUMBERS[name]: each, name: True}
        case "type" if isinstance(each, list):
            return _one_type(each)
        case "anyOf" | "oneOf":
            return _choice(name, each)
    return {} if name in DROPPED else {name: _part(each, name in NAMES)}


def _one_type(types: list[str]) -> dict[str, Any]:
    known = [each for each in types if each != "null"]
    found: dict[str, Any] = {"nullable": True} if "null" in types else {}
    if len(known) == 1:
        found["type"] = known[0]
    elif known:
        found["anyOf"] = [{"type": each} for each in known]
    return found


def _choice(name: str, choices: list[Any]) -> dict[str, Any]:
    known = [_part(each) for each in choices if each != {"type": "null"}]
    found: dict[str, Any] = {"nullable": True} if len(known) < len(choices) else {}
    if len(known) == 1 and "$ref" in known[0]:
        return {**found, "allOf": known}
    if len(known) == 1:
        return {**known[0], **found}
    return {**found, name: known}
