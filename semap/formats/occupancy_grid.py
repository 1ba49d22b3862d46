"""Occupancy grids as ROS's map_server writes them: an image and a YAML file that says where it lies.

https://docs.ros.org/en/noetic/api/nav_msgs/html/msg/MapMetaData.html, http://wiki.ros.org/map_server. Images
are PGM (P2 and P5, 8 and 16 bit); PNG where pillow is installed. Pixels of another depth are scaled to
0..255, as map_server does.
"""

from __future__ import annotations

import importlib
import io
import re
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput, TooLarge
from semap.formats.map_folder import file_names, inside, replace_file
from semap.formats.source import read_bytes
from semap.formats.yaml_node import Node, parse_yaml
from semap.formats.yaml_text import row, yaml_text
from semap.model.map_document import OccupancyGrid

MAX_PIXELS = 100_000_000
MAX_IMAGE_BYTES = 8 * MAX_PIXELS
FIELDS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode")
MODES = ("trinary", "scale", "raw")
WRITER = "written by semap"
SPACE = rb"(?:[ \t\r\n\v\f]|#[^\n]*\n)+"
HEADER = re.compile(rb"(P[25])" + SPACE + SPACE.join([rb"(\d{1,9})"] * 3))


def read_grid(path: Path, name: str | None = None, folder: Path | None = None) -> OccupancyGrid:
    """Read a grid from its YAML file and the image that this names.

    name    default: the file's name without suffix
    folder  what the image may not leave; default: the folder of the file
    raises  NotFound, TooLarge, InvalidInput for anything that is no map of map_server
    """
    root = parse_yaml(read_bytes(path), str(path))
    fields = root.fields(FIELDS)
    for needed in ("image", "resolution", "origin"):
        if needed not in fields:
            raise root.wrong(f"`{needed}` is missing", "Write it as map_server does.")
    x_m, y_m, *yaw_rad = fields["origin"].numbers(2, 3)
    thresholds = tuple(
        _share(fields[key]) if key in fields else default
        for key, default in (("occupied_thresh", 0.65), ("free_thresh", 0.196))
    )
    if thresholds[1] >= thresholds[0]:
        raise root.wrong("`free_thresh` is not below `occupied_thresh`", "Mind which is which.")
    return OccupancyGrid(
        name=name or path.stem,
        resolution_m=fields["resolution"].positive(),
        origin=(x_m, y_m, yaw_rad[0] if yaw_rad else 0.0),
        pixels=_image(fields["image"], path.parent, folder or path.parent),
        negate="negate" in fields and _negate(fields["negate"]),
        thresholds=(thresholds[0], thresholds[1]),
        mode=cast(
            Literal["trinary", "scale", "raw"],
            fields["mode"].one_of(MODES) if "mode" in fields else "trinary",
        ),
    )


def write_grid(grid: OccupancyGrid, folder: Path) -> Path:
    """Write a grid into a folder, named after it; returns the path of its YAML file."""
    stem = file_names([grid.name], "")[grid.name]
    for name, content in grid_files(grid, stem).items():
        replace_file(folder / name, content)
    return folder / f"{stem}.yaml"


def grid_files(grid: OccupancyGrid, stem: str) -> dict[str, bytes]:
    """The contents of `stem`.pgm and `stem`.yaml."""
    tree: dict[str, object] = {
        "image": f"{stem}.pgm",
        "resolution": float(grid.resolution_m),
        "origin": row(grid.origin),
        "negate": int(grid.negate),
        "occupied_thresh": float(grid.thresholds[0]),
        "free_thresh": float(grid.thresholds[1]),
    }
    if grid.mode != "trinary":
        tree["mode"] = grid.mode
    return {
        f"{stem}.pgm": write_pgm(grid.pixels),
        f"{stem}.yaml": f"# {WRITER}\n{yaml_text(tree)}".encode(),
    }


def write_pgm(pixels: NDArray[np.uint8]) -> bytes:
    """pixels (height, width) as binary PGM, the first row at the top."""
    height, width = pixels.shape
    return f"P5\n# {WRITER}\n{width} {height}\n255\n".encode() + np.ascontiguousarray(pixels).tobytes()


