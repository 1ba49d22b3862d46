"""What the client gives out is what the service publishes, member by member."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any

import pytest
from pydantic import TypeAdapter
from semap_service.serving.document_schemas import document_schemas

from semap.client import values

OF = {
    values.Map: "MapDocument",
    values.Pose: "PoseDocument",
    values.Band: "BandDocument",
    values.Instance: "InstanceSummary",
    values.Room: "RoomSummary",
    values.InstanceDetail: "InstanceDocument",
    values.Named: "EventTrack",
    values.Whereabouts: "WhereDocument",
    values.Extent: "ExtentDocument",
    values.RouteStep: "StepDocument",
    values.Part: "PartDocument",
    values.Route: "WayDocument",
    values.Occupant: "OccupantDocument",
    values.TrackState: "TrackStateDocument",
    values.Track: "TrackDocument",
    values.Relation: "RelationDocument",
    values.Evidence: "EvidenceDocument",
    values.FoundEvent: "DryEventDocument",
    values.Event: "EventDocument",
    values.ObjectState: "ObjectStateDocument",
    values.NewObjectState: "NewObjectStateDocument",
    values.GivenUp: "GivenUpDocument",
    values.Rule: "RuleDocument",
    values.DryRun: "DryRunAnswer",
    values.Explanation: "ExplanationDocument",
    values.Parameter: "ParameterDocument",
    values.Operator: "OperatorDocument",
    values.Selection: "SelectionDocument",
    values.Finding: "FindingDocument",
    values.ImportReport: "ImportDocument",
    values.Job: "JobDocument",
    values.RefusedState: "RefusedState",
    values.TakenStates: "TakenStates",
}
LEFT_OUT = {
    values.Map: {"cell_m"},
    values.InstanceDetail: {"crs", "description", "frame"},
    values.Whereabouts: {"frames"},
    values.TrackState: {"footprint"},
    values.Operator: {"replaces"},
    values.ImportReport: {"doors"},
    values.Job: {"created_by", "file", "map"},
    values.TakenStates: {"repeated"},  # the client counts on, and never takes an answer to be another's
}
"""What the client passes over. A new member of a document is a value's as well, or is added here."""
ADDED = {values.InstanceDetail: {"etag"}}
"""What is no member, but a header."""
COMPUTED = {values.Gap: "GapDocument", values.Feature: "FeatureDocument"}
"""`reason` is made of the two parts; a feature is a GeoJSON object with what a value has as its properties."""


@cache
def published() -> Mapping[str, Any]:
    schemas: Mapping[str, Any] = document_schemas()["$defs"]
    return schemas


def kinds(schema: Mapping[str, Any], among: Mapping[str, Any]) -> set[str]:
    """Which kinds of JSON values a schema takes; {"any"} where it takes all."""
    if "$ref" in schema:
        return kinds(among[schema["$ref"].rpartition("/")[2]], among)
    for word in ("anyOf", "oneOf", "allOf"):
        if word in schema:
            return set().union(*(kinds(each, among) for each in schema[word]))
    if "const" in schema or "enum" in schema:
        return {"string"}
    if "type" not in schema:
        return {"any"}
    return {f"{schema['type']} {schema.get('format', '')}".strip()}


def takes(wanted: set[str], given: set[str]) -> bool:
    if "any" in wanted:
        return True
    wide = wanted | ({"integer"} if "number" in wanted else set())
    return given <= wide or {each.partition(" ")[0] for each in given} <= wide


def test_every_value_is_compared() -> None:
    made = {
        each
        for each in vars(values).values()
        if isinstance(each, type) and is_dataclass(each) and each.__module__.startswith("semap.")
    }
    assert made - {values.Seen} == {*OF, *COMPUTED}


@pytest.mark.parametrize("value", OF, ids=lambda value: value.__name__)
def test_a_value_has_the_members_of_its_document(value: Any) -> None:
    document = published()[OF[value]]
    names = {each.name for each in fields(value)} - ADDED.get(value, set())
    assert names == set(document["properties"]) - LEFT_OUT.get(value, set())
    schema = TypeAdapter(value).json_schema()
    among = schema.get("$defs", {})
    for name in names:
        wanted, given = (
            kinds(schema["properties"][name], among),
            kinds(document["properties"][name], published()),
        )
        assert takes(wanted, given), f"{name}: {given} is published, and {wanted} is taken"
