"""What a request can be made to contain: it is refused, and the service stays up."""

from __future__ import annotations

import io
import json
import zipfile

import pytest
import shapely
from running import Service


def refused(response, match: str, status: int = 422) -> None:
    assert response.status_code == status, response.text
    assert match in response.json()["detail"]


def bring(service: Service, text: str | bytes, name: str = "map.yaml"):
    return service.client.post("/maps/import", files={"file": (name, text)})


def test_nesting_without_end(service: Service) -> None:
    refused(bring(service, "map: deep\nthings: " + "[" * 40_000), "a mapping is needed")
    service.make_map()
    area = "[" * 500 + "]" * 500
    body = '{"parameters": {"area": {"type": "Polygon", "coordinates": ' + area + "}}}"
    answer = service.client.post(
        "/maps/office/operators/in_area", content=body, headers={"Content-Type": "application/json"}
    )
    assert answer.status_code == 422


@pytest.mark.parametrize("schema", [{"pattern": "(a+)+$"}, {"properties": {"x": {"patternProperties": {}}}}])
def test_expressions_that_never_end(service: Service, schema: dict) -> None:
    new = {"name": "Slow", "attribute_schema": {"properties": {"pattern": {"anyOf": [schema]}}}}
    refused(service.client.post("/concepts", json=new), "regular expressions")
    fine = {"name": "Fine", "attribute_schema": {"properties": {"pattern": {"type": "string"}}}}
    assert service.client.post("/concepts", json=fine).status_code == 201


def test_stamps_of_no_year(service: Service) -> None:
    service.make_map()
    frame = service.client.post("/maps/office/frames", json={"name": "robot"}).json()
    for stamp in ("0001-01-01T00:00:00+14:00", "9999-12-31T23:59:59.5-23:59", "0004-01-01T00:00:00Z"):
        answer = service.client.post(f"/frames/{frame['id']}/poses", json={"stamp": stamp, "pose": {}})
        assert answer.status_code == 422
        past = {"target": "map", "source": "robot", "at": stamp}
        assert service.client.get("/maps/office/transform", params=past).status_code in (200, 422)
        selection = {"references": {"filter": f"created_at > TIMESTAMP('{stamp}')"}}
        assert service.client.post("/maps/office/operators/sizes", json=selection).status_code in (200, 422)
    assert len(service.get(f"/frames/{frame['id']}/poses")["poses"]) == 1
    assert service.client.get("/maps/office/export", params={"format": "yaml"}).status_code == 200


def test_numbers_beyond_measure(service: Service) -> None:
    service.make_map()
    huge = shapely.Polygon([(0, 0), (1e200, 0), (1e200, 1e200)])
    document = {"name": "a", "concept": "Room", "footprint": json.loads(shapely.to_geojson(huge))}
    refused(service.post_instance(document), "beyond")
    refused(service.post_instance({"name": "a", "concept": "Room", "pose": {"x_m": 1e300}}), "beyond")
    refused(bring(service, "map: b\nthings: {t: {concept: Table, box: [1e200, 1, 1]}}"), "beyond")
    for name, number in (("small", "3"), ("large", "1" + "0" * 309)):
        body = '{"name": "%s", "concept": "Table", "attributes": {"n": %s}}' % (name, number)  # noqa: UP031
        made = service.client.post("/maps/office/instances", files={"document": (None, body)})
        assert made.status_code == 201, made.text
    found = service.client.post(
        "/maps/office/operators/sizes", json={"references": {"filter": "attributes.n > 1"}}
    )
    assert found.status_code == 200


def test_parameters_that_are_none(service: Service) -> None:
    service.make_map()
    for operator, parameters in (
        ("relate", {"pattern": "xxx"}),
        ("padded", {"distance_m": 1e308}),
        ("relate", {"pattern": "\ud800"}),
    ):
        answer = service.client.post(
            f"/maps/office/operators/{operator}", content=json.dumps({"parameters": parameters}),
            headers={"Content-Type": "application/json"},
        )  # fmt: skip
        assert answer.status_code == 422, answer.text


def test_a_zip_that_is_damaged_and_paths_that_are_too_long(service: Service) -> None:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("map.yaml", "map: zipped\n" + "# a comment that packs well\n" * 200)
    damaged = bytearray(packed.getvalue())
    for place in range(45, 60):
        damaged[place] ^= 0xFF
    refused(bring(service, bytes(damaged), "map.zip"), "zip")
    refused(bring(service, f"map: long\nthings: {{t: {{concept: Table, mesh: {'m' * 5000}}}}}"), "longer")


def test_maps_that_would_not_be_what_they_say(service: Service) -> None:
    for text, match in (
        ("map: a\nframes: {earth: {}, map: {parent: earth, at: [100, 0, 0]}}", "root frame"),
        ("map: a\nframes: {map: {at: [5, 0, 0]}}", "root frame"),
        (
            "map: a\nqueries: {q: {concept: Room, predicate: near}}\nrules: {}",
            "predicate near cannot be kept",
        ),
        ("map: a\ndoors: {d: {between: [d], at: [0, 0]}}", "which is not there"),
        ("map: '..'", "the name"),
        ("map: a\ncell_m: 0.001", "cells of 0.001 m"),
        (
            "map: a\nqueries: {q: {concept: Room}}\nrules: {r: {input: q, emit: {begun: entered}}}",
            "begun",
        ),
    ):
        refused(bring(service, text), match)
    made = bring(service, "map: a\nconcepts: {Room: {parents: [Door]}}\nthings: {t: {concept: Roomm}}").json()
    said = {each["subject"]: each["reason"] for each in made["findings"]}
    assert "stays as the database has it" in said["Room"]
    assert "new concept" in said["Roomm"]


def test_what_hangs_under_another_root_has_no_pose_in_the_map(service: Service) -> None:
    service.make_map()
    service.client.post("/maps/office/frames", json={"name": "island", "parent": None})
    made = service.post_instance(
        {"name": "cup", "concept": "Thing", "frame": "island", "local_pose": {"x_m": 1}}
    )
    assert made.status_code == 201, made.text
    assert made.json()["pose"] is None