def read_pgm(data: bytes, where: str = "") -> NDArray[np.uint8]:
    """The pixels (height, width) of a PGM image in text (P2) or binary (P5), scaled to 0..255.

    raises  TooLarge; InvalidInput if it is none, is cut off, or a pixel exceeds the announced maximum
    """
    header = HEADER.match(data)
    if header is None:
        raise InvalidInput("not a PGM image (P2 or P5)", "Save the map with map_saver again.", where)
    width, height, most = (int(header[part]) for part in (2, 3, 4))
    if width * height > MAX_PIXELS:
        raise TooLarge(
            f"{where}: {width} x {height} pixels; the limit is {MAX_PIXELS}.", "Cut it into parts."
        )
    if not (width and height and 0 < most < 65536):
        raise InvalidInput(f"a PGM image of {width} x {height}, maximum {most}", "Save it again.", where)
    count, rest = width * height, data[header.end() :]
    values = _plain_values(rest, count, where) if header[1] == b"P2" else _raw_values(rest, count, most)
    if len(values) != count:
        raise InvalidInput("the image is cut off", "Copy or save it again.", where)
    if int(values.max()) > most:
        raise InvalidInput(f"a pixel exceeds the maximum {most}", "Save it again.", where)
    if most != 255:
        values = np.round(values.astype(np.float64) * (255 / most))
    return values.astype(np.uint8).reshape(height, width)


def _raw_values(rest: bytes, count: int, most: int) -> NDArray[Any]:
    # One single white space ends the header; what follows is data, whatever it looks like.
    dtype = np.dtype("u1" if most < 256 else ">u2")
    data = rest[1 : 1 + count * dtype.itemsize]
    return np.frombuffer(data[: len(data) // dtype.itemsize * dtype.itemsize], dtype)


def _plain_values(rest: bytes, count: int, where: str) -> NDArray[Any]:
    words = re.sub(rb"#[^\n]*", b"", rest).split(maxsplit=count)[:count]
    try:
        values = np.array([int(word) for word in words], dtype=np.int64)
    except (ValueError, OverflowError) as error:
        raise InvalidInput("a pixel is no number", "Save it again.", where) from error
    if len(values) and values.min() < 0:
        raise InvalidInput("a pixel below zero", "Save it again.", where)
    return values


def _image(node: Node, folder: Path, limits: Path) -> NDArray[np.uint8]:
    path = inside(folder, node)
    if not path.resolve().is_relative_to(limits.resolve()):
        raise node.wrong("the image lies outside the folder of the map", "Copy it there.")
    if path.is_file() and path.stat().st_size > MAX_IMAGE_BYTES:
        raise TooLarge(
            f"{node.where}: the image is larger than {MAX_IMAGE_BYTES} bytes.", "Cut it into parts."
        )
    data = read_bytes(path)
    if data.startswith(b"\x89PNG"):
        return _png(data, node)
    return read_pgm(data, str(path))


def _png(data: bytes, node: Node) -> NDArray[np.uint8]:
    try:
        image = importlib.import_module("PIL.Image")
    except ImportError as error:
        raise node.wrong(
            "PNG images need pillow, which is not installed", "pip install pillow, or save the map as PGM."
        ) from error
    try:
        with image.open(io.BytesIO(data), formats=["PNG"]) as opened:
            width, height = opened.size
            if width * height > MAX_PIXELS:
                raise TooLarge(f"{node.where}: {width} x {height} pixels.", "Cut it into parts.")
            return np.array(opened.convert("L"), dtype=np.uint8)
    except (OSError, ValueError, SyntaxError) as error:
        raise node.wrong(f"the image cannot be read: {error}", "Save it again, as PGM.") from error


def _share(node: Node) -> float:
    value = node.number()
    if not 0 <= value <= 1:
        raise node.wrong(f"{node.source} is no probability", "Write a number from 0 to 1.")
    return value


def _negate(node: Node) -> bool:
    """map_server writes 0 or 1."""
    return node.truth() if isinstance(node.value, bool) else bool(node.whole())
