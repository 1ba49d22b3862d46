"""Maps on the command line: in and out, frames, where they lie, who changed them. All in one process."""

from __future__ import annotations

import getpass
import json
from collections.abc import Callable
from pathlib import Path

import pytest
import trimesh
import yaml
from semap_service import demo
from semap_service.cli import main

FOLDER = Path(demo.__file__).parent
HUT = """
map: hut
rooms:
  Den: {footprint: [[0, 0], [4, 0], [4, 3], [0, 3]], height_m: 2.5}
"""
SCHEMA = {"properties": {"seats": {"type": "integer"}}}


Semap = Callable[..., tuple[int, str, str]]


@pytest.fixture
def semap(database: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Semap:
    """Runs a command; gives its status, what it printed, and what it complained about."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["semap", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return int(ended.value.code or 0), printed.out, printed.err

    monkeypatch.setenv("SEMAP_DSN", database)
    return run


@pytest.fixture
def done(semap: Semap) -> Callable[..., str]:
    """Runs a command that must succeed; gives what it printed."""

    def run(*arguments: object) -> str:
        status, printed, complaint = semap(*arguments)
        assert status == 0, complaint
        return printed

    return run


def test_a_map_goes_out_and_comes_in(done: Callable[..., str], tmp_path: Path) -> None:
    done("map", "import", str(FOLDER / "office.geojson"))
    assert str(tmp_path / "office" / "map.yaml") in done("map", "export", "office", str(tmp_path / "office"))
    done("map", "import", str(tmp_path / "office"), "--map", "copy")
    done("map", "export", "copy", str(tmp_path / "copy" / "map.yaml"))
    first, second = ((tmp_path / name / "map.yaml").read_text() for name in ("office", "copy"))
    assert second == first.replace("map: office", "map: copy")
    assert yaml.safe_load(first)["map"] == "office"
    done("map", "export", "office", str(tmp_path / "look" / "office.glb"))
    bounds = trimesh.load_scene(tmp_path / "look" / "office.glb").bounds
    done("map", "export", "office", str(tmp_path / "office.geojson"))
    report = json.loads(done("map", "import", str(tmp_path / "office.geojson"), "--map", "third", "--json"))
    assert report["concepts"] == {"Door": 7, "Room": 6, "Storey": 1}
    assert (bounds[1] > bounds[0]).all()


def test_a_map_by_hand_is_moved_and_mended(semap: Semap, done: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "hut.yaml").write_text(HUT)
    assert "Imported into map hut: 1 Room." in done("map", "import", tmp_path / "hut.yaml")
    rows = json.loads(done("map", "history", "hut", "--json"))
    assert (rows[0]["author"], "semap map import" in rows[0]["message"]) == (getpass.getuser(), True)
    frames = json.loads(done("map", "frames", "hut", "--json"))
    assert [(each["name"], each["parent"]) for each in frames] == [("map", None), ("Den", "map")]
    assert "Den" in done("map", "frames", "hut")
    pose = json.loads(done("map", "transform", "hut", "map", "Den", "--json"))
    assert pose["qw"] == pytest.approx(1)
    done("map", "anchor", "hut", "--epsg", "25832", "--x", "434500", "--yaw-deg", "90")
    anchor = json.loads(done("map", "anchor", "hut", "--json"))
    assert (anchor["epsg"], anchor["pose"]["x_m"], anchor["pose"]["qz"]) == (
        25832,
        434500,
        pytest.approx(0.5**0.5),
    )
    newest = json.loads(done("map", "history", "hut", "--limit", "1", "--json"))[0]
    assert "--epsg 25832" in newest["message"]
    assert "is undone" in done("map", "undo", str(newest["change_set_id"]))
    status, _, complaint = semap("map", "anchor", "hut")
    assert (status, "What to do" in complaint) == (2, True)
    assert "map_anchor" in done("map", "history", "hut", "--change", str(newest["change_set_id"]))


def test_a_grid_is_a_backdrop(semap: Semap, done: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "floor.pgm").write_bytes(b"P5\n3 2\n255\n" + bytes([0, 100, 205, 254, 255, 1]))
    (tmp_path / "floor.yaml").write_text(
        "image: floor.pgm\nresolution: 0.05\norigin: [-1.5, 2.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    done("map", "create", "office")
    assert "has no grids" in done("map", "grid", "office")
    added = json.loads(done("map", "grid", "office", tmp_path / "floor.yaml", "--name", "ground", "--json"))
    assert added == [
        {"name": "ground", "width": 3, "height": 2, "resolution_m": 0.05, "origin": [-1.5, 2.0, 0.0]}
    ]
    assert semap("map", "grid", "office", "--remove", "floor")[0] == 2
    assert "has no grids" in done("map", "grid", "office", "--remove", "ground")


def test_concepts(done: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "schema.json").write_text(json.dumps(SCHEMA))
    made = done("concept", "add", "Sofa", "--parent", "Furniture", "--parent", "Chair",
                "--iri", "https://example.org/Sofa", "--schema", str(tmp_path / "schema.json"))  # fmt: skip
    assert "below Chair, Furniture" in made
    shown = json.loads(done("concept", "show", "Sofa"))
    assert (shown["iris"], shown["attribute_schema"]) == (["https://example.org/Sofa"], SCHEMA)
    assert "Sofa" in done("concept", "list")
    assert "Furniture" in {each["name"] for each in json.loads(done("concept", "list", "--json"))}


WRONG = (
    (["map", "export", "nowhere", "out"], "no map nowhere"),
    (["map", "export", "home", "out.dwg"], ".dwg"),
    (["map", "export", "home", "other.yaml"], "map.yaml"),
    (["map", "export", "home", "out.glb", "--crs", "EPSG:4326"], "--crs"),
    (["map", "export", "home", "{}/out.geojson", "--crs", "EPSG:4326"], "anchor"),
    (["map", "import", "{}/nowhere"], "nowhere"),
    (["map", "import", "{}/nowhere.yaml"], "nowhere.yaml"),
    (["map", "import", "{}/nowhere.zip"], "nowhere.zip"),
    (["map", "transform", "home", "map", "sky"], "no frame sky"),
    (["map", "transform", "home", "map", "map", "--at", "noon"], "no time"),
    (["map", "transform", "home", "map", "map", "--at", "2026-01-31T12:00:00"], "time zone"),
    (["map", "anchor", "home", "--epsg", "4326"], "metres"),
    (["map", "anchor", "home", "--epsg", "25832", "--remove"], "--remove"),
    (["map", "undo", "99"], "no change set 99"),
    (["concept", "show", "Soul"], "no concept Soul"),
    (["concept", "add", "A", "--parent", "Soul"], "no concept Soul"),
    (["concept", "add", "A", "--schema", "{}/nowhere.json"], "nowhere.json"),
)


def test_a_wrong_call_says_what_to_do(semap: Semap, done: Callable[..., str], tmp_path: Path) -> None:
    done("map", "create", "home")
    for arguments, message in WRONG:
        status, _, complaint = semap(*(each.format(tmp_path) for each in arguments))
        assert status == 2, arguments
        assert message in complaint, arguments
        assert "What to do:" in complaint, arguments
    assert [each["name"] for each in json.loads(done("map", "list", "--json"))] == ["home"]
    assert list(tmp_path.iterdir()) == []


def test_each_command_teaches(semap: Semap) -> None:
    for group, names in (
        ("map", ("import", "export", "history", "undo", "frames", "transform", "anchor")),
        ("concept", ("list", "show", "add")),
    ):
        for name in names:
            status, page, _ = semap(group, name, "--help")
            assert (status, len(page.splitlines()) > 8) == (0, True), name
