"""A house whose shapes are plain enough to be known without PostGIS, and tracks in it; the same house next door."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from uuid import UUID, uuid5

import numpy as np
import psycopg
import shapely
from corpus import ANNA, KITCHEN

from semap.geometry.pose import pose_from_yaw
from semap.geometry.prism import extrude
from semap.model.building import Building, HeightBand, Item, Storey
from semap.store.database.connection import one_transaction
from semap.store.map.building import import_building
from semap.store.map.maps import create_map
from semap.timeline.stamp import to_datetime

NAMES = UUID("00000000-0000-4000-8000-000000000000")
ABOVE = {
    "Room": ("Room", "Space", "Thing"), "Cup": ("Cup", "Thing"),
    "Table": ("Table", "Furniture", "Thing"), "Storey": ("Storey", "Space", "Thing"),
    "Robot": ("Robot", "Agent", "Thing"), None: (),
}  # fmt: skip


@dataclass(frozen=True)
class Thing:
    """An instance: a prism over its footprint; rooms have no body.

    turned  its heading, a multiple of 90 degrees
    """

    name: str
    concept: str
    footprint: shapely.Polygon
    heights: tuple[float, float]
    uid: UUID
    alias: str | None = None
    storey: str | None = None
    turned: int = 0
    attributes: Mapping[str, object] = field(default_factory=dict)

    kind = "instance"

    @property
    def properties(self) -> dict[str, object]:
        return {
            "name": self.name, "alias": self.alias, "concept": self.concept, "storey": self.storey,
            "attributes": dict(self.attributes), "concepts": ABOVE[self.concept],
        }  # fmt: skip


@dataclass(frozen=True)
class Walker:
    """A track: where it was and is [m], and what else its present says."""

    name: str
    before: tuple[float, float]
    now: tuple[float, float]
    z_m: float | None
    heading_rad: float | None
    speed_mps: float | None
    uid: UUID
    source: str = "tracker"
    size: tuple[float, float] | None = (0.6, 0.4)
    concept: str | None = None
    attributes: Mapping[str, object] = field(default_factory=dict)

    kind = "track"

    @property
    def properties(self) -> dict[str, object]:
        return {
            "name": self.name, "source": self.source, "attributes": dict(self.attributes),
            "concepts": ABOVE[self.concept],
        }  # fmt: skip


def thing(
    name: str, concept: str, footprint: shapely.Polygon, low: float, high: float, **more: object
) -> Thing:
    uid = UUID(KITCHEN) if name == "Kitchen" else uuid5(NAMES, name)
    return Thing(name, concept, footprint, (low, high), uid, **more)  # type: ignore[arg-type]


def walker(name: str, now: tuple[float, float], z_m: float | None, **more: object) -> Walker:
    uid = UUID(ANNA) if name == "anna" else uuid5(NAMES, name)
    given = {"before": now, "heading_rad": None, "speed_mps": None, **more}
    return Walker(name=name, now=now, z_m=z_m, uid=uid, **given)  # type: ignore[arg-type]


ELL = shapely.Polygon([(0, 0), (6, 0), (6, 3), (3, 3), (3, 6), (0, 6)])
THINGS = (
    thing("Kitchen", "Room", ELL, 0, 2.5, alias="Kitchen", storey="Ground",
          attributes={"floor": "2", "area": 27, "open": False, "size": {"unit": "m"}}),
    thing("Hall", "Room", shapely.box(6, 0, 10, 6), 0, 2.5, alias="Foyer", storey="Ground",
          attributes={"floor": 2, "area": 4.5, "open": True, "size": {"unit": "m"}, "tags": ["big"]}),
    thing("Larder", "Room", shapely.box(3, 3, 6, 6), 0, 2.5, attributes={"floor": "ground", "area": 9}),
    thing("Pantry", "Room", shapely.box(3.2, 3.2, 4.2, 4.2), 0, 2.5, attributes={"floor": "ground", "open": None}),
    thing("Attic", "Room", ELL, 2.5, 5, storey="Upper", attributes={"floor": True}),
    thing("Desk", "Table", shapely.box(1, 1, 2, 3), 0, 0.8, turned=1),
    thing("Board", "Table", shapely.box(8, 2, 9, 3), 0, 1.1),
    thing("Mug", "Cup", shapely.box(1.2, 1.2, 1.3, 1.3), 0.8, 0.9),
    thing("Glass", "Cup", shapely.box(0.7, 1.8, 0.8, 1.9), 0.3, 0.4),
    thing("Bowl", "Cup", shapely.box(7.9, 2.4, 8.1, 2.6), 1.1, 1.2),
    thing("Jug", "Cup", shapely.box(1.4, 2.0, 1.5, 2.1), 0.2, 0.3),
)  # fmt: skip
WALKERS = (
    walker(
        "anna",
        (1.5, 3.6),
        1.0,
        before=(1.5, 4.1),
        heading_rad=-np.pi / 2,
        speed_mps=1.0,
        attributes={"shift": "night"},
    ),
    walker("ben", (5.7, 1.2), None, before=(6.5, 1.2), heading_rad=np.pi, speed_mps=0.7),
    walker(
        "cleo", (7.3, 2.5), 1.1, heading_rad=0.1, speed_mps=0.2, concept="Robot", attributes={"shift": "day"}
    ),
    walker("dan", (0.4, 5.1), 2.6, before=(-1.0, 5.1), heading_rad=0.3, speed_mps=1.4, size=None),
    walker("eve", (10.6, 7.4), 0.2, heading_rad=2.4, speed_mps=0.9, source="camera"),
    walker("finn", (8.4, 2.2), 2.5, source="camera"),
    walker("gus", (1.6, -1.9), 0.5, before=(1.6, -2.3), heading_rad=1.5, speed_mps=0.4),
    walker("hana", (6.8, 2.7), 0.9, heading_rad=3.0, speed_mps=0.6, source="camera"),
    walker("kim", (4.05, 4.0), 1.2, heading_rad=0.5, speed_mps=0.3),
    walker("jo", (7.5, 8.0), 1.5, heading_rad=-1.6, speed_mps=1.1),
    walker("ida", (6.0, 4.4), 0.9, heading_rad=0.9, speed_mps=0.0),
)


def build(dsn: str, map_name: str) -> int:
    """The house on a map of its own; gives the id of the map."""
    with one_transaction(dsn, "semap_api") as connection:
        map_id = create_map(connection, map_name).map_id
        storeys = tuple(Storey(uuid5(NAMES, name), name, z) for name, z in (("Ground", 0.0), ("Upper", 2.5)))
        import_building(connection, map_name, Building(storeys, tuple(map(_item, THINGS))))
    return map_id


def _item(one: Thing) -> Item:
    common = {"alias": one.alias, "storey": one.storey, "attributes": one.attributes}
    if one.concept == "Room":
        return Item(
            one.uid, one.name, one.concept, footprint=one.footprint, band=HeightBand(*one.heights), **common
        )
    centre = one.footprint.centroid
    pose = pose_from_yaw(centre.x, centre.y, one.heights[0], one.turned * np.pi / 2)
    flat = shapely.affinity.translate(one.footprint, -centre.x, -centre.y)
    flat = shapely.affinity.rotate(flat, -90 * one.turned, origin=(0, 0))
    body = extrude(flat, 0, one.heights[1] - one.heights[0])
    return Item(one.uid, one.name, one.concept, pose=pose, body=body, **common)


def walk(connection: psycopg.Connection, map_id: int, prefix: str = "") -> None:
    """Two states of each track, each source by itself."""
    for source in ("tracker", "camera"):
        (source_id,) = connection.execute(
            "insert into semap.source (map_id, name, watermark) values (%s, %s, '-infinity') returning source_id",
            [map_id, source],
        ).fetchone() or (0,)
        for one in WALKERS:
            if one.source != source:
                continue
            uid = uuid5(NAMES, prefix + one.name) if prefix else one.uid
            (track_id,) = connection.execute(
                "insert into semap.track (uid, source_id, map_id, name, concept_id, attributes)"
                " values (%s, %s, %s, %s, (select concept_id from semap.concept where name = %s), %s)"
                " returning track_id",
                [uid, source_id, map_id, one.name, one.concept, json.dumps(one.attributes)],
            ).fetchone() or (0,)
            for at_us, (x_m, y_m) in enumerate((one.before, one.now)):
                connection.execute(
                    "insert into semap.track_state (track_id, stamp, x_m, y_m, z_m, heading_rad, speed_mps,"
                    " length_m, width_m) values (%s, %s, %s, %s, %s, %s, %s, %s, %s)",
                    [track_id, to_datetime(at_us * 1_000_000), x_m, y_m, one.z_m, one.heading_rad, one.speed_mps,
                     *(one.size or (None, None))],
                )  # fmt: skip
    connection.execute(
        "update semap.source set watermark = %s where map_id = %s", [to_datetime(1_000_000), map_id]
    )


def shown(properties: Mapping[str, object]) -> str:
    return json.dumps(properties, default=str, sort_keys=True)
