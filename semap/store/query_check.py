"""What queries mean something, of those that can be said: which predicates relate what, and are told what."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, get_args

from semap.errors import InvalidInput
from semap.model.continuous_query import Declaration, Kind, Predicate
from semap.store.query_bounds import require_within_bounds

Flat = Literal["Footprint", "FootprintBox", "FootprintHull", "AxisAligned2D", "Position2D", "Line"]
"""Abstractions that can be compared as they are seen from above."""

KEPT: tuple[str, ...] = get_args(Predicate)
FLAT: tuple[str, ...] = get_args(Flat)
BESIDE = ("in_front_of", "behind", "left_of", "right_of")
NEEDED: Mapping[str, tuple[str, ...]] = {
    "within_distance": ("distance_m",),
    **dict.fromkeys(BESIDE, ("distance_m",)),
    "nearest": ("count",),
    "facing": ("angle_rad",),
    "approaching": ("speed_mps", "distance_m"),
}
"""What a predicate needs to be told."""
TAKEN: Mapping[str, tuple[str, ...]] = {
    "nearest": ("distance_m",),
    "facing": ("distance_m",),
    "crosses": ("direction",),
}
"""What it may be told besides."""
PARAMETERS: Mapping[str, tuple[str, str]] = {
    "distance_m": ("distance", "Say how far it reaches [m]: --distance, distance_m."),
    "count": ("count", "Say how many the nearest are, 1 to 100: --count, count."),
    "angle_rad": ("angle", "Say how far the heading may be off: --angle [degrees], angle_rad."),
    "speed_mps": ("speed", "Say how fast the distance has to fall [m/s]: --speed, speed_mps."),
    "direction": ("direction", "Say left_to_right or right_to_left: --direction, direction."),
}
"""What each parameter is called, and how it is said."""
SIDES_OF: Mapping[str, tuple[str, tuple[tuple[Kind, Kind], ...]]] = {
    "crosses": ("only tracks cross, and only what stands still is crossed", (("track", "instance"),)),
    "approaching": (
        "of two instances neither approaches, since they move when the map is edited",
        (("track", "instance"), ("track", "track"), ("instance", "track")),
    ),
    "on": (
        "nothing stands on a track, whose top is not known",
        (("track", "instance"), ("instance", "instance")),
    ),
}
"""Why not every kind of subject and object, and which a predicate may relate."""
HAVE_MARGINS = (
    "contains",
    "covers",
    "intersects",
    "within_distance",
    "in_front_of",
    "behind",
    "left_of",
    "right_of",
)
"""Predicates of pairs that have a boundary in metres."""


def require_meaning(declaration: Declaration) -> None:
    """raises InvalidInput with the reason and the remedy"""
    if declaration.predicate not in KEPT:
        raise InvalidInput(
            f"the predicate {declaration.predicate} cannot be kept true", f"Use one of {', '.join(KEPT)}."
        )
    _check_sides(declaration)
    _check_parameters(declaration)
    require_within_bounds(declaration)
    if declaration.in_pairs:
        _check_edges_of_pairs(declaration)
    kinds = declaration.subject.kind, declaration.object.kind
    if "instance" in kinds and declaration.abstraction not in FLAT:
        raise InvalidInput(
            f"continuous queries do not support the abstraction {declaration.abstraction}",
            f"Use one of {', '.join(FLAT)}.",
        )
    if declaration.abstraction == "Line" and declaration.predicate != "crosses":
        raise InvalidInput("only crosses compares lines", "Use the abstraction Footprint.")


def _check_sides(declaration: Declaration) -> None:
    kinds = declaration.subject.kind, declaration.object.kind
    if declaration.predicate not in SIDES_OF:
        return
    reason, possible = SIDES_OF[declaration.predicate]
    if kinds not in possible:
        known = " or ".join(f"{subject} to {object_}" for subject, object_ in possible)
        raise InvalidInput(
            f"{declaration.predicate} does not relate {kinds[0]} to {kinds[1]}: {reason}",
            f"It relates {known}.",
        )


def _check_parameters(declaration: Declaration) -> None:
    predicate = declaration.predicate
    needed, taken = NEEDED.get(predicate, ()), TAKEN.get(predicate, ())
    for name, (called, remedy) in PARAMETERS.items():
        value = getattr(declaration, name)
        if value is None and name in needed:
            raise InvalidInput(f"{predicate} needs {'an' if called[0] in 'aeiou' else 'a'} {called}", remedy)
        if value is not None and name not in needed + taken:
            raise InvalidInput(f"{predicate} takes no {called}", "Leave it out.")


def _check_edges_of_pairs(declaration: Declaration) -> None:
    """raises InvalidInput"""
    predicate, debounce = declaration.predicate, declaration.debounce
    if declaration.certainty is not None:
        raise InvalidInput(
            "a probability is that of a position to lie in a fixed area, which a pair has not",
            "Leave certainty out, or use debounce.",
        )
    if declaration.between_samples is not None and predicate != "crosses":
        raise InvalidInput(
            "both sides of a pair may move between two samples: one path alone gives no moment",
            "Leave between_samples out.",
        )
    if predicate not in HAVE_MARGINS and (debounce.enter_margin_m or debounce.leave_margin_m):
        raise InvalidInput(
            f"{predicate} has no boundary in metres that a margin could be beside",
            "Leave the margins out." if predicate == "crosses" else "Use times to confirm instead.",
        )
    if predicate == "crosses" and (debounce.enter_confirm_s or debounce.leave_confirm_s):
        raise InvalidInput(
            "a crossing is a moment, which lasts for no time that could be confirmed",
            "Leave the times to confirm out.",
        )
