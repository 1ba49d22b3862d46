"""Attributes as they are written on the command line."""

from __future__ import annotations

import json
from collections.abc import Mapping

from semap.errors import InvalidInput


def read_attributes(said: str | None) -> Mapping[str, object] | None:
    """raises InvalidInput for what is no JSON object"""
    if said is None:
        return None
    try:
        found = json.loads(said, parse_constant=_refuse)
    except ValueError as error:
        raise InvalidInput(f"no JSON: {error}", EXAMPLE, "--attributes") from error
    if not isinstance(found, dict):
        raise InvalidInput("no JSON object", EXAMPLE, "--attributes")
    return found


EXAMPLE = 'Write it as: \'{"kind": "forklift"}\''


def _refuse(word: str) -> object:
    raise ValueError(f"{word} is no number of JSON")
