import re
import tempfile
from contextlib import suppress
from pathlib import Path
from uuid import UUID

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from map_documents import content, map_documents
from shapely import MultiPolygon, Polygon

from semap.errors import InvalidInput, NotFound, SemapError
from semap.formats import yaml_node
from semap.formats.yaml_map import read_map, write_map
from semap.formats.yaml_node import Node, parse_yaml
from semap.geometry.pose import pose_from_yaw, transform_points
from semap.model.building import HeightBand, Mesh
from semap.model.map_document import ConceptEntry, DescriptionEntry, FrameEntry, MapDocument, StampedPose
from semap.model.pose import Pose
from semap.model.source_geometry import SourceGeometry

DOCS = Path(__file__).parents[2] / "docs" / "map-format.md"
SHORT, FULL = re.findall(r"```yaml\n(.*?)```", DOCS.read_text(), re.DOTALL)


def written(tmp_path: Path, text: str) -> Path:
    (tmp_path / "map.yaml").write_text(text)
    return tmp_path


@given(map_documents())
@settings(max_examples=120, deadline=None, suppress_health_check=list(HealthCheck))
def test_a_map_written_and_read_is_the_same_map(document: MapDocument) -> None:
    with tempfile.TemporaryDirectory() as folder:
        write_map(document, Path(folder))
        found = read_map(Path(folder))
        assert content(found) == content(document)
        first = {path: path.read_bytes() for path in Path(folder).rglob("*") if path.is_file()}
        write_map(found, Path(folder))
        assert {path: path.read_bytes() for path in Path(folder).rglob("*") if path.is_file()} == first


def world_pose(document: MapDocument, name: str) -> np.ndarray:
    frames = {each.name: each for each in document.frames}
    matrix = np.eye(4)
    while name is not None:
        matrix = frames[name].poses[-1].pose.matrix() @ matrix
        name = frames[name].parent
    return matrix


def test_the_short_form_of_the_documentation(tmp_path: Path) -> None:
    document = read_map(written(tmp_path, SHORT))
    things = {each.name: each for each in document.instances}
    looks = {each.key: each for each in document.descriptions}
    assert {name: (each.concept, each.storey, each.joins) for name, each in things.items()} == {
        "ground": ("Storey", None, ()),
        "upper": ("Storey", None, ()),
        "Room07": ("Room", "ground", ()),
        "Hallway": ("Room", "ground", ()),
        "Attic": ("Room", "upper", ()),
        "D1": ("Door", "ground", ("Hallway", "Room07")),
        "D2": ("Door", "ground", ("Hallway",)),
        "Table1": ("Table", "ground", ()),
        "Table2": ("Table", "ground", ()),
        "Lamp1": ("Lamp", "ground", ()),
    }
    assert things["Room07"].alias == "kitchen"
    assert things["Lamp1"].attributes == {"watts": 7, "tags": ["desk"]}
    assert things["D1"].attributes == {"width_m": 0.9}
    assert things["D2"].attributes == {
        "width_m": pytest.approx(0.9), "height_m": 2.0, "leaf": {"hinge": "left"},
    }  # fmt: skip
    assert things["Table1"].description == things["Table2"].description == "table"
    assert [key for key, each in looks.items() if each.is_shared] == ["table"]

    body, outline = looks["instance Attic"].geometries
    assert (outline.name, outline.band) == ("Outline", HeightBand(0.0, 2.2))
    assert outline.shape == Polygon([[0, 0], [6, 0], [6, 9], [0, 9]])
    heights = transform_points(world_pose(document, "Attic"), body.shape.vertices_m)[:, 2]
    assert (heights.min(), heights.max()) == pytest.approx((2.8, 5.0))
    (box,) = looks["table"].geometries
    assert np.ptp(box.shape.vertices_m, axis=0).tolist() == [1.2, 0.8, 0.75]
    assert trimesh.Trimesh(box.shape.vertices_m, box.shape.faces).volume == pytest.approx(1.2 * 0.8 * 0.75)
    # 0.3 m along the table, which is turned by a quarter.
    assert world_pose(document, "Lamp1")[:3, 3] == pytest.approx([2, 1.3, 0.75])
    assert world_pose(document, "D2")[:3, 3] == pytest.approx([5.45, 9, 0])
    assert document.concepts == tuple(map(ConceptEntry, ("Storey", "Room", "Door", "Table", "Lamp")))
    assert [each.name for each in document.queries] == ["track_in_room"]
    assert [each.queries for each in document.rules] == [("track_in_room",)]


