"""Random maps, and their comparison field by field and bit by bit."""

from dataclasses import fields, is_dataclass

import numpy as np
import shapely
from hypothesis import strategies as st
from shapely import MultiPolygon, Point, Polygon

from semap.model.building import HeightBand, Mesh
from semap.model.map_document import (
    Anchor,
    ConceptEntry,
    DescriptionEntry,
    FrameEntry,
    InstanceEntry,
    MapDocument,
    OccupancyGrid,
    QueryEntry,
    RuleEntry,
    StampedPose,
)
from semap.model.pose import IDENTITY, Pose
from semap.model.source_geometry import PolygonMesh, SourceGeometry
from semap.timeline.stamp import to_datetime

FLOATS = st.floats(-1e6, 1e6, allow_nan=False)
ANY_FLOATS = st.floats(allow_nan=False, allow_infinity=False)
TEXTS = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), min_size=1, max_size=12)
TRAPS = st.sampled_from(
    ["no", "yes", "~", "null", "1e3", "0x1F", "12:30", "2026-01-01", "- a", "a: b", "#x", " ", "a\nb", "<<", "=", "'", '"', ".inf", "010", "true", "\u0085", "\u2028", "\ufeff", "\x07", "é", "𝄞", "!!int", "*a", "&a", "%", "@", "`", "map ", "\t"]
)  # fmt: skip
NAMES = st.one_of(TEXTS, TRAPS)
JSON = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), ANY_FLOATS, NAMES, st.just("")),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.one_of(NAMES, st.just("")), inner, max_size=3)),
    max_leaves=6,
)  # fmt: skip
ATTRIBUTES = st.dictionaries(NAMES, JSON, max_size=3)
STAMPS = st.integers(-(10**15), 4 * 10**15).map(to_datetime)


@st.composite
def poses(draw):
    if draw(st.booleans()):
        return IDENTITY
    quaternion = draw(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1))
    return Pose(*draw(st.tuples(FLOATS, FLOATS, FLOATS)), *quaternion)


def points(dimension):
    return st.tuples(*[ANY_FLOATS] * dimension).map(Point)


@st.composite
def areas(draw):
    """Rectangles side by side, some with a hole: valid whatever the numbers are."""
    parts = []
    for place in range(draw(st.integers(1, 2))):
        x, y = draw(st.floats(0.0, 4.0)) + 20.0 * place, draw(FLOATS)
        outside = [(x, y), (x + 7.1, y), (x + 7.1, y + 5.3), (x, y + 5.3)]
        holes = [[(x + 1, y + 1), (x + 2, y + 1), (x + 2, y + 2.5)]] if draw(st.booleans()) else []
        parts.append(Polygon(outside, holes))
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)


