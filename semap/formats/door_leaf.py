"""The leaf of a door as maps say it: `leaf: left`, or `leaf: {hinge: right, max_deg: 95}`.

The words are those of IFC's IfcDoorTypeOperationEnum: in the door's own frame x runs along the doorway and
the leaf opens towards +y; a leaf on the left has its hinge at -x. The database reads the same form of the
attribute `leaf` (sql/160_door_leaf.sql), and refuses what is refused here.
"""

from __future__ import annotations

from collections.abc import Mapping

from semap.formats.yaml_node import Node

SIDES = ("left", "right")
LIMITS = {
    "width_m": (0.2, 10.0),
    "max_deg": (10.0, 180.0),
    "opening_above_deg": (1.0, 60.0),
    "open_from_deg": (5.0, 180.0),
    "turns_by_deg": (1.0, 60.0),
    "closed_below_deg": (0.5, 45.0),
    "rests_within_deg": (0.1, 20.0),
    "rests_for_s": (0.05, 60.0),
}
OTHERWISE = {"max_deg": 100.0, "opening_above_deg": 10.0, "closed_below_deg": 6.0}
REACH_M = 100.0


def read_leaf(node: Node) -> dict[str, object]:
    """The leaf as an attribute: always a mapping with `hinge`.

    raises  InvalidInput, naming the place, for a side, a key or a number that no leaf has
    """
    if not isinstance(node.value, Mapping):
        return {"hinge": node.one_of(SIDES)}
    fields = node.fields(("hinge", "at", *LIMITS))
    if "hinge" not in fields:
        raise node.wrong("`hinge` is missing", "Say on which side it is: `hinge: left` or `hinge: right`.")
    leaf: dict[str, object] = {"hinge": fields["hinge"].one_of(SIDES)}
    if "at" in fields:
        at = fields["at"].numbers(2, 2)
        if max(map(abs, at)) > REACH_M:
            raise fields["at"].wrong(f"more than {REACH_M:g} m away", "Give a point in the door's own frame.")
        leaf["at"] = list(at)
    numbers = dict(OTHERWISE)
    for key in LIMITS.keys() & fields.keys():
        low, high = LIMITS[key]
        number = fields[key].number()
        if not low <= number <= high:
            raise fields[key].wrong(f"{number:g} is no {key} of a leaf", f"Write {low:g} to {high:g}.")
        leaf[key] = numbers[key] = number
    if not numbers["closed_below_deg"] < numbers["opening_above_deg"] < numbers["max_deg"]:
        raise node.wrong(
            "closed_below_deg, opening_above_deg and max_deg do not rise",
            f"Without them they are {', '.join(f'{value:g}' for value in sorted(OTHERWISE.values()))}.",
        )
    return leaf
