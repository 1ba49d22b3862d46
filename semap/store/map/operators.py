"""Operators run by name: instances selected, values checked, rows with names and GeoJSON given back.

A statement is made of the table of operators alone; all that a caller says is a parameter of it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import shapely
from shapely import MultiPolygon, Point, Polygon
from shapely.geometry import shape
from sqlalchemy import Connection, text

from semap.errors import InvalidInput, NotFound
from semap.model.pose import Pose
from semap.model.selection import Selection
from semap.store.database.connection import translated
from semap.store.map.maps import map_id_of
from semap.store.map.operator_table import OPERATORS, Column, Operator, Parameter
from semap.store.map.placement import normalised
from semap.store.map.selection import EVERYTHING, selected_ids

SQL_TYPES = {
    "number": "double precision",
    "integer": "integer",
    "text": "text",
    "boolean": "boolean",
    "texts": "text[]",
    "attributes": "jsonb",
    "stamp": "timestamptz",
    "instance": "bigint",
    "frame": "bigint",
    "description": "bigint",
    "id": "bigint",
}
NAMED = {
    "instance": "select instance_id from semap.instance where map_id = :map_id and {}",
    "frame": "select frame_id from semap.frame where map_id = :map_id and {}",
    "description": "select description_id from semap.description"
    " where map_id = :map_id and not is_absolute and {}",
}
POSE_SQL = "row(:{0}_x_m, :{0}_y_m, :{0}_z_m, :{0}_qx, :{0}_qy, :{0}_qz, :{0}_qw)::semap.pose"
LARGEST_INTEGER = 2**31 - 1


@dataclass(frozen=True)
class Answer:
    """rows: by column, geometries as GeoJSON; after: how to go on, None where this is the last page."""

    rows: tuple[dict[str, object], ...]
    after: str | None


def get_operator(name: str) -> Operator:
    """raises NotFound"""
    if name not in OPERATORS:
        raise NotFound("operator", name, f"There are {', '.join(OPERATORS)}.")
    return OPERATORS[name]


def run_operator(
    connection: Connection,
    map_name: str,
    operator: str,
    references: Selection | None = None,
    targets: Selection | None = None,
    parameters: Mapping[str, object] | None = None,
    *,
    limit: int = 100,
    after: str | None = None,
    when_chosen: Callable[[Connection], None] = lambda _: None,
) -> Answer:
    """What an operator answers about a map, at most `limit` rows in the order of its key.

    references   None: everything on the map, where the operator takes references
    targets      likewise
    after        `after` of the page before; an operator that edits gives all its rows at once
    when_chosen  called before an operator that only reads, when the map and the things on it have been found
    raises      NotFound for an unknown map, operator or thing that is named, InvalidInput for a selection or
                parameter that does not fit, with its place
    """
    known = get_operator(operator)
    map_id = map_id_of(connection, map_name)
    values: dict[str, object] = {"map_id": map_id}
    arguments = [] if known.map_id is None else [f"{known.map_id} => cast(:map_id as integer)"]
    for role, name, selection in (
        ("references", known.references, references),
        ("targets", known.targets, targets),
    ):
        if name is None and selection is not None:
            raise InvalidInput(f"{operator} takes no {role}", "Leave them out, or see GET /operators.", role)
        # targets that nobody chose are all on the map, which the function finds by itself
        whole = selection is None and (role == "targets" or known.edits) and operator not in _ALWAYS_GIVEN
        if name is not None and not whole:
            values[role] = list(selected_ids(connection, map_id, selection or EVERYTHING, role))
            arguments.append(f"{name} => cast(:{role} as bigint[])")
    arguments += _arguments(connection, map_id, known, dict(parameters or {}), values)
    if not known.edits:
        when_chosen(connection)
    statement = f"select * from {known.sql}({', '.join(arguments)})"  # noqa: S608  (names of the table)
    return _answer(connection, known, statement, values, limit, after)


_ALWAYS_GIVEN = ("unstructure", "subtracted")
"""Whose targets have no default."""


def _arguments(
    connection: Connection,
    map_id: int,
    operator: Operator,
    given: dict[str, object],
    values: dict[str, object],
) -> list[str]:
    """The arguments for the parameters that are given; their values are added to `values`."""
    arguments: list[str] = []
    unknown = sorted(given.keys() - {each.name for each in operator.parameters})
    if unknown:
        known = ", ".join(each.name for each in operator.parameters) or "no parameters"
        raise InvalidInput(
            f"{operator.name} takes no {unknown[0]}", f"It takes {known}.", f"parameters.{unknown[0]}"
        )
    for each in operator.parameters:
        value = given.get(each.name)
        if value is None:
            if each.required:
                raise InvalidInput(
                    f"{operator.name} needs it", f"Give {each.answers}.", f"parameters.{each.name}"
                )
            continue
        key = f"p{len(arguments)}"
        arguments.append(f"{each.sql} => {_bound(connection, map_id, each, value, key, values)}")
    return arguments


def _bound(
    connection: Connection,
    map_id: int,
    parameter: Parameter,
    value: object,
    key: str,
    values: dict[str, object],
) -> str:
    """The SQL of a value that is given, with its parts in `values`."""
    place = f"parameters.{parameter.name}"
    if parameter.kind in ("area", "point"):
        values[key] = _shape(value, parameter.kind, place).wkb
        return f"public.st_geomfromwkb(:{key})"
    if parameter.kind == "pose":
        pose = _pose(value, place)
        values |= {f"{key}_{part}": number for part, number in pose.items()}
        return POSE_SQL.format(key)
    if parameter.kind in NAMED:
        values[key] = _named(connection, map_id, parameter, value, place)
    else:
        values[key] = _plain(parameter, value, place)
    return f"cast(:{key} as {SQL_TYPES[parameter.kind]})"


def _plain(parameter: Parameter, value: object, place: str) -> object:
    refused = InvalidInput(f"it is no {parameter.kind}", f"Give {parameter.answers}.", place)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    match parameter.kind:
        case "number":
            fits = is_number and math.isfinite(value)  # type: ignore[arg-type]
        case "integer":
            fits = isinstance(value, int) and is_number and abs(value) <= LARGEST_INTEGER
        case "boolean":
            fits = isinstance(value, bool)
        case "texts":
            fits = isinstance(value, list | tuple) and all(isinstance(each, str) for each in value)
        case "attributes":
            if not isinstance(value, Mapping):
                raise refused
            return json.dumps(dict(value))
        case "stamp":
            return _stamp(value, place)
        case _:
            fits = isinstance(value, str) and "\0" not in value
    if not fits:
        raise refused
    if parameter.choices and value not in parameter.choices:
        raise InvalidInput(f"there is no {value}", f"Choose one of {', '.join(parameter.choices)}.", place)
    return list(value) if isinstance(value, tuple) else value


def _stamp(value: object, place: str) -> datetime:
    try:
        stamp = value if isinstance(value, datetime) else datetime.fromisoformat(str(value))
    except ValueError as error:
        raise InvalidInput(f"{value} is no time", "Write 2026-01-31T12:00:00Z.", place) from error
    if stamp.tzinfo is None:
        raise InvalidInput(f"{value} is in no time zone", "Write 2026-01-31T12:00:00Z.", place)
    return stamp


def _pose(value: object, place: str) -> dict[str, float]:
    parts = dict.fromkeys(("x_m", "y_m", "z_m", "qx", "qy", "qz"), 0.0) | {"qw": 1.0}
    if isinstance(value, Pose):
        value = {part: getattr(value, part) for part in parts}
    if (
        not isinstance(value, Mapping)
        or not value.keys() <= parts.keys()
        or not all(isinstance(each, int | float) and not isinstance(each, bool) for each in value.values())
    ):
        raise InvalidInput("it is no pose", "Give x_m, y_m, z_m and a quaternion qx, qy, qz, qw.", place)
    pose = normalised(Pose(**{**parts, **value}))
    return {part: getattr(pose, part) for part in parts}


def _shape(value: object, kind: str, place: str) -> shapely.Geometry:
    try:
        read = value if isinstance(value, shapely.Geometry) else shape(value)
    except (
        ValueError,
        TypeError,
        KeyError,
        AttributeError,
        IndexError,
        shapely.errors.GEOSException,
    ) as error:
        raise InvalidInput(
            "it is no GeoJSON", "Give a GeoJSON geometry in metres of the map.", place
        ) from error
    wanted = (Polygon, MultiPolygon) if kind == "area" else (Point,)
    if not isinstance(read, wanted) or read.is_empty or not read.is_valid:
        name = "polygon" if kind == "area" else "point"
        raise InvalidInput(f"it is no valid {name}", f"Give a {name} in metres of the map.", place)
    return shapely.force_2d(read) if kind == "area" else read


def _named(connection: Connection, map_id: int, parameter: Parameter, value: object, place: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int | str) or "\0" in str(value):
        raise InvalidInput(f"it is no {parameter.kind}", "Give its name or its id.", place)
    id_column = f"{parameter.kind}_id"
    which = "name = :given" if isinstance(value, str) else f"{id_column} = cast(:given as numeric)"
    with translated():
        found = connection.scalar(
            text(NAMED[parameter.kind].format(which)), {"map_id": map_id, "given": value}
        )
    if found is None:
        raise InvalidInput(
            f"there is no {parameter.kind} {value} on this map", "Give its name or its id.", place
        )
    return int(found)


def _answer(
    connection: Connection,
    operator: Operator,
    statement: str,
    values: dict[str, object],
    limit: int,
    after: str | None,
) -> Answer:
    if not operator.columns:
        with translated():
            connection.execute(text(statement), values)
        return Answer((), None)
    shown, joins = _shown(operator.columns)
    names = ", ".join(each.name for each in operator.columns)
    whole = f"select {', '.join(shown)} from ({statement}) as r ({names}) {' '.join(joins)}"  # noqa: S608
    order = ", ".join(f"r.{each}" for each in operator.key)
    is_paged = bool(operator.key) and not operator.edits
    if is_paged and after is not None:
        places = _places(operator, after)
        values |= {f"after_{n}": place for n, place in enumerate(places)}
        types = [_type_of(operator, each) for each in operator.key]
        here = ", ".join(f"cast(:after_{n} as {type_})" for n, type_ in enumerate(types))
        whole += f" where ({order}) > ({here})"
    whole += f" order by {order}" if order else ""
    if is_paged:
        whole += " limit :row_limit"
        values["row_limit"] = limit
    with translated():
        rows = tuple(
            {name: _finite(value) for name, value in row.items()}
            for row in connection.execute(text(whole), values).mappings()
        )
    if not is_paged or len(rows) < limit:
        return Answer(rows, None)
    return Answer(rows, json.dumps([rows[-1][each] for each in operator.key]))


def _finite(value: object) -> object:
    """A number that is none, such as the height of something without an end, is missing."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _shown(columns: tuple[Column, ...]) -> tuple[list[str], list[str]]:
    """What is selected for the columns, and the joins that give instances their names."""
    shown, joins = [], []
    for each in columns:
        if each.gives == "geometry":
            shown.append(f"semap.geojson(r.{each.name}) as {each.name}")
            continue
        shown.append(f"r.{each.name}")
        if each.gives == "instance":
            name = each.name.removesuffix("_id")
            shown.append(f"of_{name}.name as {name}")
            joins.append(f"left join semap.instance of_{name} on of_{name}.instance_id = r.{each.name}")
    return shown, joins


def _type_of(operator: Operator, column: str) -> str:
    return next(SQL_TYPES[each.gives] for each in operator.columns if each.name == column)


def _places(operator: Operator, after: str) -> list[Any]:
    try:
        places = json.loads(after)
    except ValueError:
        places = None
    is_place = isinstance(places, list) and len(places) == len(operator.key)
    if not is_place or not all(isinstance(each, int) and 0 <= each < 2**63 for each in places):
        raise InvalidInput("it is no place in this answer", "Give `next` of the page before.", "after")
    return list(places)