def test_rules_read_several_queries_objects_and_rules(tmp_path: Path) -> None:
    """A name alone is the query of that name, else whatever the map will have of it; old files name one query."""
    text = """
    map: m
    queries: {inside: {concept: Room}, near: {concept: Door}}
    rules:
      visits: {input: inside, emit: {began: came}}
      pairs: {input: [inside, door, {query: near}], pattern: A B, within: 2 s, emit: pair}
      more: {input: visits, pattern: A A, within: 2 s, emit: twice}
      doors: {input: {object_state: door}, emit: {open: opened}}
      old: {query: near, declaration: {input: near, emit: {began: came}}, enabled: false}
    """
    document = read_map(written(tmp_path, text))
    assert [(each.name, each.queries, each.enabled) for each in document.rules] == [
        ("visits", ("inside",), True), ("pairs", ("inside", "near"), True), ("more", (), True),
        ("doors", (), True), ("old", ("near",), False),
    ]  # fmt: skip
    assert document.rules[1].declaration == {
        "input": ["inside", "door", {"query": "near"}], "pattern": "A B", "within": "2 s", "emit": "pair",
    }  # fmt: skip


def test_the_full_form_of_the_documentation(tmp_path: Path) -> None:
    document = read_map(written(tmp_path, FULL))
    assert document.anchor is not None
    assert document.anchor.pose == pose_from_yaw(445534, 5444900, 210.5, np.radians(12.5))
    assert [len(each.poses) for each in document.frames] == [1, 1, 1, 2]
    assert document.frames[3].poses[1].stamp.isoformat() == "2026-01-31T12:00:00+00:00"
    assert document.instances[2].uid == UUID("6f1c1d5e-58c5-4d0a-8f43-27c4bb4f2f10")
    assert document.rules[0].declaration == {
        "input": "track_in_room",
        "emit": {"began": "entered", "ended": "left"},
    }
    assert content(read_map(write_map(document, tmp_path / "again"))) == content(document)


def test_what_is_written_by_hand_is_the_same_after_an_export(tmp_path: Path) -> None:
    document = read_map(written(tmp_path, SHORT))
    again = read_map(write_map(document, tmp_path / "again"))
    assert content(again) == content(document)


def test_a_small_edit_makes_a_small_diff(tmp_path: Path) -> None:
    document = read_map(written(tmp_path, SHORT))
    before = write_map(document, tmp_path / "a").read_text().splitlines()
    edited = SHORT.replace("at: [2, 1, 0]", "at: [2.5, 1, 0]")
    after = write_map(read_map(written(tmp_path, edited)), tmp_path / "b").read_text().splitlines()
    assert len(before) == len(after)
    assert sum(one != other for one, other in zip(before, after, strict=True)) == 1


def test_an_export_removes_what_an_earlier_one_left_and_nothing_else(tmp_path: Path) -> None:
    document = read_map(written(tmp_path, SHORT))
    write_map(document, tmp_path / "out")
    own = tmp_path / "out" / "meshes" / "mine.ply"
    own.write_text("ply\nformat ascii 1.0\n")
    meshes = {path.name for path in own.parent.iterdir()}
    write_map(MapDocument("office"), tmp_path / "out")
    assert len(meshes) == 6
    assert [path.name for path in own.parent.iterdir()] == ["mine.ply"]


