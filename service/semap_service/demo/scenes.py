"""What the demo plays: buildings and the movement in them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from uuid import NAMESPACE_URL, uuid5

import shapely
from semap_ingest.track_file import Layout

from semap.formats import read_building
from semap.model.building import Building, HeightBand, Item
from semap.timeline.stamp import parse_stamp

OWN = Path(__file__).parent


@dataclass(frozen=True)
class Scene:
    """A building with a recording of movement in it.

    pace   so many times as fast as it happened
    shown  at most so many events are printed one by one
    doors  states of its doors, in a file beside the movement
    rules  templates of rules that it adds to both edges of who is in which room
    """

    name: str
    title: str
    building: Building
    tracks: Path
    pace: float
    layout: Layout = field(default_factory=Layout)
    shown: int = 40
    doors: Path | None = None
    rules: tuple[str, ...] = ()


def scenes(data: Path | None) -> list[Scene]:
    """The built-in office, and what of the real data sets is in the folder `data`."""
    found = [
        Scene("office", "three people and seven doors in a small office (built in, simulated)",
              read_building(OWN / "office.geojson"), OWN / "walk.csv", 8.0, shown=80, doors=OWN / "doors.csv",
              rules=("opened_then_entered", "entered_then_closed", "left_then_closed"))
    ]  # fmt: skip
    if data is not None and (data / "flat" / "rooms.geojson").is_file():
        found.append(_flat(data / "flat"))
    if data is not None and (data / "bottleneck").is_dir():
        found.append(_bottleneck(next((data / "bottleneck").glob("*.txt"))))
    return found


def _flat(folder: Path) -> Scene:
    return Scene(
        "flat", "a robot that drives through a furnished flat (real)",
        read_building(folder / "rooms.geojson"), folder / "test_robot_df.csv", 40.0,
        Layout(track="robot", stamp_unit="ns"),
    )  # fmt: skip


def _bottleneck(file: Path) -> Scene:
    """Two regions that meet at the opening, y = -0.6 m; the laboratory has no map of its own."""
    halves = {"waiting_area": shapely.box(-12, -0.6, 12, 12), "beyond": shapely.box(-12, -12, 12, -0.6)}
    band = HeightBand(0, 3)
    rooms = tuple(
        Item(uuid5(NAMESPACE_URL, f"semap:bottleneck:{name}"), name, "Room", footprint=half, band=band)
        for name, half in halves.items()
    )
    building = Building((), rooms)
    layout = Layout(names=("track", "stamp", "x", "y", "z"), stamp_unit="25fps",
                    epoch_us=parse_stamp("2018-01-01T00:00:00Z"))  # fmt: skip
    return Scene(
        "bottleneck", "75 people who walk through an opening (real)", building, file, 20.0, layout, 5
    )