@st.composite
def meshes(draw):
    count = draw(st.integers(3, 6))
    vertices = np.array(draw(st.lists(st.tuples(*[ANY_FLOATS] * 3), min_size=count, max_size=count)))
    corner = st.integers(0, count - 1)
    if draw(st.booleans()):
        faces = draw(st.lists(st.tuples(corner, corner, corner), max_size=4))
        return Mesh(vertices, np.array(faces, dtype=np.int64).reshape(-1, 3))
    longest = draw(st.sampled_from([6, 300]))
    return PolygonMesh(vertices, tuple(tuple(face) for face in draw(st.lists(st.lists(corner, min_size=3, max_size=5).map(lambda f: f * (longest // 6)), max_size=3))))  # fmt: skip


@st.composite
def sources(draw, name):
    kind = draw(st.sampled_from(["POINT2D", "POSE2D", "POLYGON2D", "POINT3D", "POSE3D", "POLYGON3D", "MESH"]))
    band, shape = None, None
    if kind in ("POINT2D", "POSE2D"):
        shape = draw(points(2))
    elif kind in ("POINT3D", "POSE3D"):
        shape = draw(points(3))
    elif kind == "POLYGON2D":
        shape = draw(areas())
        low = draw(FLOATS)
        band = draw(st.sampled_from([None, HeightBand(low, low + 2.5)]))
    elif kind == "POLYGON3D":
        z = draw(ANY_FLOATS)
        shape = Polygon([(0, 0, z), (4.1, 0, z), (4, 3, -z), (0, 3, 1)], [[(1, 1, z), (2, 1, z), (2, 2, z)]])
    else:
        shape = draw(meshes())
        kind = "TRIANGLEMESH3D" if isinstance(shape, Mesh) else "POLYGONMESH3D"
    return SourceGeometry(name, kind, shape, draw(poses()), band)


@st.composite
def descriptions(draw, key, is_shared):
    names = draw(st.lists(NAMES, max_size=3, unique=True))
    return DescriptionEntry(key, tuple(draw(sources(name)) for name in names), is_shared)


@st.composite
def frames(draw):
    names = ["map", *draw(st.lists(NAMES.filter(lambda name: name != "map"), max_size=4, unique=True))]
    made = []
    for place, name in enumerate(names):
        stamps = draw(st.lists(st.one_of(st.none(), STAMPS), max_size=3, unique=True))
        stamped = tuple(StampedPose(draw(poses()), stamp) for stamp in stamps)
        made.append(
            FrameEntry(name, draw(st.sampled_from([None, *names[:place]])) if place else None, stamped)
        )
    return tuple(draw(st.permutations(made)))


@st.composite
def grids(draw, name):
    height, width = draw(st.integers(1, 4)), draw(st.integers(1, 4))
    pixels = np.array(draw(st.lists(st.integers(0, 255), min_size=height * width, max_size=height * width)))
    low, high = sorted(draw(st.lists(st.floats(0, 1), min_size=2, max_size=2, unique=True)))
    return OccupancyGrid(
        name,
        draw(st.floats(1e-6, 1e3)),
        draw(st.tuples(FLOATS, FLOATS, FLOATS)),
        pixels.astype(np.uint8).reshape(height, width),
        draw(st.booleans()),
        (high, low),
        draw(st.sampled_from(["trinary", "scale", "raw"])),
    )


@st.composite
def map_documents(draw):
    def unique(most):
        return draw(st.lists(NAMES, max_size=most, unique=True))

    keys = unique(4)
    shared = draw(st.integers(0, len(keys)))
    described = tuple(draw(descriptions(key, place < shared)) for place, key in enumerate(keys))
    framed = draw(frames())
    names = unique(4)
    some = st.sampled_from([None, *names])
    instances = tuple(
        InstanceEntry(
            draw(st.uuids()), name, draw(NAMES), draw(st.sampled_from(framed)).name,
            draw(st.one_of(st.none(), NAMES)), draw(st.sampled_from([None, *keys])), draw(some),
            tuple(draw(st.lists(st.sampled_from(names), max_size=2, unique=True))), draw(ATTRIBUTES),
        )
        for name in names
    )  # fmt: skip
    queries = tuple(QueryEntry(name, draw(NAMES), draw(NAMES), draw(st.booleans())) for name in unique(2))
    rules = tuple(
        RuleEntry(name, (draw(st.sampled_from(queries)).name,), draw(ATTRIBUTES), draw(st.booleans()))
        for name in (unique(2) if queries else ())
    )
    concepts = tuple(
        ConceptEntry(name, tuple(unique(2)), tuple(unique(2)), draw(st.one_of(st.none(), NAMES)), draw(st.one_of(st.none(), ATTRIBUTES)))
        for name in unique(3)
    )  # fmt: skip
    return MapDocument(
        draw(NAMES),
        draw(st.floats(0.1, 100)),
        draw(st.one_of(st.none(), st.builds(Anchor, st.integers(1024, 32767), poses()))),
        concepts,
        framed,
        described,
        instances,
        queries,
        rules,
        tuple(draw(grids(name)) for name in unique(2)),
    )


def content(value):
    """A value that is equal to another's only if every field, and every bit of every array, is."""
    if is_dataclass(value):
        return (
            type(value).__name__,
            {each.name: content(getattr(value, each.name)) for each in fields(value)},
        )
    if isinstance(value, np.ndarray):
        return (str(value.dtype), value.shape, value.tobytes())
    if isinstance(value, shapely.Geometry):
        return shapely.to_wkb(value, byte_order=1)
    if isinstance(value, dict):
        return [(key, content(each)) for key, each in value.items()]
    if isinstance(value, tuple | list):
        return [content(each) for each in value]
    # 1, 1.0 and True are equal in Python and different in JSON.
    return (type(value).__name__, repr(value)) if isinstance(value, int | float) else value
