"""Operators over HTTP; each answer is held against the published description."""

from __future__ import annotations

from pathlib import Path

import psycopg
import pytest
import shapely
from running import Service
from semap_service.serving.app import create_app
from shapely.geometry import shape

from docs.reference.operators import SERVICES, operator_docs
from semap.store.operator_table import OPERATORS

SQUARE = {"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]]}
POSE = {"x_m": 1.0, "y_m": 1.0}


@pytest.fixture
def office(service: Service) -> Service:
    service.make_map()
    service.make_room("hall", shapely.box(0, 0, 6, 4), height_m=2.5)
    service.make_room("study", shapely.box(6, 0, 9, 4), height_m=2.5, attributes={"seats": 2})
    for n in range(4):
        service.make_room(f"chair {n}", shapely.box(n + 0.2, 1, n + 0.6, 1.4), height_m=0.9, concept="Chair")
    service.make_room("desk", shapely.box(7, 1, 8, 2), height_m=0.8, concept="Table")
    service.make_room(
        "door", shapely.box(5.9, 1, 6.1, 2), height_m=2, concept="Door", joins=["hall", "study"]
    )
    return service


def ask(service: Service, operator: str, status: int = 200, **question: object) -> dict:
    response = service.client.post(f"/maps/office/operators/{operator}", json=question)
    assert response.status_code == status, response.text
    return response.json()


def test_rooms_with_more_than_two_chairs(office: Service) -> None:
    rooms = {"filter": "isA('Room')"}
    chairs = {"concept": "Chair"}
    answer = ask(office, "counted_in", references=rooms, targets=chairs, parameters={"at_least": 3})
    assert [(row["container"], row["targets"]) for row in answer["rows"]] == [("hall", 4)]
    assert answer["next"] is None
    everything = ask(office, "counted_in", references=rooms, targets=chairs, parameters={"at_least": 0})
    assert [(row["container"], row["targets"]) for row in everything["rows"]] == [("hall", 4), ("study", 0)]
    seated = ask(office, "sizes", references={"attributes": {"seats": 2}})
    assert [(row["instance"], row["area_m2"], row["volume_m3"]) for row in seated["rows"]] == [
        ("study", 12, 30)
    ]


def test_pages_give_every_row_once(office: Service) -> None:
    question = {"references": {"names": ["hall"]}}
    whole = ask(office, "contained_in", **question)["rows"]
    # a door in the wall is in both rooms
    assert [row["target"] for row in whole] == ["chair 0", "chair 1", "chair 2", "chair 3", "door"]
    found, after = [], None
    while True:
        page = ask(office, "contained_in", **question, limit=3, after=after)
        found += page["rows"]
        after = page["next"]
        if after is None:
            break
    assert found == whole
    for nonsense in ("x", "[1]", '[1, 2, "x"]', "[1, 2, [3]]", "{}"):
        assert ask(office, "contained_in", 422, **question, after=nonsense)["errors"][0]["where"] == "after"


def test_ways_name_their_doors(office: Service) -> None:
    rows = ask(office, "route", parameters={"from": "hall", "to": "study"})["rows"]
    assert [(row["room"], row["door"]) for row in rows] == [("hall", None), ("study", "door")]
    assert ask(office, "reachable", parameters={"from": rows[0]["room_id"]})["rows"][0]["room"] == "study"
    joined = ask(office, "joined", references={"names": ["hall"]}, parameters={"closed": {"locked": True}})
    assert [(row["target"], row["door"]) for row in joined["rows"]] == [("study", "door")]


def test_shapes_are_geojson(office: Service) -> None:
    (row,) = ask(office, "united", references={"names": ["hall", "study"]})["rows"]
    assert shape(row["area"]).equals(shapely.box(0, 0, 9, 4))
    (row,) = ask(office, "extruded", parameters={"area": SQUARE, "z_min_m": 0, "z_max_m": 2})["rows"]
    faces = shape(row["prism"])
    assert (faces.geom_type, len(faces.geoms), faces.has_z) == ("MultiPolygon", 12, True)


def test_structure_is_made_and_undone(office: Service) -> None:
    question = {"references": {"concept": "Room"}, "targets": {"concept": "Chair"}}
    made = ask(office, "structure_by_containment", **question)
    assert {(row["target"], row["reference"], row["outcome"]) for row in made["rows"]} == {
        (f"chair {n}", "hall", "carried") for n in range(4)
    }
    moved = {"frame": "hall", "pose": {"x_m": 10}}
    assert ask(office, "set_transform", parameters=moved) == {"rows": [], "next": None}
    there = ask(office, "transform", parameters={"a": "map", "b": "chair 0"})["rows"][0]
    assert there["x_m"] == pytest.approx(10)
    freed = ask(office, "unstructure", targets={"concept": "Chair"})
    assert {row["outcome"] for row in freed["rows"]} == {"freed"}
    assert ask(office, "transform", parameters={"a": "map", "b": "chair 0"})["rows"][0][
        "x_m"
    ] == pytest.approx(10)


MISFITS = [
    ("no_such", {}, 404, None),
    ("sizes", {"targets": {}}, 422, "targets"),
    ("sizes", {"references": {"concept": "Rooom"}}, 422, "references.concept"),
    ("sizes", {"references": {"filter": "nam = 'x'"}}, 422, "references.filter.args[0]"),
    ("sizes", {"references": {"filter": "name ="}}, 422, "references.filter, line 1, character 7"),
    ("sizes", {"references": {"filter": {"op": "drop", "args": []}}}, 422, "references.filter"),
    ("padded", {}, 422, "parameters.distance_m"),
    ("padded", {"parameters": {"distance_m": "1"}}, 422, "parameters.distance_m"),
    ("padded", {"parameters": {"distance_m": 1, "join": "sharp"}}, 422, "parameters.join"),
    ("padded", {"parameters": {"distance_m": 1, "color": "red"}}, 422, "parameters.color"),
    ("route", {"parameters": {"from": "hall", "to": "nowhere"}}, 422, "parameters.to"),
    ("route", {"parameters": {"from": "hall", "to": 10**30}}, 422, "parameters.to"),
    (
        "in_area",
        {"parameters": {"area": {"type": "Point", "coordinates": [1, 2]}}},
        422,
        "parameters.area",
    ),
    ("in_area", {"parameters": {"area": {"type": "Polygon", "coordinates": 3}}}, 422, "parameters.area"),
    ("above", {"parameters": {"viewer": {"x": 1}}}, 422, "parameters.viewer"),
    ("transform", {"parameters": {"a": "map", "b": "map", "at": "noon"}}, 422, "parameters.at"),
]


def test_what_does_not_fit_is_told_with_its_place(office: Service) -> None:
    for operator, question, status, where in MISFITS:
        problem = ask(office, operator, status, **question)
        assert problem["remedy"]
        assert [each["where"] for each in problem["errors"]] == ([] if where is None else [where])


OF_THEIR_OWN = {
    "in_volume": {"z_max_m": 9},
    "extruded": {"z_max_m": 9},
    "rcc8_relations": {"relations": ["EC", "DC"]},
    "contained_in": {"links": ["footprint"]},
    "relate": {"pattern": "T********"},
    "change_frame": {"parent": "hall"},
    "delete_instance": {"instance": "copy"},
    "delete_description": {"description": "shape", "replacement": None},
}

SAMPLES = {
    "area": SQUARE,
    "point": {"type": "Point", "coordinates": [1, 1]},
    "pose": POSE,
    "stamp": "2030-01-01T00:00:00Z",
    "texts": [],
    "attributes": {},
    "instance": "hall",
    "frame": "chair 0",
    "description": "shape",
    "number": 1.5,
    "integer": 1,
    "boolean": True,
    "text": "copy",
}


def test_every_operator_takes_what_it_says_and_gives_what_it_says(office: Service) -> None:
    made = office.client.post("/maps/office/descriptions", json={"name": "shape"})
    assert made.status_code == 201, made.text
    listed = office.get("/operators")["operators"]
    assert [each["name"] for each in listed] == list(OPERATORS)
    for operator in listed:
        name = operator["name"]
        parameters = {
            each["name"]: each["choices"][0] if each["choices"] else SAMPLES[each["kind"]]
            for each in operator["parameters"]
        }
        parameters |= OF_THEIR_OWN.get(name, {})
        question = {"parameters": parameters}
        if operator["takes_references"]:
            question["references"] = {"names": ["hall", "desk"]}
        for row in ask(office, name, **question)["rows"]:
            assert set(row) == set(operator["columns"]), name
        required = {
            each["name"]: parameters[each["name"]] for each in operator["parameters"] if each["required"]
        }
        if not operator["edits"]:
            for row in ask(office, name, parameters=required)["rows"]:
                assert set(row) == set(operator["columns"]), name


def test_the_table_is_that_of_the_functions(office: Service, plain: psycopg.Connection) -> None:
    for operator in OPERATORS.values():
        rows = plain.execute(
            "select proargnames, proargmodes::text[], pronargs - pronargdefaults from pg_proc"
            " where pronamespace = 'semap'::regnamespace and proname = %s",
            [operator.sql.removeprefix("semap.")],
        ).fetchall()
        assert len(rows) == 1, operator.name
        names, modes, _ = rows[0]
        inputs = {n for n, mode in zip(names, modes or ["i"] * len(names), strict=True) if mode == "i"}
        known = {each.sql for each in operator.parameters}
        known |= {operator.references, operator.targets, operator.map_id} - {None}
        assert known == inputs, operator.name
        outputs = [n for n, mode in zip(names, modes or [], strict=False) if mode == "t"]
        assert not outputs or outputs == [each.name for each in operator.columns], operator.name


def test_the_committed_documentation_is_current() -> None:
    committed = Path(__file__).parents[2] / "docs" / "operators.md"
    assert committed.read_text() == operator_docs(), (
        "Run: python docs/reference/operators.py > docs/operators.md"
    )


def test_the_documentation_names_what_there_is() -> None:
    paths = {
        f"{method.upper()} {path}"
        for path, methods in create_app("").openapi()["paths"].items()
        for method in methods
    }
    named = {rest for each in SERVICES for rest in each.rest}
    assert named <= paths
    services = {service for each in OPERATORS.values() for service in each.semap}
    assert services <= {each.name for each in SERVICES}