def test_mesh_files_keep_their_unit_and_axis(tmp_path: Path) -> None:
    box = trimesh.creation.box(extents=(1000, 200, 500))
    (tmp_path / "meshes").mkdir()
    box.export(tmp_path / "meshes" / "table.glb")
    text = "map: m\nblueprints: {table: {mesh: meshes/table.glb, unit: mm, up: y}}\n"
    (source,) = read_map(written(tmp_path, text)).descriptions[0].geometries
    assert np.ptp(source.shape.vertices_m, axis=0) == pytest.approx([1, 0.5, 0.2])


def test_areas_with_holes_and_parts(tmp_path: Path) -> None:
    ring, hole, far = "[[0,0],[9,0],[9,9],[0,9],[0,0]]", "[[1,1],[2,1],[2,2]]", "[[20,0],[21,0],[21,1]]"
    text = f"map: m\nrooms:\n  a: {{footprint: [{ring}, {hole}]}}\n  b: {{footprint: [[{ring}, {hole}], [{far}]]}}\n"
    one, two = (each.geometries[0].shape for each in read_map(written(tmp_path, text)).descriptions)
    assert isinstance(one, Polygon)
    assert isinstance(two, MultiPolygon)
    assert (one.area, two.area) == (80.5, 81.0)


def test_plain_words_are_texts(tmp_path: Path) -> None:
    text = "map: 2026-01-31\nthings:\n  no: {concept: on, alias: 12:30, attributes: {a: no, b: 1e3, c: 010, d: ~}}\n"
    document = read_map(written(tmp_path, text))
    (thing,) = document.instances
    assert (document.name, thing.name, thing.concept, thing.alias) == ("2026-01-31", "no", "on", "12:30")
    assert thing.attributes == {"a": "no", "b": 1000.0, "c": 10, "d": None}


THING = "map: m\nthings:\n  t: {concept: Table, %s}\n"


