"""Import of a large building, and refusal of large files that are no maps.

Seconds of the clock, and of this process alone. The building is a grid of rooms with doors between
neighbours, as GeoJSON: read, derived, written with all that follows by triggers, committed.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

from semap_service.exchange.map_file import bring_in, read_file

from bench.figure import Rows, once
from semap.errors import InvalidInput
from semap.store.database.connection import one_transaction

ROOMS = (200, 100)
DOORS = 19_500
WRONG_BYTES = 10_000_000
WIDE_M, DEEP_M = 4.0, 3.0


def measure(dsn: str, rooms: tuple[int, int] = ROOMS, doors: int = DOORS) -> Rows:
    """One import into a new database, and refusals of files that are no maps."""
    with tempfile.TemporaryDirectory() as folder:
        plan = Path(folder) / "tower.geojson"
        plan.write_text(json.dumps(grid(rooms, doors)))

        def bring() -> None:
            with one_transaction(dsn, "semap_api") as connection:
                bring_in(connection, read_file(plan), None, plan.stem)

        rows = [{"what": f"{rooms[0] * rooms[1]:,} rooms, {doors:,} doors", **_timed(bring)}]
        for what, text in wrong_files().items():
            wrong = Path(folder) / "wrong.yaml"
            wrong.write_text(text)
            rows.append({"what": f"10 MB, {what}", **_timed(partial(_refused, wrong))})
    return rows


def wrong_files() -> dict[str, str]:
    """Texts of 10 MB that are no maps, by what they are."""
    room = "  room {}:\n    footprint: [[0, 0], [4, 0], [4, 3], [0, 3]]\n    height_m: 2.5\n"

    def repeated(line: str) -> str:
        return "".join(line.format(n) for n in range(WRONG_BYTES // len(line)))

    rooms = f"map: tower\nrooms:\n{repeated(room)}"
    return {
        "another YAML": repeated("key{}: value\n"),
        "a text": repeated("Lorem ipsum dolor sit amet\n"),
        "a map with a wrong key at its end": f"{rooms}  last: {{hieght_m: 2.5}}\n",
        "a map with a wrong value at its end": f"{rooms}  last: {{uid: none}}\n",
        "a map with an outline at its end that crosses itself": (
            f"{rooms}  last: {{footprint: [[0, 0], [4, 3], [4, 0], [0, 3]]}}\n"
        ),
        "a map with a door at its end to a room that is not there": (
            f"{rooms}doors: {{last: {{between: [room 1, nowhere]}}}}\n"
        ),
    }


def grid(rooms: tuple[int, int], doors: int) -> dict[str, object]:
    """A floor of equal rooms in GeoJSON; doors lead from each to its neighbour in the east."""
    features: list[dict[str, object]] = []
    for column in range(rooms[0]):
        for row in range(rooms[1]):
            x, y = column * WIDE_M, row * DEEP_M
            ring = [[x, y], [x + WIDE_M, y], [x + WIDE_M, y + DEEP_M], [x, y + DEEP_M], [x, y]]
            properties = {"name": f"room {column}-{row}", "height_m": 2.5, "storey": "ground"}
            shape = {"type": "Polygon", "coordinates": [ring]}
            features.append({"type": "Feature", "properties": properties, "geometry": shape})
    for number in range(doors):
        column, row = divmod(number, rooms[1])
        x, y = (column + 1) * WIDE_M, row * DEEP_M
        properties = {"name": f"door {column}-{row}", "concept": "Door", "storey": "ground"}
        shape = {"type": "LineString", "coordinates": [[x, y + 1], [x, y + 2]]}
        features.append({"type": "Feature", "properties": properties, "geometry": shape})
    return {"type": "FeatureCollection", "features": features}


def _refused(path: Path) -> None:
    with suppress(InvalidInput):
        read_file(path)
        raise AssertionError(f"{path} was read")


def _timed(act: Callable[[], None]) -> dict[str, object]:
    began_s, worked_s = time.perf_counter(), time.process_time()
    act()
    return {
        "s": once(time.perf_counter() - began_s, 2),
        "own_cpu_s": once(time.process_time() - worked_s, 2),
    }
