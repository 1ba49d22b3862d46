"""A part of a YAML file as a pydantic model, whose errors name the line and what to write there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from semap.errors import InvalidInput
from semap.formats.refusals import Refusals
from semap.formats.yaml_node import Node

M = TypeVar("M", bound=BaseModel)

REMEDIES = {
    "missing": "Write it.",
    "extra_forbidden": "Remove it, or correct its name; known are {known}.",
}


def checked(node: Node, model: type[M], context: Mapping[str, Any] | None = None) -> M:
    """The model of what a node says.

    context  for its validators
    raises   InvalidInput that lists all that is wrong
    """
    try:
        return model.model_validate(node.json(), context=dict(context or {}))
    except ValidationError as error:
        refusals = Refusals()
        for number, each in enumerate(error.errors(include_url=False, include_input=False)):
            refusals.add(number, _wrong(node, each, model))
        refusals.raise_if_any("settings", node.file)
        raise


def _wrong(node: Node, error: Mapping[str, Any], model: type[BaseModel]) -> InvalidInput:
    """What pydantic says, at the line that it is about."""
    place = node
    for step in error["loc"]:
        inner = place.value
        is_there = (
            step in inner
            if isinstance(inner, Mapping)
            else isinstance(inner, tuple) and isinstance(step, int) and step < len(inner)
        )
        if not is_there:
            break
        found: Any = inner[step]  # type: ignore[index]  # as was seen
        place = found
    name = ".".join(str(step) for step in error["loc"])
    remedy = REMEDIES.get(error["type"], "Correct it.").format(known=", ".join(model.model_fields))
    field = model.model_fields.get(str(error["loc"][0])) if error["loc"] else None
    if field is not None and field.description:
        remedy = f"{remedy} {name}: {field.description}"
    return place.wrong(f"{name}: {error['msg']}" if name else error["msg"], remedy)
