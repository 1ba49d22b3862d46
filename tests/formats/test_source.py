"""Files that are no UTF-8: what they are is said, in whatever format they were to be."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from semap.errors import InvalidInput
from semap.formats import read_building, read_map
from semap.formats.mesh_file import read_mesh_file

ROOM = {
    "type": "Feature",
    "properties": {"name": "Küche"},
    "geometry": {"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 3], [0, 0]]]},
}
PLAN = json.dumps({"type": "FeatureCollection", "features": [ROOM]}, ensure_ascii=False)
TEXTS = {
    "plan.geojson": PLAN,
    "map.yaml": "map: Küche\n",
    "model.ifc": "ISO-10303-21;\nEND-ISO-10303-21;\n",
}


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.parametrize("codec", ["utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-32-le", "utf-32-be"])
def test_utf_16_and_32_are_named(tmp_path: Path, name: str, codec: str) -> None:
    path = tmp_path / name
    path.write_bytes(TEXTS[name].encode(codec))
    read = read_map if name == "map.yaml" else read_building
    with pytest.raises(InvalidInput) as refusal:
        read(path)
    assert str(refusal.value) == f"{path}: this file is {codec[:6].upper()}, and UTF-8 is needed"
    assert f"iconv -f {codec[:6].upper()} -t UTF-8" in refusal.value.remedy


@pytest.mark.parametrize("name", ["plan.geojson", "map.yaml"])
def test_other_encodings_are_refused_with_the_line(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"\n\n" + TEXTS[name].encode("latin-1"))
    with pytest.raises(InvalidInput, match=r":3: this is not UTF-8"):
        (read_map if name == "map.yaml" else read_building)(path)


def test_a_byte_order_mark_of_utf_8_is_no_matter(tmp_path: Path) -> None:
    path = tmp_path / "plan.geojson"
    path.write_bytes(PLAN.encode("utf-8-sig"))
    assert [item.name for item in read_building(path).items] == ["Küche"]


def test_xml_says_its_encoding_itself(tmp_path: Path) -> None:
    path = tmp_path / "house.gml"
    path.write_bytes('<?xml version="1.0" encoding="UTF-16"?><a/>'.encode("utf-16"))
    with pytest.raises(InvalidInput, match="not an IndoorGML file"):
        read_building(path)


def test_meshes_in_text_are_named_too() -> None:
    with pytest.raises(InvalidInput, match="the obj file: this file is UTF-16"):
        read_mesh_file("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".encode("utf-16"), "obj")
