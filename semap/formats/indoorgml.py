"""Indoor spaces in IndoorGML (OGC 14-005r5, versions 1.0 to 1.1), XML with geometries in GML.

A cell becomes a Room; a ConnectionSpace or AnchorSpace of the navigation module, or a cell that is called
a door, becomes a Door, a NonNavigableSpace an Obstacle (`semap.formats.indoorgml_cells`). A transition of the
dual graph that leads from one room into another becomes an Opening that joins them, at the place where the
transition passes from one to the other; both directions are one opening. A transition between a door's cell
and a room says that the door joins the room.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid5
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from semap.errors import InvalidInput
from semap.formats.geojson import NAMESPACE
from semap.formats.gml_surface import geometry_of, polygons_of, surface_of
from semap.formats.gml_tree import LINE, by_id, name_of, parse_xml, text_of
from semap.formats.indoorgml_cells import cell_elements, concept_of, key_of
from semap.formats.indoorgml_graph import Passage, passages
from semap.formats.refusals import Refusals
from semap.formats.source import read_bytes
from semap.formats.unique_name import unique_names
from semap.geometry.pose import pose_from_yaw
from semap.model.building import Building, Finding, HeightBand, Item, Mesh, Storey
from semap.model.pose import IDENTITY, Pose

GEOMETRIES = ("cellSpaceGeometry", "geometry3D", "Geometry3D", "geometry2D", "Geometry2D")
STOREY = re.compile(r"""\b(?:storey|level|floor)\s*=\s*["']?([^"':;,]+)""", re.IGNORECASE)
DEGREES = re.compile(r"CRS84|(?<!\d)(?:4326|4979|4258|4269)(?!\d)", re.IGNORECASE)
METRES_OF = {"m": 1.0, "metre": 1.0, "meter": 1.0, "9001": 1.0, "mm": 1e-3, "cm": 1e-2, "ft": 0.3048}


@dataclass(frozen=True, eq=False)
class Cell:
    """A cell of the primal space.

    pose        map_T_cell, at whole metres of the plan: coordinates far from zero keep their digits
    body        in the cell's frame
    footprint   [m, map frame], of a cell that is given in 2D
    """

    key: str
    name: str
    concept: str
    storey: str | None
    pose: Pose
    body: Mesh | None
    footprint: Polygon | MultiPolygon | None
    attributes: Mapping[str, object]

    @property
    def heights_m(self) -> tuple[float, float] | None:
        """The lowest and the highest point of the body in the map."""
        if self.body is None:
            return None
        heights = self.body.vertices_m[:, 2] + self.pose.z_m
        return float(heights.min()), float(heights.max())


def read_indoorgml(path: Path) -> Building:
    """Read cells and transitions from a file; see `parse_indoorgml`."""
    return parse_indoorgml(read_bytes(path), str(path))


def parse_indoorgml(data: bytes, where: str = "") -> Building:
    """The building that an IndoorGML document describes, with what was decided about it.

    raises  InvalidInput if it is no IndoorGML, has a document type, has no cells, or its coordinates are
            degrees or of an unknown unit; TooLarge
    """
    root = parse_xml(data, where)
    if "indoorgml" not in root.tag.lower():
        raise InvalidInput("not an IndoorGML file", "Give IndoorGML 1.0 or 1.1 (core IndoorFeatures).", where)
    findings: list[Finding] = []
    scale = _scale(root, where, findings)
    ids = by_id(root)
    elements = cell_elements(root, ids, findings)
    if not elements:
        raise InvalidInput("there are no cells", "Export the primal space with its CellSpaces.", where)
    wrong = Refusals()
    read: list[Cell] = []
    for place, each in enumerate(elements):
        with wrong.of_part(place):
            read.append(_cell(each, ids, scale, where, findings))
    wrong.raise_if_any("cells", where)
    cells = _with_unique_names(read, findings)
    found = passages(root, ids, {cell.key: cell.concept for cell in cells}, findings)
    joins = _joins(cells, found)
    items = [_item(cell, joins.get(cell.key, ())) for cell in cells]
    items += _openings(cells, found, scale, where, findings)
    return Building(_storeys(cells), tuple(items), tuple(findings))


def _scale(root: Element, where: str, findings: list[Finding]) -> float:
    """Metres for one unit of the coordinates."""
    systems = {said for each in root.iter() if (said := each.get("srsName")) is not None}
    units = {said.split()[0] for each in root.iter() if (said := each.get("uomLabels", "").strip())}
    for system in sorted(systems):
        if DEGREES.search(system):
            raise InvalidInput(
                f"the coordinates are degrees ({system})", "Export it in a metric system, such as UTM.", where
            )
        findings.append(
            Finding("note", "coordinates", f"they are in {system}; the map has no anchor from it")
        )
    if len(systems) > 1 or len(units) > 1:
        raise InvalidInput(
            f"it mixes systems or units: {', '.join(sorted(systems | units))}", "Export it in one.", where
        )
    if not units:
        findings.append(
            Finding("note", "units", "the file names no unit; its coordinates are taken as metres")
        )
        return 1.0
    unit = units.pop().lower().rpartition(":")[2]
    if unit not in METRES_OF:
        raise InvalidInput(f"the unit {unit!r} is not known", "Export it in metres.", where)
    return METRES_OF[unit]


def _cell(
    element: Element, ids: Mapping[str, Element], scale: float, where: str, findings: list[Finding]
) -> Cell:
    key = key_of(element)
    name = text_of(element, "name") or key
    at = f"{where}:{element.get(LINE)}"
    pose, body, footprint = _geometry(element, ids, scale, at, name, findings)
    attributes: dict[str, object] = {"indoorgml_id": key, "indoorgml_class": name_of(element)}
    for said in ("class", "function", "usage"):
        if (value := text_of(element, said)) is not None:
            attributes[f"indoorgml_{said}"] = value
    for reference in (each for each in element.iter() if name_of(each) == "externalReference"):
        labels = [each.text.strip() for each in reference.iter() if each.text and each.text.strip()]
        if labels:
            attributes["external_reference"] = " ".join(labels)
    storey = text_of(element, "storey", "level", "floor")
    if storey is None and (described := STOREY.search(text_of(element, "description") or "")):
        storey = described[1].strip() or None
    return Cell(key, name, concept_of(element, name), storey, pose, body, footprint, attributes)


def _geometry(
    element: Element, ids: Mapping[str, Element], scale: float, where: str, name: str, findings: list[Finding]
) -> tuple[Pose, Mesh | None, Polygon | MultiPolygon | None]:
    geometry = geometry_of(element, *GEOMETRIES)
    if geometry is None:
        return IDENTITY, None, None
    rings = list(polygons_of(geometry, ids, where))
    if not rings:
        return IDENTITY, None, None
    corners_m = np.concatenate([ring for polygon in rings for ring in polygon]) * scale
    if name_of(geometry) != "Solid" and np.ptp(corners_m[:, 2]) == 0:
        return _flat(rings, scale, name, findings)
    # Heights are near zero as they are, and stay equal where rooms meet.
    origin_m = np.floor(corners_m.min(axis=0)) * (1.0, 1.0, 0.0)
    surface = surface_of(geometry, ids, scale, origin_m, where)
    if surface.bent:
        findings.append(
            Finding("repaired", name, f"{surface.bent} of its faces are not flat; cut into triangles")
        )
    if surface.crossing:
        reason = f"{surface.crossing} of its faces cross themselves; cut where they do"
        findings.append(Finding("repaired", name, reason))
    return Pose(*(float(part) for part in origin_m)), surface.mesh, None


def _flat(
    polygons: Sequence[tuple[NDArray[np.float64], ...]], scale: float, name: str, findings: list[Finding]
) -> tuple[Pose, None, Polygon | MultiPolygon | None]:
    """A cell in 2D: its outline, at the height of its points."""
    parts = [Polygon(outside[:, :2], [hole[:, :2] for hole in holes]) for outside, *holes in polygons]
    area = shapely.union_all(
        [shapely.make_valid(shapely.transform(part, lambda p: p * scale)) for part in parts]
    )
    if not isinstance(area, Polygon | MultiPolygon) or area.is_empty:
        findings.append(Finding("note", name, "kept without outline: it encloses no area"))
        return IDENTITY, None, None
    return Pose(z_m=float(polygons[0][0][0, 2] * scale)), None, area


def _with_unique_names(cells: Sequence[Cell], findings: list[Finding]) -> list[Cell]:
    storeys = {cell.storey for cell in cells if cell.storey is not None}
    names, renamed = unique_names([(cell.name, cell.storey) for cell in cells], storeys)
    findings.extend(renamed)
    return [
        Cell(cell.key, name, cell.concept, cell.storey, cell.pose, cell.body, cell.footprint, cell.attributes)
        for cell, name in zip(cells, names, strict=True)
    ]


def _storeys(cells: Sequence[Cell]) -> tuple[Storey, ...]:
    bottoms_m: dict[str, float] = {}
    for cell in cells:
        if cell.storey is not None:
            bottom_m = cell.pose.z_m if cell.heights_m is None else cell.heights_m[0]
            bottoms_m[cell.storey] = min(bottom_m, bottoms_m.get(cell.storey, bottom_m))
    return tuple(
        Storey(uuid5(NAMESPACE, f"storey {name}"), name, bottom_m) for name, bottom_m in bottoms_m.items()
    )


def _joins(cells: Sequence[Cell], found: Sequence[Passage]) -> dict[str, tuple[str, ...]]:
    """The rooms that each cell that is a door leads to, by the cell's key."""
    by_key = {cell.key: cell for cell in cells}
    joins: dict[str, set[str]] = {}
    for passage in found:
        for one, other in (passage.cells, passage.cells[::-1]):
            if by_key[one].concept != "Room" and by_key[other].concept == "Room":
                joins.setdefault(one, set()).add(by_key[other].name)
    return {key: tuple(sorted(names)) for key, names in joins.items()}


def _item(cell: Cell, joins: tuple[str, ...]) -> Item:
    heights_m = cell.heights_m if cell.concept == "Room" else None
    return Item(
        uid=uuid5(NAMESPACE, f"indoorgml {cell.key}"),
        name=cell.name,
        concept=cell.concept,
        storey=cell.storey,
        pose=cell.pose,
        body=cell.body,
        footprint=cell.footprint,
        band=HeightBand(*heights_m) if heights_m is not None and heights_m[0] < heights_m[1] else None,
        joins=joins,
        attributes=cell.attributes,
    )


def _openings(
    cells: Sequence[Cell], found: Sequence[Passage], scale: float, where: str, findings: list[Finding]
) -> list[Item]:
    by_key = {cell.key: cell for cell in cells}
    between = [each for each in found if all(by_key[key].concept == "Room" for key in each.cells)]
    rooms = [tuple(sorted(by_key[key].name for key in each.cells)) for each in between]
    on = [{by_key[key].storey for key in each.cells} for each in between]
    storeys = [next(iter(each)) if len(each) == 1 else None for each in on]
    wanted = [each.name or f"Opening {' - '.join(names)}" for each, names in zip(between, rooms, strict=True)]
    taken = [*(cell.name for cell in cells), *(cell.storey for cell in cells if cell.storey is not None)]
    counts = Counter(wanted)
    unique, renamed = unique_names(list(zip(wanted, storeys, strict=True)), taken)
    # A made name that got a number is nothing to tell.
    findings.extend(each for each in renamed if counts[each.subject.rpartition(" ")[0]] == 0)
    made = []
    for passage, name, joins, storey in zip(between, unique, rooms, storeys, strict=True):
        place = passage.place(scale, where)
        attributes: dict[str, Any] = {"indoorgml_id": passage.key}
        attributes |= {"weight": passage.weight} if passage.weight is not None else {}
        attributes |= {key: value for key, value in place.sizes_m.items() if value > 0}
        made.append(
            Item(
                uid=uuid5(NAMESPACE, f"indoorgml {passage.key}"),
                name=name,
                concept="Door" if passage.is_door else "Opening",
                storey=storey,
                pose=pose_from_yaw(*place.point_m, place.yaw_rad),
                joins=joins,
                attributes=attributes,
            )
        )
    return made
