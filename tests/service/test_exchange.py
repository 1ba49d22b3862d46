"""Maps as files, in and out; and where on the earth they lie."""

import io
import json
import stat
import zipfile
from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh
from running import Service, box_mesh
from semap_service import demo
from semap_service.exchange.zip_archive import pack, unpack
from shapely.geometry import shape

from semap.errors import InvalidInput, TooLarge

OFFICE = Path(demo.__file__).parent / "office.geojson"
UTM32 = {"epsg": 25832, "pose": {"x_m": 500_000, "y_m": 5_600_000}}


def bring(service: Service, file: str, data: bytes, **parameters: object):
    return service.client.post("/maps/import", files={"file": (file, data)}, params=parameters)


def zipped(files: dict[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return stream.getvalue()


def unzipped(data: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_a_map_goes_out_and_comes_in_without_loss(service: Service) -> None:
    report = bring(service, "office.geojson", OFFICE.read_bytes())
    assert report.status_code == 201, report.text
    assert report.json()["concepts"] == {"Door": 7, "Room": 6, "Storey": 1}
    assert report.headers["location"] == "/maps/office"
    mesh = ("a.stl", box_mesh(1, 2, 3, "stl"))
    service.post_instance({"name": "crate", "concept": "Thing", "pose": {"x_m": 1 / 3}}, mesh)
    service.client.put("/maps/office/anchor", json=UTM32).raise_for_status()
    first = service.client.get("/maps/office/export")
    assert "office.zip" in first.headers["content-disposition"]
    assert "map.yaml" in unzipped(first.content)
    copied = bring(service, "office.zip", first.content, name="copy")
    assert copied.json()["concepts"] == {"Door": 7, "Room": 6, "Storey": 1, "Thing": 1}
    second = unzipped(service.client.get("/maps/copy/export").content)
    expected = unzipped(first.content)
    assert second.pop("map.yaml") == expected.pop("map.yaml").replace(b"map: office", b"map: copy")
    assert second == expected
    again = bring(service, "office.zip", first.content)
    assert again.status_code == 409
    wrapped = zipped({f"office/{name}": data for name, data in unzipped(first.content).items()})
    assert bring(service, "o.zip", wrapped, name="third").status_code == 201


def test_a_map_that_a_person_wrote(service: Service) -> None:
    text = b"map: hut\nrooms:\n  Den: {footprint: [[0, 0], [4, 0], [4, 3], [0, 3]], height_m: 2.5}\n"
    assert bring(service, "hut.yaml", text).json()["map"] == "hut"
    (den,) = service.get("/rooms", map="hut")["rooms"]
    assert shape(service.get(f"/rooms/{den['id']}")["footprint"]).equals(shapely.box(0, 0, 4, 3))
    wrong = bring(service, "hut.yaml", b"map: other\nrooms:\n  Den: {hight_m: 2}\n")
    assert wrong.status_code == 422
    assert "hut.yaml" in wrong.json()["detail"]
    assert "tmp" not in wrong.text
    for name, data in (
        ("a.zip", b"PK nonsense"),
        ("a.zip", zipped({"x.txt": b""})),
        ("a.txt", b""),
        ("a", b""),
        ("a." + "x" * 300, b""),
        ("a.yaml", b"map: a/b\n"),
        ("a.geojson", b"{"),
        ("a.yaml", b"map: a\nblueprints: {t: {mesh: meshes/t.ply}}\n"),
        ("a.yaml", b"map: a\nblueprints: {t: {mesh: ../../../etc/passwd}}\n"),
    ):
        refused = bring(service, name, data)
        assert (refused.status_code, bool(refused.json()["remedy"])) == (422, True), (name, refused.text)
    assert [each["name"] for each in service.get("/maps")["maps"]] == ["hut"]


def test_what_it_looks_like(service: Service) -> None:
    service.make_map()
    service.make_room("hall", shapely.box(1, 0, 3, 1), height_m=2)
    glb = service.client.get("/maps/office/export", params={"format": "glb"})
    scene = trimesh.load_scene(io.BytesIO(glb.content), file_type="glb")
    assert scene.bounds.ravel() == pytest.approx([1, 0, -1, 3, 2, 0])
    geojson = service.client.get("/maps/office/export", params={"format": "geojson"})
    (feature,) = json.loads(geojson.content)["features"]
    assert shape(feature["geometry"]).equals(shapely.box(1, 0, 3, 1))
    back = bring(service, "again.geojson", geojson.content)
    assert back.json()["concepts"] == {"Room": 1}
    assert service.client.get("/maps/nowhere/export").status_code == 404
    assert service.client.get("/maps/office/export", params={"format": "dwg"}).status_code == 422


def test_where_on_the_earth(service: Service) -> None:
    service.make_map()
    hall = service.make_room("hall", shapely.box(1, 0, 3, 1), height_m=2)
    where = f"/instances/{hall['id']}"
    adrift = service.client.get(where, params={"crs": "EPSG:25832"})
    assert (adrift.status_code, "anchor" in adrift.json()["remedy"]) == (409, True)
    assert service.client.get("/maps/office/anchor").status_code == 404
    half = np.sqrt(0.5)
    turned = {"epsg": 25832, "pose": {**UTM32["pose"], "qz": half, "qw": half}}
    put = service.client.put("/maps/office/anchor", json=turned).json()
    assert service.get("/maps/office/anchor") == put
    assert put["pose"] == {
        "z_m": 0,
        "qx": 0,
        "qy": 0,
        **{key: pytest.approx(value) for key, value in turned["pose"].items()},
    }
    placed = service.get(where, crs="EPSG:25832")
    expected = shapely.box(499_999, 5_600_001, 500_000, 5_600_003)
    assert placed["crs"] == "EPSG:25832"
    assert shape(placed["footprint"]).symmetric_difference(expected).area < 1e-6
    assert service.get(where)["footprint"] == hall["footprint"]
    assert service.get(f"/rooms/{hall['id']}", crs="EPSG:25832") == {**placed, "occupants": 0}
    hull = service.get(f"{where}/abstractions/FootprintHull", crs="EPSG:25832")
    assert shape(hull["geometry"]).symmetric_difference(expected).area < 1e-6
    solid = service.get(f"{where}/abstractions/BoundingBox", crs="EPSG:25832")["geometry"]["vertices_m"]
    assert np.ptp(solid, axis=0) == pytest.approx([1, 2, 2])
    # the central meridian of zone 32 is 9 degrees east
    lonlat = service.client.get(
        "/maps/office/export", params={"format": "geojson", "crs": "EPSG:4326"}
    ).json()
    assert shape(lonlat["features"][0]["geometry"]).centroid.x == pytest.approx(9, abs=1e-4)
    assert shape(lonlat["features"][0]["geometry"]).centroid.y == pytest.approx(50.5505, abs=1e-2)
    assert "crs" not in lonlat
    for path, crs in ((where, "EPSG:9999"), (where, "utm"), ("/maps/office/export", "EPSG:4326")):
        assert service.client.get(path, params={"crs": crs}).status_code == 422, (path, crs)
    for epsg in (4326, 9999, 1):
        assert service.client.put("/maps/office/anchor", json={"epsg": epsg}).status_code == 422
    assert service.client.delete("/maps/office/anchor").status_code == 204
    assert service.client.delete("/maps/office/anchor").status_code == 404


def test_an_archive_comes_back(tmp_path: Path) -> None:
    (tmp_path / "a" / "meshes").mkdir(parents=True)
    (tmp_path / "a" / "map.yaml").write_text("map: a")
    (tmp_path / "a" / "meshes" / "b.ply").write_bytes(bytes(range(256)))
    pack(tmp_path / "a", tmp_path / "a.zip")
    unpack(tmp_path / "a.zip", tmp_path / "b")
    assert (tmp_path / "b" / "map.yaml").read_text() == "map: a"
    assert (tmp_path / "b" / "meshes" / "b.ply").read_bytes() == bytes(range(256))


def test_an_archive_that_expands_too_far(tmp_path: Path) -> None:
    bomb = tmp_path / "bomb.zip"
    bomb.write_bytes(zipped({"map.yaml": b"\0" * 10_000_000}))
    assert bomb.stat().st_size < 20_000
    with pytest.raises(TooLarge):
        unpack(bomb, tmp_path / "out", max_bytes=9_999_999)
    unpack(bomb, tmp_path / "out2", max_bytes=10_000_000)
    many = tmp_path / "many.zip"
    many.write_bytes(zipped({str(number): b"" for number in range(10_001)}))
    with pytest.raises(TooLarge):
        unpack(many, tmp_path / "out3")


@pytest.mark.parametrize("name", ["../x", "/x", "a/../../x", "c:x", "a\\..\\x"])
def test_an_archive_that_leaves_its_folder(tmp_path: Path, name: str) -> None:
    path = tmp_path / "a.zip"
    path.write_bytes(zipped({name: b"x"}))
    with pytest.raises(InvalidInput):
        unpack(path, tmp_path / "deep" / "out")
    assert [each.name for each in tmp_path.rglob("*") if each.is_file()] == ["a.zip"]


def test_an_archive_with_a_link_or_a_lie(tmp_path: Path) -> None:
    link = zipfile.ZipInfo("link")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(link, "/etc/passwd")
    with pytest.raises(InvalidInput):
        unpack(path, tmp_path / "out")
    data = bytearray(zipped({"a": b"x" * 1000}))
    data[data.index(b"PK\x01\x02") + 8] |= 1  # encrypted, says the directory
    path.write_bytes(data)
    with pytest.raises(InvalidInput):
        unpack(path, tmp_path / "out")
    path.write_bytes(zipped({"a": b"x", "a/b": b"x"}))
    with pytest.raises(InvalidInput):
        unpack(path, tmp_path / "out")
