"""/asyncapi.json against AsyncAPI's own schema (@asyncapi/specs 6.11.1, Apache-2.0)."""

import json
from pathlib import Path

import pytest
from jsonschema import Draft7Validator, Draft202012Validator
from semap_service.documents.asyncapi import MESSAGES, asyncapi

OFFICIAL = Path(__file__).parent / "asyncapi_3.0.0_schema.json"
DOCUMENT = json.loads(json.dumps(asyncapi("maps.example:8000", secure=True)))


def test_it_is_asyncapi() -> None:
    Draft7Validator(json.loads(OFFICIAL.read_text())).validate(DOCUMENT)


def test_a_fault_in_it_would_be_found() -> None:
    broken = {**DOCUMENT, "operations": {"follow": {"action": "hear"}}}
    assert not Draft7Validator(json.loads(OFFICIAL.read_text())).is_valid(broken)


def test_every_reference_leads_somewhere() -> None:
    def references(part: object) -> list[str]:
        if isinstance(part, dict):
            own = [part["$ref"]] if "$ref" in part else []
            return own + [each for inner in part.values() for each in references(inner)]
        return [each for inner in part for each in references(inner)] if isinstance(part, list) else []

    found = references(DOCUMENT)
    assert len(found) > 40
    for reference in found:
        target = DOCUMENT
        for name in reference.removeprefix("#/").split("/"):
            target = target[name]


@pytest.mark.parametrize("name", MESSAGES)
def test_its_schemas_are_json_schema(name: str) -> None:
    schema = DOCUMENT["components"]["schemas"][MESSAGES[name].__name__]
    Draft202012Validator.check_schema(schema)
    assert schema["properties"]["type"]
