"""A ramp in IFC joins the rooms at its foot and at its head, on two storeys."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import pytest

from semap.formats.ifc import read_ifc

ifcopenshell = importlib.import_module("ifcopenshell")
run = importlib.import_module("ifcopenshell.api").run

Corner = tuple[float, float, float]
FACES = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
RISE_M = 3.0


def slab(x_min_m: float, z_min_m: float, x_max_m: float, z_max_m: float, high_m: float) -> list[Corner]:
    """A block from a lower end in the west to one in the east, so high everywhere."""
    low = [(x_min_m, 1.0, z_min_m), (x_max_m, 1.0, z_max_m), (x_max_m, 3.0, z_max_m), (x_min_m, 3.0, z_min_m)]
    return [*low, *((x, y, z + high_m) for x, y, z in low)]


def model(is_whole: bool, high_m: float) -> Any:
    """Two storeys with a hall each: the ramp leads from the lower one, west, to the upper one, east."""
    file = run("project.create_file")
    project = run("root.create_entity", file, ifc_class="IfcProject", name="ramp")
    run("unit.assign_unit", file, length={"is_metric": True, "raw": "METERS"})
    context = run("context.add_context", file, context_type="Model")
    body = run(
        "context.add_context", file, context_type="Model", context_identifier="Body",
        target_view="MODEL_VIEW", parent=context,
    )  # fmt: skip

    def made(ifc_class: str, name: str, above: Any, blocks: list[list[Corner]] = []) -> Any:  # noqa: B006
        entity = run("root.create_entity", file, ifc_class=ifc_class, name=name)
        is_contained = above.is_a("IfcBuildingStorey") and ifc_class != "IfcSpace"
        if is_contained:
            run("spatial.assign_container", file, products=[entity], relating_structure=above)
        else:
            run("aggregate.assign_object", file, products=[entity], relating_object=above)
        run("geometry.edit_object_placement", file, product=entity)
        if blocks:
            shape = run(
                "geometry.add_mesh_representation", file, context=body,
                vertices=blocks, edges=[[] for _ in blocks], faces=[FACES for _ in blocks],
            )  # fmt: skip
            run("geometry.assign_representation", file, product=entity, representation=shape)
        return entity

    building = made("IfcBuilding", "house", made("IfcSite", "site", project))
    storeys = []
    for level, (x_min_m, x_max_m) in enumerate(((0.0, 5.0), (11.0, 16.0))):
        storey = made("IfcBuildingStorey", f"level {level}", building)
        storey.Elevation = level * RISE_M
        storeys.append(storey)
        floor_m = level * RISE_M
        made("IfcSpace", f"hall {level}", storey, [slab(x_min_m, floor_m, x_max_m, floor_m, RISE_M)])
    run_m = [slab(5, -high_m, 8, 1.5 - high_m, high_m), slab(8, 1.5 - high_m, 11, RISE_M - high_m, high_m)]
    if is_whole:
        made("IfcRamp", "ramp", storeys[0], run_m)
    else:
        ramp = made("IfcRamp", "ramp", storeys[0])
        for number, block in enumerate(run_m):
            made("IfcRampFlight", f"flight {number}", ramp, [block])
    return file


@pytest.mark.parametrize("is_whole", [True, False])
@pytest.mark.parametrize("high_m", [0.1, 0.3, 0.5])
def test_a_ramp_joins_storeys(tmp_path: Path, is_whole: bool, high_m: float) -> None:
    model(is_whole, high_m).write(str(tmp_path / "ramp.ifc"))
    building = read_ifc(tmp_path / "ramp.ifc")
    (ramp,) = (each for each in building.items if each.concept == "Ramp")
    assert [each.name for each in building.storeys] == ["level 0", "level 1"]
    assert ramp.joins == ("hall 0", "hall 1")
