"""A map as messages: an occupancy grid, and markers of its rooms and doors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from sqlalchemy import Connection, text

from semap.model.map_document import OccupancyGrid
from semap.store.database.connection import translated
from semap.store.map.grids import read_grids
from semap.store.motion.live import ShownDoor
from semap_bridge.ros.message import Messages

SHAPES = text("""
    select i.instance_id, i.name, i.concept_id in (select semap.concepts_below(semap.concept_named('Door'))),
           public.st_asbinary(a.geometry)
    from semap.instance i join semap.map m using (map_id)
    left join semap.abstraction a on a.description_id = i.absolute_description_id and a.type = 'Footprint'
    where m.name = :map
      and (i.concept_id in (select semap.concepts_below(semap.concept_named('Room')))
        or i.concept_id in (select semap.concepts_below(semap.concept_named('Door'))))
    order by i.instance_id
""")
CELL_M = 0.05
MOST_CELLS = 25_000_000
FREE, OCCUPIED, UNKNOWN = 0, 100, -1
LINE_STRIP, TEXT, DELETE_ALL = 4, 9, 3
WALL_M = 0.05
ROOM_COLOUR, DOOR_COLOUR = (0.2, 0.5, 0.9, 0.9), (0.6, 0.6, 0.6, 1.0)
DOOR_COLOURS = {"open": (0.1, 0.8, 0.2, 1.0), "closed": (0.85, 0.2, 0.1, 1.0)}


@dataclass(frozen=True, eq=False)
class MapPicture:
    """What a map shows.

    names  of rooms and doors, by id
    """

    rooms: Mapping[int, shapely.Geometry]
    doors: Mapping[int, shapely.Geometry]
    names: Mapping[int, str]
    grid: OccupancyGrid | None


def read_picture(connection: Connection, map_name: str) -> MapPicture:
    """A map as it is now; of several grids the first by name."""
    rooms: dict[int, shapely.Geometry] = {}
    doors: dict[int, shapely.Geometry] = {}
    names: dict[int, str] = {}
    with translated():
        for instance_id, name, is_door, wkb in connection.execute(SHAPES, {"map": map_name}):
            names[instance_id] = name
            if wkb is not None:
                (doors if is_door else rooms)[instance_id] = shapely.from_wkb(bytes(wkb))
    grids = read_grids(connection, map_name, limit=1)
    return MapPicture(rooms, doors, names, grids[0] if grids else None)


def grid_message(messages: Messages, picture: MapPicture, stamp_us: int, frame: str) -> Any | None:
    """The map's own grid, else one that is drawn of its rooms; None where it has neither."""
    if picture.grid is not None:
        grid = picture.grid
        cells, cell_m, (x_m, y_m, yaw_rad) = _cells_of(grid), grid.resolution_m, grid.origin
    elif picture.rooms:
        cells, cell_m, (x_m, y_m) = _drawn(picture)
        yaw_rad = 0.0
    else:
        return None
    height, width = cells.shape
    header = messages.header(stamp_us, frame)
    info = messages.new(
        "nav_msgs/msg/MapMetaData",
        map_load_time=header.stamp,
        resolution=float(cell_m),
        width=width,
        height=height,
        origin=messages.pose(x_m, y_m, 0.0, yaw_rad),
    )
    return messages.new("nav_msgs/msg/OccupancyGrid", header=header, info=info, data=cells.ravel())


def _cells_of(grid: OccupancyGrid) -> NDArray[np.int8]:
    """(height, width), the first row at the bottom, as map_server reads an image."""
    pixels = grid.pixels[::-1].astype(np.float64)
    if grid.mode == "raw":
        return np.where(pixels <= OCCUPIED, pixels, UNKNOWN).astype(np.int8)
    occupied = pixels / 255 if grid.negate else (255 - pixels) / 255
    most, least = grid.thresholds
    between = (
        99 * (occupied - least) / (most - least) if grid.mode == "scale" else np.full_like(occupied, UNKNOWN)
    )
    return np.where(occupied > most, OCCUPIED, np.where(occupied < least, FREE, between)).astype(np.int8)


