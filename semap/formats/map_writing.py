"""The full form of a map, as the files of its folder: pure, so that a service can send them as an archive."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import UTC

from semap.formats.map_folder import file_names
from semap.formats.map_shape import write_geometry, write_pose
from semap.formats.occupancy_grid import WRITER, grid_files
from semap.formats.ply import write_ply
from semap.formats.yaml_text import Flow, Row, yaml_text
from semap.model.building import Mesh
from semap.model.map_document import (
    ConceptEntry,
    DescriptionEntry,
    FrameEntry,
    InstanceEntry,
    MapDocument,
    StampedPose,
)
from semap.model.source_geometry import PolygonMesh

MARK = WRITER.encode()
"""Stands at the beginning of each mesh and grid that an export writes."""


def map_files(document: MapDocument) -> dict[str, bytes]:
    """The content of each file of a map's folder, by its path in it."""
    files: dict[str, bytes] = {}
    shared = [each for each in document.descriptions if each.is_shared]
    private = [each for each in document.descriptions if not each.is_shared]
    mesh_paths = _write_meshes((*shared, *private), files)
    tree: dict[str, object] = {"semap_map": 1, "map": document.name, "cell_m": float(document.cell_m)}
    if document.anchor is not None:
        tree["anchor"] = Flow(epsg=document.anchor.epsg, **write_pose(document.anchor.pose))
    tree["concepts"] = {each.name: _concept(each) for each in document.concepts}
    tree["frames"] = {each.name: _frame(each) for each in document.frames}
    tree["blueprints"] = {each.key: _description(each, mesh_paths) for each in shared}
    tree["descriptions"] = {each.key: _description(each, mesh_paths) for each in private}
    tree["instances"] = {each.name: _instance(each) for each in document.instances}
    tree["queries"] = {
        each.name: Flow(
            predicate=each.predicate,
            **({} if each.concept is None else {"concept": each.concept}),
            enabled=each.enabled,
            **(each.options if each.concept is not None else {"object": {}, **each.options}),
        )
        for each in document.queries
    }
    tree["rules"] = {
        each.name: {
            "queries": list(each.queries),
            "declaration": _plain(each.declaration),
            "enabled": each.enabled,
        }
        for each in document.rules
    }
    stems = file_names((each.name for each in document.grids), "")
    tree["grids"] = {name: f"grids/{stem}.yaml" for name, stem in stems.items()}
    for grid in document.grids:
        written = grid_files(grid, stems[grid.name])
        files |= {f"grids/{name}": content for name, content in written.items()}
    # Said even when empty: without them, a new map gets those that every map starts with.
    kept = {key: value for key, value in tree.items() if value != {} or key in ("queries", "rules")}
    return {"map.yaml": yaml_text(kept).encode(), **files}


def _write_meshes(
    descriptions: Iterable[DescriptionEntry], files: dict[str, bytes]
) -> dict[tuple[str, str], str]:
    """Add the meshes to the files; returns their paths by key of the description and name."""
    meshes = {
        (description.key, source.name): source.shape
        for description in descriptions
        for source in description.geometries
        if isinstance(source.shape, Mesh | PolygonMesh)
    }
    labels = {place: "\0".join(place) for place in meshes}
    names = file_names(labels.values(), ".ply")
    paths = {place: f"meshes/{names[label]}" for place, label in labels.items()}
    for place, shape in meshes.items():
        files[paths[place]] = write_ply(shape)
    return paths


def _concept(entry: ConceptEntry) -> Mapping[str, object]:
    fields: dict[str, object] = {}
    if entry.parents:
        fields["parents"] = Row(entry.parents)
    if entry.iris:
        fields["iris"] = list(entry.iris)
    if entry.comment is not None:
        fields["comment"] = entry.comment
    if entry.attribute_schema is not None:
        fields["schema"] = _plain(entry.attribute_schema)
    return fields


def _frame(entry: FrameEntry) -> Mapping[str, object]:
    fields: dict[str, object] = {} if entry.parent is None else {"parent": entry.parent}
    if len(entry.poses) == 1 and entry.poses[0].stamp is None:
        return Flow(fields | write_pose(entry.poses[0].pose))
    return fields | {"poses": [_stamped(each) for each in entry.poses]}


def _stamped(entry: StampedPose) -> Flow:
    fields: dict[str, object] = {}
    if entry.stamp is not None:
        fields["stamp"] = entry.stamp.astimezone(UTC).isoformat().replace("+00:00", "Z")
    return Flow(fields | write_pose(entry.pose))


def _description(entry: DescriptionEntry, mesh_paths: Mapping[tuple[str, str], str]) -> Mapping[str, object]:
    return {
        "geometries": {
            each.name: write_geometry(each, mesh_paths.get((entry.key, each.name), ""))
            for each in entry.geometries
        }
    }


def _instance(entry: InstanceEntry) -> Mapping[str, object]:
    fields: dict[str, object] = {"concept": entry.concept, "frame": entry.frame}
    for key, value in (("alias", entry.alias), ("description", entry.description), ("storey", entry.storey)):
        if value is not None:
            fields[key] = value
    if entry.joins:
        fields["joins"] = Row(entry.joins)
    if entry.attributes:
        fields["attributes"] = _plain(entry.attributes)
    return fields | {"uid": str(entry.uid)}


def _plain(value: object) -> object:
    """JSON values as the writer of YAML knows them."""
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return value