@pytest.mark.parametrize(
    ("text", "message", "remedy"),
    [
        ("map: m\n§dors: {}\n", "no key 'dors'", '`doors`'),
        (THING % "§colour: red", "no key 'colour'", "The keys here are"),
        ("map: m\ndoors: {d: {§widht_m: 1}}\n", "no key 'widht_m'", "`width_m`"),
        ("map: m\n§map: n\n", "twice", "another name"),
        ("map: m\nthings:\n  t: §{at: [0, 0]}\n", "`concept` is missing", "concept: Table"),
        (THING % "at: §[1]", "a list of 1", "2 to 3"),
        (THING % "at: [1, §x]", "x is not a number", "2.5"),
        (THING % "at: [1, §.nan]", "not finite", "finite"),
        (THING % "on: §chair", "no frame 'chair'", 'Add it'),
        (THING % "blueprint: §tabel}\nblueprints: {table: {box: [1, 1, 1]}", "no description 'tabel'", "'table'"),
        ("map: m\nthings:\n  t: §{concept: Table, on: t}\n", "stands in itself", "another parent"),
        (THING % "footprint: §[[0, 0], [2, 2], [2, 0], [0, 2]]", "crosses itself", "once around"),
        (THING % "footprint: §[[0, 0], [2, 2]]", "list of 2", "3 or more"),
        (THING % "footprint: §7", "list of points", "[4, 0]"),
        (THING % "height_m: §2", "without `footprint`", "outline"),
        (THING % "box: [1, §0, 1]", "not above zero", "greater"),
        (THING % "box: [1, 1, 1], mesh: §x.ply", "both `box` and `mesh`", "Keep one"),
        (THING % "mesh: §../x.ply", "leaves the folder", "beside map.yaml"),
        (THING % "mesh: §/etc/passwd", "leaves the folder", "beside map.yaml"),
        (THING % "mesh: §'C:\\x.ply'", 'leaves the folder', 'beside map.yaml'),
        (THING % "yaw_deg: 9, quaternion: §[0, 0, 0, 1]", "both", "Keep one"),
        (THING % "quaternion: §[0, 0, 0, 0]", "without length", "[0, 0, 0, 1]"),
        (THING % "uid: §7", "not a UUID", "Leave it out"),
        (THING % "attributes: {a: §.inf}", "not finite", "finite"),
        (THING % "alias: §!!python/name:os.system x", "tag", "without tags"),
        (THING % "alias: §!secret x", "tag", "without tags"),
        (THING % "alias: [a§", "not YAML", "brackets|quotes"),
        ("map: m\nrooms: {t: {}}\nthings: {t: §{concept: A}}\n", "already, at", "another name"),
        ("map: m\ndoors: {d: {between: §[a, b, c]}}\n", "a list of 3", "1 to 2"),
        ("map: m\ndoors: {d: {between: [§Hall]}}\nrooms: {hall: {}}\n", "no instance 'Hall'", "'hall'"),
        ("map: m\ninstances: {i: §{concept: A}}\n", "`frame` is missing", "things"),
        ("map: m\nframes: {a: §{parent: b}, b: {parent: a}}\n", "stands in itself", "another parent"),
        ("map: m\nanchor: {epsg: §7}\n", "no EPSG code", "1024"),
        ("map: m\nrules: {r: {input: §q, emit: {}}}\n", "no query 'q'", 'Add it'),
        ("map: m\ndescriptions: {d: {geometries: {g: {type: §CUBE}}}}\n", "'CUBE'", 'POINT2D'),
        ("map: m\ndescriptions: {d: {geometries: {g: {type: POINT2D, z_m: §[0, 1]}}}}\n", "no heights", "POLYGON2D"),
        ("map: m\ndescriptions: {d: {geometries: {g: §{type: POLYGON2D}}}}\n", "`polygon` is missing", "needs it"),
        ("map: m\nframes: {a: {poses: [{stamp: §2026-01-31}]}}\n", "no stamp", "2026-01-31T12:00:00Z"),
        (f"map: m\nrooms:\n  ? {201 * 'x'}\n  : §{{}}\n", "a name of 201 characters", "at most 200"),
        (f"map: m\nthings: {{a: §{{concept: {201 * 'x'}}}}}\n", "a name of 201 characters", "at most 200"),
        (f"map: m\nframes: {{f: {{}}}}\ninstances: {{a: {{frame: f, concept: §{201 * 'x'}}}}}\n", "a name of 201", "at most 200"),
        ("semap_map: §2\nmap: m\n", "version 2", "version 1"),
        ("§cell_m: 2\n", "`map` is missing", "map: NAME"),
        ("§- map\n", "a mapping is needed", "key: value"),
        ("map: m\n§---\nb: 2\n", "a second document", "Give one"),
        ('map: §"a\\0b"\n', 'NUL', 'Remove'),
        ("", "empty", ""),
        ("# nothing\n", "says nothing", "map: NAME"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_its_place_and_a_remedy(
    tmp_path: Path, text: str, message: str, remedy: str
) -> None:
    with pytest.raises(InvalidInput) as refusal:
        read_map(written(tmp_path, text.replace("§", "")))
    assert message in str(refusal.value)
    assert re.search(remedy if "|" in remedy else re.escape(remedy), refusal.value.remedy)
    before, mark, _ = text.partition("§")
    line, column = before.count("\n") + 1, len(before) - before.rfind("\n")
    assert refusal.value.where == f"{tmp_path / 'map.yaml'}" + (f":{line}:{column}" if mark else "")


def test_links_that_leave_the_folder_are_not_followed(tmp_path: Path) -> None:
    (tmp_path / "map").mkdir()
    (tmp_path / "secret.ply").write_bytes(b"ply")
    (tmp_path / "map" / "link.ply").symlink_to(tmp_path / "secret.ply")
    with pytest.raises(InvalidInput, match="leaves the folder"):
        read_map(written(tmp_path / "map", THING % "mesh: link.ply"))


def test_a_missing_map_or_mesh_is_not_found(tmp_path: Path) -> None:
    with pytest.raises(NotFound):
        read_map(tmp_path)
    with pytest.raises(NotFound):
        read_map(written(tmp_path, THING % "mesh: x.ply"))


def test_a_mesh_that_was_cut_off_is_refused(tmp_path: Path) -> None:
    mesh = Mesh(np.eye(3), np.array([[0, 1, 2]]))
    document = MapDocument(
        "m", descriptions=(DescriptionEntry("d", (SourceGeometry("Body", "TRIANGLEMESH3D", mesh),)),)
    )
    write_map(document, tmp_path)
    (path,) = (tmp_path / "meshes").iterdir()
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(InvalidInput, match=r"map.yaml:\d+:\d+: .*cut off"):
        read_map(tmp_path)


def test_a_large_file_that_is_no_yaml_near_its_end_makes_no_nodes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = ["map: m", "things:", *(f"  thing {n}: {{alias: thing}}" for n in range(40_000)), "  last: [1, 2"]
    (tmp_path / "map.yaml").write_text("\n".join(lines))
    made: list[Node] = []
    monkeypatch.setattr(yaml_node, "Node", lambda *parts: made.append(Node(*parts)) or made[-1])
    with pytest.raises(InvalidInput, match=r"map.yaml:\d+:\d+: not YAML: did not find expected ',' or ']'"):
        read_map(tmp_path)
    assert not made


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("map: m\nfoo: 1\n", ":2:1: there is no key 'foo'"),
        ("map: m\nrooms: [1, 2\n", ":2:8: a mapping is needed here"),
        ("map: m\nrooms:\n  a: {hight_m: 2}\n", ":3:7: there is no key 'hight_m'"),
        ("map: m\nmap: m\n", ":2:1: the key 'map' is there twice"),
        ("- map\n", ":1:1: a mapping is needed here"),
    ],
)
def test_a_wrong_file_is_refused_where_it_goes_wrong_and_not_read_to_its_end(
    tmp_path: Path, text: str, message: str
) -> None:
    # what follows is no YAML at all, which a reader of the whole file would have to say first
    with pytest.raises(InvalidInput, match=message):
        read_map(written(tmp_path, text + "\n}]: @\n"))


def test_all_that_is_wrong_is_told_at_once(tmp_path: Path) -> None:
    text = "map: m\nrooms:\n  a: {hight_m: 2, uid: 7}\n  b: {height_m: low}\n  a: {}\n  c: 3\n"
    file = tmp_path / "map.yaml"
    with pytest.raises(InvalidInput) as refusal:
        read_map(written(tmp_path, text))
    assert str(refusal.value).splitlines() == [
        f"{file}: 5 places are wrong:",
        f"  {file}:3:7: there is no key 'hight_m' here",
        f"  {file}:3:24: '7' is not a UUID",
        f"  {file}:4:17: low is not a number",
        f"  {file}:5:3: the key 'a' is there twice (before: {file}:3:3)",
        f"  {file}:6:6: a mapping is needed here",
    ]


def test_a_file_of_another_kind_is_not_read_to_its_end(tmp_path: Path) -> None:
    keys = "".join(f"key {n}: 1\n" for n in range(100))
    with pytest.raises(InvalidInput) as refusal:
        # what follows is no YAML at all
        read_map(written(tmp_path, keys + "}]: @\n"))
    first, *lines = str(refusal.value).splitlines()
    assert first == f"{tmp_path / 'map.yaml'}: 20 places at least are wrong:"
    assert lines == [
        f"  {tmp_path / 'map.yaml'}:{n + 1}:1: there is no key 'key {n}' here" for n in range(20)
    ]


def test_all_entries_and_names_that_are_wrong_are_told_at_once(tmp_path: Path) -> None:
    file = tmp_path / "map.yaml"
    bent = "".join(f"  r{n:02}: {{footprint: [[0, 0], [2, 2], [2, 0], [0, 2]]}}\n" for n in range(25))
    with pytest.raises(InvalidInput) as refusal:
        read_map(written(tmp_path, f"map: m\nthings:\n  t: {{}}\nrooms:\n{bent}"))
    first, *lines, last = str(refusal.value).splitlines()
    assert (first, last) == (f"{file}: 26 entries are wrong:", "  and 6 more")
    assert lines[0] == f"  {file}:3:6: `concept` is missing"
    assert [line.split(": ")[0] for line in lines[1:]] == [f"  {file}:{5 + n}:20" for n in range(19)]
    doors = "doors:\n  d: {between: [hal, kitchen]}\n  e: {between: [hall, bath]}\n"
    with pytest.raises(InvalidInput) as refusal:
        read_map(written(tmp_path, f"map: m\nrooms: {{hall: {{}}}}\n{doors}"))
    assert str(refusal.value).splitlines() == [
        f"{file}: 3 names are wrong:",
        f"  {file}:4:17: there is no instance 'hal' on this map",
        f"  {file}:4:22: there is no instance 'kitchen' on this map",
        f"  {file}:5:23: there is no instance 'bath' on this map",
    ]


@pytest.mark.parametrize(
    ("last", "message"),
    [
        ("  last: {hieght_m: 2}", "no key 'hieght_m'"),
        ("  last: [1, 2]", "a mapping is needed"),
        ("  last: {height_m: high}", "high is not a number"),
        ("  room 0: {}", "is there twice"),
        ("  last: {uid: x}", "not a UUID"),
        ("romos: {}", "no key 'romos'"),
        ("semap_map: 9", "version 9"),
        ("instances: {i: {colour: red}}", "no key 'colour'"),
        ("  last: {footprint: [[0, 0], [4, 3], [4, 0], [0, 3]]}", "crosses itself"),
        ("  last: {footprint: [[0, 0], [4, 0]]}", "3 or more are needed"),
        ("  last: {footprint: [[0, 0], [4, 0], [.nan, 3]]}", ".nan is not finite"),
        ("doors: {d: {between: [room 1, rom 1]}}", "no instance 'rom 1'"),
        ("things: {t: {concept: A, 'on': 7}}", "no frame '7'"),
    ],
)
def test_a_large_file_that_is_wrong_near_its_end_is_refused_before_its_lists_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, last: str, message: str
) -> None:
    outline = "[[0, 0], [4, 0], [4, 3], [0, 3]]"
    lines = ["map: m", "rooms:", *(f"  room {n}: {{footprint: {outline}}}" for n in range(20_000)), last]
    made: list[Node] = []
    monkeypatch.setattr(yaml_node, "Node", lambda *parts: made.append(Node(*parts)) or made[-1])
    with pytest.raises(InvalidInput, match=rf"map.yaml:20003:\d+: .*{message}"):
        read_map(written(tmp_path, "\n".join(lines)))
    # an entry and its outline: the points would be thirteen more
    assert len(made) < 3 * 20_000


