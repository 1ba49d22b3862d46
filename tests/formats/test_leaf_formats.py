"""Leaves of doors in YAML maps and in building models."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from data_sets import data_set

from semap.errors import InvalidInput
from semap.formats.ifc import read_ifc
from semap.formats.ifc_door import door_attributes
from semap.formats.yaml_map import read_map, write_map
from semap.geometry.pose import transform_points

DOOR = "map: m\ndoors:\n  d: {width_m: 0.9, %s}\n"


def read(tmp_path: Path, text: str):
    (tmp_path / "map.yaml").write_text(text)
    return read_map(tmp_path)


@pytest.mark.parametrize(
    ("leaf", "expected"),
    [
        ("left", {"hinge": "left"}),
        ("{hinge: right, max_deg: 95}", {"hinge": "right", "max_deg": 95.0}),
        (
            "{hinge: left, at: [0, 0.06], width_m: 0.85}",
            {"hinge": "left", "at": [0.0, 0.06], "width_m": 0.85},
        ),
        (
            "{hinge: left, opening_above_deg: 5, closed_below_deg: 3, rests_for_s: 1}",
            {"hinge": "left", "opening_above_deg": 5.0, "closed_below_deg": 3.0, "rests_for_s": 1.0},
        ),
    ],
)
def test_a_leaf_is_an_attribute_and_outlives_an_export(tmp_path: Path, leaf: str, expected: dict) -> None:
    document = read(tmp_path, DOOR % f"leaf: {leaf}")
    assert [each.attributes for each in document.instances] == [{"width_m": 0.9, "leaf": expected}]
    write_map(document, tmp_path / "again")
    assert [each.attributes for each in read_map(tmp_path / "again").instances] == [
        {"width_m": 0.9, "leaf": expected}
    ]


@pytest.mark.parametrize(
    ("text", "message", "remedy"),
    [
        (DOOR % "leaf: §middle", "'middle' is not known", "left, right"),
        (DOOR % "leaf: §{max_deg: 90}", "`hinge` is missing", "hinge: left"),
        (DOOR % "leaf: {§hing: left}", "no key 'hing'", "`hinge`"),
        (DOOR % "leaf: {hinge: left, max_deg: §200}", "200 is no max_deg", "10 to 180"),
        (DOOR % "leaf: {hinge: left, max_deg: §.nan}", "not finite", "finite"),
        (DOOR % "leaf: {hinge: left, at: §[1]}", "a list of 1", "2"),
        (DOOR % "leaf: {hinge: left, at: §[1, 500]}", "more than 100 m", "own frame"),
        (DOOR % "leaf: §{hinge: left, closed_below_deg: 20}", "do not rise", "6, 10, 100"),
        (DOOR % "leaf: §[left]", "a text is needed", "word"),
        ("map: m\ndoors: {d: {at: [0, 0], leaf: §left}}\n", "without a width", "`width_m`"),
        ("map: m\nrooms: {r: {§leaf: left}}\n", "no key 'leaf'", ""),
    ],
)
def test_a_wrong_leaf_is_refused_where_it_stands(
    tmp_path: Path, text: str, message: str, remedy: str
) -> None:
    lines = text[: text.index("§")].split("\n")
    with pytest.raises(InvalidInput, match=message) as refused:
        read(tmp_path, text.replace("§", ""))
    assert f"map.yaml:{len(lines)}:{len(lines[-1]) + 1}:" in str(refused.value)
    assert remedy in refused.value.remedy


@pytest.mark.parametrize(
    ("model", "doors"),
    [("duplex/Ifc2x3_Duplex_Architecture.ifc", 14), ("open_smart_home/04_Flat.ifc", 7)],
)
def test_doors_of_building_models_have_leaves_that_fill_their_doorways(model: str, doors: int) -> None:
    items = [item for item in read_ifc(data_set(model)).items if item.concept == "Door"]
    assert len(items) == doors
    for item in items:
        leaf = item.attributes["leaf"]
        assert item.attributes["operation"] == f"SINGLE_SWING_{leaf['hinge'].upper()}"
        assert leaf["width_m"] == pytest.approx(item.attributes["width_m"], abs=1e-6)
        # the leaf is 5 cm thick, and flush with the side of the wall towards which it opens
        x, y = leaf["at"]
        opening = item.body.vertices_m[(np.abs(item.body.vertices_m[:, 0] - x) < leaf["width_m"] / 2 + 0.001)]
        assert y + 0.0255 == pytest.approx(opening[:, 1].max() - 0.025, abs=0.002)
        placed = transform_points(item.pose.matrix(), np.array([[x, y, 1.0]]))[0]
        body = transform_points(item.pose.matrix(), item.body.vertices_m)
        assert (body.min(axis=0) <= placed).all()
        assert (placed <= body.max(axis=0)).all()


def test_other_doors_keep_their_operation_and_have_no_leaf() -> None:
    def attributes(door: str | None, kind: str | None, width_m: float | None = 0.9) -> dict[str, object]:
        return door_attributes(
            SimpleNamespace(OperationType=door), SimpleNamespace(OperationType=kind), None, width_m
        )

    assert attributes("DOUBLE_DOOR_SINGLE_SWING", None) == {"operation": "DOUBLE_DOOR_SINGLE_SWING"}
    assert attributes(None, "SLIDING_TO_LEFT") == {"operation": "SLIDING_TO_LEFT"}
    assert attributes("NOTDEFINED", None) == attributes(None, "USERDEFINED") == {}
    assert attributes("SINGLE_SWING_LEFT", None, None) == {"operation": "SINGLE_SWING_LEFT"}
    assert attributes("NOTDEFINED", "SINGLE_SWING_RIGHT")["leaf"] == {
        "hinge": "right", "width_m": 0.9, "at": [0.45, 0.0],
    }  # fmt: skip
    assert door_attributes(SimpleNamespace(), None, None, math.nan) == {}
