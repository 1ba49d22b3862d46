"""Placed instances for the exports."""

from uuid import uuid5

import shapely
from shapely import MultiPolygon, Polygon

from semap.formats.geojson import NAMESPACE
from semap.geometry.outline import outline
from semap.geometry.pose import transform_mesh
from semap.model.building import Building, HeightBand, Item
from semap.model.map_document import InstanceEntry, PlacedInstance
from semap.model.pose import Pose
from semap.model.source_geometry import BODY, SourceGeometry


def place(building: Building) -> tuple[PlacedInstance, ...]:
    """What a map has of a building after its import."""
    storeys = tuple(
        PlacedInstance(
            InstanceEntry(each.uid, each.name, "Storey", each.name),
            Pose(z_m=each.elevation_m),
            None,
            None,
            (),
        )
        for each in building.storeys
    )
    return (*storeys, *(place_item(item) for item in building.items))


def place_item(item: Item) -> PlacedInstance:
    entry = InstanceEntry(
        item.uid,
        item.name,
        item.concept,
        item.name,
        item.alias,
        None,
        item.storey,
        item.joins,
        item.attributes,
    )
    footprint: Polygon | MultiPolygon | None = item.footprint
    if footprint is None and item.body is not None:
        footprint = outline(transform_mesh(item.pose.matrix(), item.body))
    sources = () if item.body is None else (SourceGeometry(BODY, "TRIANGLEMESH3D", item.body),)
    return PlacedInstance(entry, item.pose, footprint, item.band, sources)


def instance(name: str, pose: Pose, *sources: SourceGeometry, **changes: object) -> PlacedInstance:
    entry = InstanceEntry(uuid5(NAMESPACE, name), name, "Table", name, attributes={"legs": 4})
    footprint, band = changes.get("footprint"), changes.get("band")
    assert footprint is None or isinstance(footprint, shapely.Polygon)
    assert band is None or isinstance(band, HeightBand)
    return PlacedInstance(entry, pose, footprint, band, sources)