@given(st.text("[]{}:, 12e-\n'\"a#|&*\ue000\ue003", max_size=40), st.booleans())
@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
def test_a_large_file_is_read_as_a_small_one(text: str, is_attribute: bool) -> None:
    head = "map: m\nthings:\n  t:\n    concept: A\n    "
    text = head + (f"attributes: {{k: {text}}}\n" if is_attribute else f"{text}\n")

    def read(limit: int) -> object:
        with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
            patch.setattr(yaml_node, "LARGE_BYTES", limit)
            (Path(folder) / "map.yaml").write_text(text)
            try:
                return content(read_map(Path(folder)))
            except InvalidInput:
                return None

    assert read(0) == read(10**9)


POINTS = st.sampled_from(
    ["[0, 0]", "[4, 0]", "[4., 3]", "[.5, +3e0]", "[0, 1e999]", "[0, 01]", "[1, 2, 3]", "[]"]
)
NAMES = st.sampled_from(["r0", "r1", "1", "2", "nowhere"])


@st.composite
def outlines(draw: st.DrawFn) -> str:
    def listed(parts: st.SearchStrategy[str], least: int, most: int) -> st.SearchStrategy[str]:
        return st.lists(parts, min_size=least, max_size=most).map(lambda each: f"[{', '.join(each)}]")

    square = st.sampled_from(
        ["[[0, 0], [4, 0], [4, 3], [0, 3]]", "[[1, 1], [2, 1], [2, 2]]", "[[6, 0], [9, 0], [9, 4]]"]
    )
    ring = st.one_of(square, square, listed(POINTS, 0, 5))
    rings = listed(ring, 1, 2)
    return draw(
        st.one_of(ring, rings, listed(rings, 1, 2), st.just("[[0, 0], [4, .nan], [4, 3]]"), st.just("7"))
    )


