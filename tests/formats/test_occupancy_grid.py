import importlib
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from semap.errors import InvalidInput, NotFound, TooLarge
from semap.formats.occupancy_grid import read_grid, read_pgm, write_grid, write_pgm
from semap.model.map_document import OccupancyGrid

YAML = """image: office.pgm
resolution: 0.050000
origin: [-10.000000, -12.5, 0.1]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196

"""
PIXELS = np.array([[0, 205, 254], [100, 7, 255]], dtype=np.uint8)


def folder(tmp_path: Path, yaml: str = YAML, image: bytes | None = None, name: str = "office.pgm") -> Path:
    (tmp_path / name).write_bytes(write_pgm(PIXELS) if image is None else image)
    (tmp_path / "office.yaml").write_text(yaml)
    return tmp_path / "office.yaml"


def test_what_map_server_writes_is_read(tmp_path: Path) -> None:
    grid = read_grid(folder(tmp_path))
    assert (grid.name, grid.resolution_m, grid.origin) == ("office", 0.05, (-10.0, -12.5, 0.1))
    assert (grid.negate, grid.thresholds, grid.mode) == (False, (0.65, 0.196), "trinary")
    assert np.array_equal(grid.pixels, PIXELS)


def test_a_grid_written_and_read_is_the_same(tmp_path: Path) -> None:
    grid = OccupancyGrid("Erdgeschoß / west", 0.025, (1.5, -2.25, 3.0), PIXELS, True, (0.7, 0.2), "scale")
    found = read_grid(write_grid(grid, tmp_path), grid.name)
    assert np.array_equal(found.pixels, grid.pixels)
    assert {k: v for k, v in vars(found).items() if k != "pixels"} == {k: v for k, v in vars(grid).items() if k != "pixels"}  # fmt: skip


@pytest.mark.parametrize(
    ("image", "expected"),
    [
        (b"P2\n3 2\n255\n0 205 254\n100 7 255\n", PIXELS),
        (b"P2 # map\n# CREATOR: map_saver\n3 # wide\n2 255\n0 205 254 # row\n100\n7\t255", PIXELS),
        (b"P5\n# CREATOR: gmapping 0.050 m/pix\n3 2\n255\n" + PIXELS.tobytes(), PIXELS),
        (b"P5 3 2 255 " + PIXELS.tobytes() + b"\ntrailing", PIXELS),
        (b"P5\n3 2\n65535\n" + (PIXELS.astype(">u2") * 257).tobytes(), PIXELS),
        (b"P2\n2 1\n4\n0 4\n", np.array([[0, 255]])),
        (b"P5\n2 1\n1\n\0\1", np.array([[0, 255]])),
        # A pixel that looks like white space or a comment belongs to the image.
        (b"P5\n3 1\n255\n\n# ", np.array([[10, 35, 32]])),
    ],
)
def test_every_kind_of_pgm_is_read(image: bytes, expected: np.ndarray) -> None:
    found = read_pgm(image)
    assert found.dtype == np.uint8
    assert np.array_equal(found, expected)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (b"P6\n1 1\n255\n\0\0\0", "not a PGM"),
        (b"P5\n3 2\n255\n\0\0", "cut off"),
        (b"P2\n3 2\n255\n1 2 3", "cut off"),
        (b"P2\n2 1\n255\n1 x", "no number"),
        (b"P2\n2 1\n255\n1 -1", "below zero"),
        (b"P2\n2 1\n255\n1 256", "exceeds"),
        (b"P5\n2 1\n99\n\0\x64", "exceeds"),
        (b"P5\n0 1\n255\n", "0 x 1"),
        (b"P5\n1 1\n65536\n\0\0", "65536"),
        (b"P5\n1 1\n0\n\0", "maximum 0"),
    ],
)
def test_a_bad_image_is_refused(tmp_path: Path, image: bytes, message: str) -> None:
    with pytest.raises(InvalidInput, match=message) as refusal:
        read_grid(folder(tmp_path, image=image))
    assert refusal.value.where == str(tmp_path / "office.pgm")
    assert refusal.value.remedy


def test_an_announced_size_beyond_the_limit_is_refused() -> None:
    with pytest.raises(TooLarge):
        read_pgm(b"P5\n99999999 99999999\n255\n")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("image: office.pgm", "image: ../office.pgm", "leaves the folder"),
        ("image: office.pgm", "image: /srv/office.pgm", "leaves the folder"),
        ("image: office.pgm\n", "", "`image` is missing"),
        ("0.050000", "0", "not above zero"),
        ("0.65", "1.5", "no probability"),
        ("0.65", "0.1", "not below"),
        ("[-10.000000, -12.5, 0.1]", "[1]", "a list of 1"),
        ("negate: 0", "negate: maybe", "not a whole number"),
        ("negate: 0", "mode: quaternary", "not known"),
        ("negate: 0", "nagate: 0", "no key 'nagate'"),
    ],
)
def test_a_bad_description_is_refused_with_its_place(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    with pytest.raises(InvalidInput, match=message) as refusal:
        read_grid(folder(tmp_path, YAML.replace(old, new)))
    assert refusal.value.where.startswith(f"{tmp_path / 'office.yaml'}:")


def test_a_missing_image_is_not_found(tmp_path: Path) -> None:
    path = folder(tmp_path)
    (tmp_path / "office.pgm").unlink()
    with pytest.raises(NotFound):
        read_grid(path)


def png(pixels: np.ndarray) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    height, width = pixels.shape
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )


def test_png_is_read_where_pillow_is_installed(tmp_path: Path) -> None:
    path = folder(tmp_path, YAML.replace(".pgm", ".png"), png(PIXELS), "office.png")
    assert np.array_equal(read_grid(path).pixels, PIXELS)


def test_without_pillow_a_png_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(name: str, package: str | None = None) -> object:
        raise ModuleNotFoundError(name)

    path = folder(tmp_path, YAML.replace(".pgm", ".png"), png(PIXELS), "office.png")
    monkeypatch.setattr(importlib, "import_module", refuse)
    with pytest.raises(InvalidInput, match="pillow") as refusal:
        read_grid(path)
    assert "PGM" in refusal.value.remedy


@given(st.binary(max_size=40).map(lambda data: b"P5\n2 2\n255\n" + data) | st.binary(max_size=60))
@settings(max_examples=300, deadline=None)
def test_any_bytes_are_an_image_or_refused(data: bytes) -> None:
    try:
        pixels = read_pgm(data)
    except (InvalidInput, TooLarge):
        return
    assert pixels.dtype == np.uint8
