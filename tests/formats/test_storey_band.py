import pytest

from semap.formats.storey_band import band_by_storey
from semap.formats.unique_name import unique_names
from semap.model.building import HeightBand

STOREYS_M = (-1.25, 0.0, 3.1, 6.0)


@pytest.mark.parametrize(
    ("bottom_m", "top_m", "elevation_m", "band"),
    [
        (0.02, 2.6, 0.0, HeightBand(0.0, 3.1)),
        (-0.5, 3.6, 0.0, HeightBand(0.0, 3.1)),
        (3.12, 5.7, 3.1, HeightBand(3.1, 6.0)),
        (0.0, 5.7, 0.0, HeightBand(0.0, 5.7)),
        (0.0, 3.61, 0.0, HeightBand(0.0, 3.61)),
        (1.5, 2.6, 0.0, HeightBand(1.5, 3.1)),
        (6.0, 9.0, 6.0, HeightBand(6.0, 9.0)),
        (4.0, 5.0, 0.0, HeightBand(4.0, 6.0)),
        (0.1, 2.6, None, HeightBand(0.1, 2.6)),
    ],
    ids=["ceiling", "slabs", "upper", "stair", "too high", "gallery", "top", "wrong storey", "no storey"],
)
def test_a_room_gets_the_heights_of_its_storey(
    bottom_m: float, top_m: float, elevation_m: float | None, band: HeightBand
) -> None:
    assert band_by_storey(bottom_m, top_m, elevation_m, STOREYS_M) == band


@pytest.mark.parametrize(
    ("wanted", "names"),
    [
        ([("a", "one"), ("b", "one")], ("a", "b")),
        ([("a", "one"), ("a", "two"), ("b", "two")], ("a (one)", "a (two)", "b")),
        ([("a", "one"), ("a", "one"), ("a", "two")], ("a (one)", "a (one) 2", "a (two)")),
        ([("a", None), ("a", None), ("a 2", None)], ("a", "a 3", "a 2")),
        ([("Level", "Level"), ("b", "Level")], ("Level 2", "b")),
    ],
)
def test_repeated_names_get_their_storey_or_a_number(
    wanted: list[tuple[str, str | None]], names: tuple[str, ...]
) -> None:
    unique, findings = unique_names(wanted, taken=["Level"])
    assert unique == names
    assert [finding.subject for finding in findings] == [
        name for name, (asked, _) in zip(names, wanted, strict=True) if name != asked
    ]
