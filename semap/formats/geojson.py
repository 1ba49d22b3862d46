"""Floor plans in GeoJSON (RFC 7946), in metres of the map or in degrees (`semap.formats.geojson_system`).

Polygons are rooms, lines and points are openings, unless `concept` says otherwise. Properties:

name         identity; without it the feature's id; without both the feature is skipped
concept      default Room (polygons) or Opening (lines, points)
alias        what people call it
height_m     extrudes a polygon over [elevation_m, elevation_m + height_m); without it no body, no band
elevation_m  default 0
storey       name of its storey, whose elevation is that of its lowest feature, if not given
joins        names of the rooms on both sides; without it they are found from the shapes
uid          a UUID; without it one is made from the name
attributes   an object of attributes whose names are among these

Every other property becomes an attribute. A member `storeys` of the document may give elevations by name.
A line's opening stands at its middle, x along the line, and gets its length as the attribute `width_m`. Lines
and points keep their height as the attribute `height_m`.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from uuid import UUID, uuid5

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Polygon

from semap.errors import InvalidInput
from semap.formats.adjacency import Floor, joined_rooms
from semap.formats.geojson_shape import Shape, ShapeError, parse_shape
from semap.formats.geojson_system import Crs, as_metres, system_of
from semap.formats.refusals import Refusals, listed
from semap.formats.source import read_bytes, utf8
from semap.formats.uncollected import uncollected
from semap.geometry.pose import pose_from_yaw
from semap.geometry.prism import extrude
from semap.model.building import Building, Finding, HeightBand, Item, Storey
from semap.model.pose import IDENTITY, Pose

NAMESPACE = UUID("5c1f6f0e-6d0a-5b0e-9d53-3c1a2e8f7b40")
"""Names become uids in this namespace, so that reading a file twice gives the same building."""

OPENING_CONCEPTS = {"Door", "Opening"}
OWN_PROPERTIES = {
    "name",
    "concept",
    "alias",
    "height_m",
    "elevation_m",
    "storey",
    "joins",
    "uid",
    "attributes",
}


def read_geojson(path: Path, crs: Crs | None = None) -> Building:
    """Read a floor plan from a file; see `parse_geojson`."""
    text = utf8(read_bytes(path), str(path))
    with uncollected():
        try:
            document = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise InvalidInput(f"not JSON: {error}", "Give a GeoJSON file in UTF-8.", str(path)) from error
        return parse_geojson(document, where=str(path), crs=crs)


def parse_geojson(document: object, where: str = "", crs: Crs | None = None) -> Building:
    """The building that a GeoJSON document describes, with what was repaired or left out.

    document  as `json.loads` gives it
    where     names the document in errors
    crs       what the coordinates are; None: see `semap.formats.geojson_system`
    raises    InvalidInput if it is no feature collection, repeats a name, has no usable feature, or has
              values that are wrong, with the first 20 features that have some
    """
    features = _features(document, where)
    findings: list[Finding] = []
    wrong = Refusals()
    read: list[_Feature] = []
    for index, feature in enumerate(features):
        with wrong.of_part(index):
            if (found := _read_feature(feature, index, findings)) is not None:
                read.append(found)
    if not read:
        wrong.raise_if_any("features", where)
        raise InvalidInput(
            "no feature can be used:\n  " + listed([f"{each.subject}: {each.reason}" for each in findings]),
            "Give at least one polygon with a `name` property.",
            where,
        )
    system = system_of(document, [each.shape for each in read], crs)
    anchor = None
    if system.crs == "degrees":
        shapes, anchor, finding = as_metres([each.shape for each in read], system, where)
        read = [replace(each, shape=shape) for each, shape in zip(read, shapes, strict=True)]
        findings.insert(0, finding)
    drafts: list[_Draft] = []
    for each in read:
        with wrong.of_part(each.index):
            drafts.append(_draft(each))
    wrong.raise_if_any("features", where)
    storeys = _storeys(drafts, document, where)
    _refuse_duplicates([*(draft.item.name for draft in drafts), *(storey.name for storey in storeys)], where)
    items = _with_joins(drafts, findings)
    return Building(storeys, items, tuple(findings), anchor)


@dataclass(frozen=True)
class _Feature:
    """A feature that can be used, before what it says is looked at."""

    index: int
    name: str
    shape: Shape
    properties: Mapping[str, object]
    where: str


@dataclass(frozen=True)
class _Draft:
    """An item before its joins are known; `joins` None: the file does not say."""

    item: Item
    shape: Shape
    elevation_m: float
    joins: tuple[str, ...] | None

    @property
    def is_opening(self) -> bool:
        """Points are openings only where they are called so: sensors and lamps are points, too."""
        return isinstance(self.shape, LineString) or self.item.concept in OPENING_CONCEPTS

    @property
    def is_room(self) -> bool:
        return self.item.footprint is not None and not self.is_opening


def _features(document: object, where: str) -> list[object]:
    if not isinstance(document, Mapping) or document.get("type") != "FeatureCollection":
        raise InvalidInput(
            "not a GeoJSON FeatureCollection", 'Wrap the features in {"type": "FeatureCollection"}.', where
        )
    features = document.get("features")
    if not isinstance(features, list):
        raise InvalidInput("`features` is not a list", "Give a list of GeoJSON features.", where)
    if not features:
        raise InvalidInput(
            "there are no features", "Give at least one polygon with a `name` property.", where
        )
    return features


def _read_feature(feature: object, index: int, findings: list[Finding]) -> _Feature | None:
    where = f"features[{index}]"
    if not isinstance(feature, Mapping) or feature.get("type") != "Feature":
        findings.append(Finding("skipped", where, "not a GeoJSON feature"))
        return None
    properties = feature.get("properties") or {}
    if not isinstance(properties, Mapping):
        raise InvalidInput("`properties` is not an object", "Give an object or null.", where)
    name = _name(properties, feature.get("id"))
    if name is None:
        findings.append(Finding("skipped", where, "it has neither a `name` nor an id"))
        return None
    where = f"{where} {name!r}"
    _refuse_unstorable(dict(properties) | {"name": name}, where)
    try:
        shape, notes = parse_shape(feature.get("geometry"), where)
    except ShapeError as error:
        findings.append(Finding("skipped", name, str(error)))
        return None
    findings.extend(Finding(note.action, name, note.reason) for note in notes)
    return _Feature(index, name, shape, properties, where)


def _draft(feature: _Feature) -> _Draft:
    name, shape, properties, where = feature.name, feature.shape, feature.properties, feature.where
    footprint = shape if isinstance(shape, Polygon | MultiPolygon) else None
    elevation_m = _number(properties, "elevation_m", where) or 0.0
    height_m = _number(properties, "height_m", where)
    if height_m is not None and height_m <= 0:
        raise InvalidInput(f"`height_m` is {height_m}", "Give a height greater than zero.", where)
    band = None
    if footprint is not None and height_m is not None:
        band = HeightBand(elevation_m, elevation_m + height_m)
    attributes = _attributes(properties, where)
    if isinstance(shape, LineString):
        attributes.setdefault("width_m", shape.length)
    if footprint is None and height_m is not None:
        attributes.setdefault("height_m", height_m)
    item = Item(
        uid=_uid(properties, name, where),
        name=name,
        concept=_text(properties, "concept", where) or ("Opening" if footprint is None else "Room"),
        alias=_text(properties, "alias", where),
        storey=_text(properties, "storey", where),
        pose=IDENTITY if footprint is not None else _pose(shape, elevation_m),
        body=None if footprint is None or band is None else extrude(footprint, band.z_min_m, band.z_max_m),
        footprint=footprint,
        band=band,
        attributes=attributes,
    )
    return _Draft(item, shape, elevation_m, _joins(properties, where))


def _attributes(properties: Mapping[str, object], where: str) -> dict[str, object]:
    hidden = properties.get("attributes", {})
    if not isinstance(hidden, Mapping):
        raise InvalidInput("`attributes` is not an object", "Give an object of attributes.", where)
    return {key: value for key, value in properties.items() if key not in OWN_PROPERTIES} | dict(hidden)


def _uid(properties: Mapping[str, object], name: str, where: str) -> UUID:
    value = _text(properties, "uid", where)
    try:
        return uuid5(NAMESPACE, name) if value is None else UUID(value)
    except ValueError as error:
        raise InvalidInput(f"`uid` is {value!r}", "Give a UUID, or leave it out.", where) from error


def _pose(shape: Shape, elevation_m: float) -> Pose:
    """Where an opening stands: a point, or the middle of a line with x along it."""
    ends = shapely.get_coordinates(shape)[[0, -1]]
    along = ends[1] - ends[0]
    middle = shape.interpolate(0.5, normalized=True) if isinstance(shape, LineString) else shape.centroid
    return pose_from_yaw(middle.x, middle.y, elevation_m, float(np.arctan2(along[1], along[0])))


def _name(properties: Mapping[str, object], feature_id: object) -> str | None:
    for value in (properties.get("name"), feature_id):
        if isinstance(value, str | int) and not isinstance(value, bool) and str(value).strip():
            return str(value).strip()
    return None


def _text(properties: Mapping[str, object], key: str, where: str) -> str | None:
    value = properties.get(key)
    if value is None or value == "":
        return None
    if not isinstance(value, str):
        raise InvalidInput(f"`{key}` is {value!r}", "Give a text.", where)
    return value


def _number(properties: Mapping[str, object], key: str, where: str) -> float | None:
    value = properties.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= 1e6:
        raise InvalidInput(f"`{key}` is {value!r}", "Give a number of metres.", where)
    return float(value)


def _joins(properties: Mapping[str, object], where: str) -> tuple[str, ...] | None:
    names = properties.get("joins")
    if names is None:
        return None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InvalidInput(f"`joins` is {names!r}", "Give a list of room names.", where)
    return tuple(dict.fromkeys(names))


def _with_joins(drafts: list[_Draft], findings: list[Finding]) -> tuple[Item, ...]:
    rooms = {draft.item.name: draft for draft in drafts if draft.is_room}
    footprints: dict[str | None, dict[str, Polygon | MultiPolygon]] = {
        draft.item.storey: {} for draft in drafts
    }
    for name, room in rooms.items():
        if room.item.footprint is not None:
            footprints[room.item.storey][name] = room.item.footprint
    floors = {storey: Floor(on_storey) for storey, on_storey in footprints.items()}
    items: list[Item] = []
    for draft in drafts:
        if draft.joins is not None:
            unknown = [name for name in draft.joins if name not in rooms]
            findings.extend(
                Finding("note", draft.item.name, f"it joins {name!r}, which is no room of this file")
                for name in unknown
            )
            joins = tuple(name for name in draft.joins if name in rooms)
        elif draft.is_opening:
            joins = joined_rooms(draft.shape, floors[draft.item.storey])
        else:
            joins = ()
        items.append(replace(draft.item, joins=joins))
    return tuple(items)


def _storeys(drafts: list[_Draft], document: object, where: str) -> tuple[Storey, ...]:
    given = document.get("storeys", {}) if isinstance(document, Mapping) else {}
    if not isinstance(given, Mapping):
        raise InvalidInput("`storeys` is not an object", 'Give elevations by name: {"ground": 0}.', where)
    elevations_m: dict[str, float] = {}
    for draft in drafts:
        if (name := draft.item.storey) is not None:
            elevations_m[name] = min(draft.elevation_m, elevations_m.get(name, draft.elevation_m))
    for name in given:
        _refuse_unstorable({"name": name}, where)
        elevations_m[name] = _number(given, name, f"{where} storeys") or 0.0
    return tuple(
        Storey(uuid5(NAMESPACE, f"storey {name}"), name, elevation_m)
        for name, elevation_m in elevations_m.items()
    )


def _refuse_duplicates(names: Iterable[str], where: str) -> None:
    repeated = sorted(name for name, count in Counter(names).items() if count > 1)
    if repeated:
        raise InvalidInput(
            f"these names are given more than once: {', '.join(map(repr, repeated))}",
            "Give every feature and storey a name of its own.",
            where,
        )


def _refuse_unstorable(properties: Mapping[str, object], where: str) -> None:
    """PostgreSQL stores neither NaN in JSON nor the character NUL nor half a surrogate pair."""
    for key, value in properties.items():
        for number in _not_finite(value):
            what = f"`{key}` is {number}" if number is value else f"`{key}` holds {number}"
            raise InvalidInput(what, "Give a finite number, or leave it out.", where)
    try:
        text = json.dumps(properties, ensure_ascii=False)
        text.encode()
    except UnicodeEncodeError as error:
        half = f"U+{ord(error.object[error.start]):04X}"
        raise InvalidInput(f"a property has half of a character ({half})", "Remove it.", where) from error
    except RecursionError as error:
        raise InvalidInput("a property is nested too deeply", "Give plain attributes.", where) from error
    if "\\u0000" in text:
        raise InvalidInput("a property has the character NUL", "Remove it.", where)


def _not_finite(value: object) -> Iterator[float]:
    """The numbers in a value of JSON that are not finite."""
    left = [value]
    while left:
        each = left.pop()
        if isinstance(each, Mapping):
            left.extend(each.values())
        elif isinstance(each, list):
            left.extend(each)
        elif isinstance(each, float) and not math.isfinite(each):
            yield each