@given(st.lists(outlines(), min_size=1, max_size=3), st.lists(NAMES, min_size=1, max_size=2), NAMES, NAMES)
@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
def test_what_is_told_early_of_a_large_file_is_what_is_told_of_a_small_one(
    areas: list[str], between: list[str], storey: str, parent: str
) -> None:
    rooms = "".join(f"  r{n}: {{footprint: {area}, storey: {storey}}}\n" for n, area in enumerate(areas))
    things = f"things:\n  1: {{concept: A, 'on': {parent}, joins: [{', '.join(between)}]}}\n"
    full = f"frames: {{map: {{}}, f: {{parent: {parent}}}}}\n"
    door = f"doors: {{2: {{between: [{', '.join(between)}]}}}}\n"

    def told(limit: int) -> object:
        with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
            patch.setattr(yaml_node, "LARGE_BYTES", limit)
            (Path(folder) / "map.yaml").write_text(f"map: m\n{full}rooms:\n{rooms}{door}{things}")
            try:
                return content(read_map(Path(folder)))
            except InvalidInput as error:
                return str(error).replace(folder, "")

    assert told(0) == told(10**9)


def test_aliases_repeat_a_little_and_bombs_are_refused() -> None:
    assert parse_yaml(b"a: &a {x: 1}\nb: *a\n", "f").json() == {"a": {"x": 1}, "b": {"x": 1}}
    bomb = "a0: &a0 [1]\n" + "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 12))
    for text in (bomb, "a: &a [*a]\n", "a: " + "[" * 200 + "]" * 200, "a: " + "[" * 5000 + "]" * 5000):
        with pytest.raises(InvalidInput):
            parse_yaml(text.encode(), "f")


@given(st.one_of(st.binary(max_size=60), st.text(max_size=60).map(str.encode)))
@settings(max_examples=300, deadline=None)
def test_any_bytes_are_yaml_or_refused(data: bytes) -> None:
    with suppress(InvalidInput):
        parse_yaml(data, "f").json()


@given(st.integers(0, 10_000), st.text("[]{}:,&*!-# \n\"'0aé\0", max_size=3))
@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
def test_a_damaged_map_is_read_or_refused(place: int, damage: str) -> None:
    for text in (SHORT, FULL):
        at = place % len(text)
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "map.yaml").write_text(text[:at] + damage + text[at + 1 :])
            with suppress(SemapError):
                read_map(Path(folder))


def test_poses_keep_every_bit(tmp_path: Path) -> None:
    pose = Pose(0.1 + 0.2, -0.0, 5e-324, 0.1, 0.2, 0.3, 0.9273618495495703)
    document = MapDocument(
        "m", frames=(FrameEntry("map", None), FrameEntry("f", "map", (StampedPose(pose),)))
    )
    assert content(read_map(write_map(document, tmp_path)).frames) == content(document.frames)
