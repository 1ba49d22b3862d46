import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from semap.errors import InvalidInput
from semap.geometry.direction import DIRECTIONS, direction_region, direction_regions

LOW, HIGH, REACH = np.array([-1.0, -2.0, 0.0]), np.array([1.0, 2.0, 0.5]), 3.0

EXPECTED = {
    "FrontProjection": ([1, -2, 0], [4, 2, 0.5]),
    "BackProjection": ([-4, -2, 0], [-1, 2, 0.5]),
    "LeftProjection": ([-1, 2, 0], [1, 5, 0.5]),
    "RightProjection": ([-1, -5, 0], [1, -2, 0.5]),
    "TopProjection": ([-1, -2, 0.5], [1, 2, 3.5]),
    "BotProjection": ([-1, -2, -3], [1, 2, 0]),
    "FrontHalfspace": ([1, -5, -3], [4, 5, 3.5]),
    "BackHalfspace": ([-4, -5, -3], [-1, 5, 3.5]),
    "LeftHalfspace": ([-4, 2, -3], [4, 5, 3.5]),
    "RightHalfspace": ([-4, -5, -3], [4, -2, 3.5]),
    "TopHalfspace": ([-4, -5, 0.5], [4, 5, 3.5]),
    "BotHalfspace": ([-4, -5, -3], [4, 5, 0]),
}


def test_every_region_of_a_table() -> None:
    regions = direction_regions(LOW, HIGH, REACH)
    assert set(regions) == set(EXPECTED) == set(DIRECTIONS)
    for name, mesh in regions.items():
        low, high = EXPECTED[name]
        assert mesh.vertices_m.min(axis=0).tolist() == low, name
        assert mesh.vertices_m.max(axis=0).tolist() == high, name


@given(
    st.sampled_from(DIRECTIONS),
    st.tuples(*[st.integers(-10, 10)] * 3),
    st.tuples(*[st.integers(0, 10)] * 3),
    st.integers(1, 100),
)
def test_regions_are_closed_boxes_wound_outwards(
    name: str, low: tuple[int, ...], size: tuple[int, ...], reach_m: int
) -> None:
    region = direction_region(name, low, np.add(low, size), reach_m)
    directed = {
        (a, b) for face in region.faces.tolist() for a, b in zip(face, [*face[1:], face[0]], strict=True)
    }
    assert len(directed) == 36
    assert directed == {(b, a) for a, b in directed}
    a, b, c = (region.vertices_m[region.faces[:, i]] for i in range(3))
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    assert volume == pytest.approx(np.prod(np.ptp(region.vertices_m, axis=0)), abs=1e-6)


@pytest.mark.parametrize(
    ("name", "low", "high", "reach_m"),
    [
        ("Front", LOW, HIGH, 1.0),
        ("FrontProjection", HIGH, LOW, 1.0),
        ("FrontProjection", LOW, HIGH, 0.0),
        ("FrontProjection", LOW, HIGH, np.inf),
        ("FrontProjection", LOW, HIGH * np.nan, 1.0),
        ("FrontProjection", LOW[:2], HIGH[:2], 1.0),
    ],
)
def test_what_is_no_region_is_refused(name: str, low: object, high: object, reach_m: float) -> None:
    with pytest.raises(InvalidInput) as refusal:
        direction_region(name, low, high, reach_m)  # type: ignore[arg-type]
    assert refusal.value.remedy