def _drawn(picture: MapPicture) -> tuple[NDArray[np.int8], float, tuple[float, float]]:
    """Rooms are free and their outlines occupied, but where doors are; all else is unknown."""
    rooms = shapely.union_all(list(picture.rooms.values()))
    outlines = shapely.union_all([each.boundary.buffer(WALL_M) for each in picture.rooms.values()])
    doors = shapely.union_all([each.buffer(2 * WALL_M) for each in picture.doors.values()])
    walls = outlines.difference(doors)
    west, south, east, north = rooms.buffer(4 * WALL_M).bounds
    cell_m = CELL_M
    while (east - west) * (north - south) / cell_m**2 > MOST_CELLS:
        cell_m *= 2
    x_m = np.arange(west + cell_m / 2, east, cell_m)
    y_m = np.arange(south + cell_m / 2, north, cell_m)
    grid_x, grid_y = np.meshgrid(x_m, y_m)
    cells = np.full(grid_x.shape, UNKNOWN, np.int8)
    for shape, value in ((rooms, FREE), (doors.intersection(outlines), FREE), (walls, OCCUPIED)):
        shapely.prepare(shape)
        cells[shapely.contains_xy(shape, grid_x, grid_y)] = value
    return cells, cell_m, (west, south)


def map_markers(
    messages: Messages, picture: MapPicture, doors: Mapping[int, ShownDoor], stamp_us: int, frame: str
) -> Any:
    """A MarkerArray of outlines and names; doors are coloured by how they stand."""
    header = messages.header(stamp_us, frame)
    markers = [messages.new("visualization_msgs/msg/Marker", header=header, action=DELETE_ALL)]
    for kind, shapes in (("rooms", picture.rooms), ("doors", picture.doors)):
        for instance_id, shape in shapes.items():
            state = doors[instance_id].state if instance_id in doors else ""
            colour = ROOM_COLOUR if kind == "rooms" else DOOR_COLOURS.get(state, DOOR_COLOUR)
            for number, line in enumerate(_outlines(shape)):
                markers.append(
                    messages.new(
                        "visualization_msgs/msg/Marker",
                        header=header,
                        ns=f"{kind}/{number}" if number else kind,
                        id=instance_id % 2**31,
                        type=LINE_STRIP,
                        pose=messages.pose(0, 0),
                        scale=messages.new("geometry_msgs/msg/Vector3", x=WALL_M),
                        color=colour_message(messages, colour),
                        points=[messages.point(x_m, y_m) for x_m, y_m in line],
                    )
                )
            name = picture.names[instance_id]
            markers.append(text_marker(messages, header, f"{kind}/names", instance_id, name, shape.centroid))
    return messages.new("visualization_msgs/msg/MarkerArray", markers=markers)


def text_marker(
    messages: Messages, header: Any, space: str, number: int, said: str, at: shapely.Point
) -> Any:
    """A name over a place."""
    return messages.new(
        "visualization_msgs/msg/Marker",
        header=header,
        ns=space,
        id=number % 2**31,
        type=TEXT,
        pose=messages.pose(at.x, at.y, 2.0),
        scale=messages.new("geometry_msgs/msg/Vector3", z=0.3),
        color=colour_message(messages, (1.0, 1.0, 1.0, 1.0)),
        text=said,
    )


def colour_message(messages: Messages, colour: tuple[float, float, float, float]) -> Any:
    return messages.new("std_msgs/msg/ColorRGBA", **dict(zip("rgba", colour, strict=True)))


def _outlines(shape: shapely.Geometry) -> Sequence[NDArray[np.float64]]:
    """(n, 2) each."""
    parts = shapely.get_parts(shape.boundary if shape.geom_type.endswith("Polygon") else shape)
    return [shapely.get_coordinates(each) for each in parts if each.geom_type != "Point"]
