"""Simulate the doors of the demo's walk: who comes near a door opens it, and it falls shut behind them.

Run it to write `doors.csv` again, after `walk.csv`:  python -m semap_service.demo.record_doors
"""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Iterable
from datetime import datetime, timedelta
from pathlib import Path

from shapely import Point

from semap.formats.geojson import read_geojson
from semap.model.building import Building

FOLDER = Path(__file__).parent
NEAR_M = 1.0
SHUT_AFTER_S = 0.3


def record(office: Building, walk: Iterable[str]) -> str:
    """The states of the doors as CSV: instance, property, value, stamp (ISO 8601, UTC); ordered by stamp.

    walk  lines of `walk.csv`
    """
    doors = {
        item.name: Point(item.pose.x_m, item.pose.y_m) for item in office.items if item.concept == "Door"
    }
    steps: dict[datetime, list[Point]] = defaultdict(list)
    for row in csv.DictReader(walk):
        steps[datetime.fromisoformat(row["stamp"])].append(Point(float(row["x_m"]), float(row["y_m"])))
    start = min(steps)
    rows = [(start, name, "closed") for name in doors]
    last_near: dict[str, datetime] = {}
    for stamp, people in sorted(steps.items()):
        for name, place in doors.items():
            if any(place.distance(person) <= NEAR_M for person in people):
                if name not in last_near:
                    rows.append((stamp, name, "open"))
                last_near[name] = stamp
            elif name in last_near and stamp - last_near[name] >= timedelta(seconds=SHUT_AFTER_S):
                del last_near[name]
                rows.append((stamp, name, "closed"))
    lines = ["instance,property,value,stamp"]
    for stamp, name, value in sorted(rows):
        text = f"{stamp:%Y-%m-%dT%H:%M:%S}.{stamp.microsecond // 100_000}Z"
        lines.append(f"{name},door,{value},{text}")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write `doors.csv` next to this file."""
    walk = (FOLDER / "walk.csv").read_text().splitlines()
    (FOLDER / "doors.csv").write_text(record(read_geojson(FOLDER / "office.geojson"), walk), newline="\n")


if __name__ == "__main__":
    main()
