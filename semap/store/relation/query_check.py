"""What queries mean something, of those that can be said: which predicates relate what, and are told what."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, get_args

from semap.errors import InvalidInput
from semap.model.continuous_query import Declaration
from semap.model.predicate import Predicate, predicates
from semap.store.relation.query_bounds import require_within_bounds

Flat = Literal["Footprint", "FootprintBox", "FootprintHull", "AxisAligned2D", "Position2D", "Line"]
"""Abstractions that can be compared as they are seen from above."""

FLAT: tuple[str, ...] = get_args(Flat)
PARAMETERS: Mapping[str, tuple[str, str]] = {
    "distance_m": ("distance", "Say how far it reaches [m]: --distance, distance_m."),
    "count": ("count", "Say how many the nearest are, 1 to 100: --count, count."),
    "angle_rad": ("angle", "Say how far the heading may be off: --angle [degrees], angle_rad."),
    "speed_mps": ("speed", "Say how fast the distance has to fall [m/s]: --speed, speed_mps."),
    "direction": ("direction", "Say left_to_right or right_to_left: --direction, direction."),
}
"""What each parameter is called, and how it is said."""


def require_meaning(declaration: Declaration) -> None:
    """raises InvalidInput with the reason and the remedy"""
    predicate = predicates().get(declaration.predicate)
    if predicate is None:
        raise InvalidInput(
            f"the predicate {declaration.predicate} cannot be kept true",
            f"Use one of {', '.join(predicates())}.",
        )
    _check_sides(predicate, declaration)
    _check_parameters(predicate, declaration)
    require_within_bounds(declaration)
    if declaration.in_pairs:
        _check_edges_of_pairs(predicate, declaration)
    kinds = declaration.subject.kind, declaration.object.kind
    if "instance" in kinds and declaration.abstraction not in FLAT:
        raise InvalidInput(
            f"continuous queries do not support the abstraction {declaration.abstraction}",
            f"Use one of {', '.join(FLAT)}.",
        )
    if declaration.abstraction == "Line" and predicate.object != "line":
        lines = " and ".join(each.name for each in predicates().values() if each.object == "line")
        raise InvalidInput(f"only {lines} compares lines", "Use the abstraction Footprint.")


def _check_sides(predicate: Predicate, declaration: Declaration) -> None:
    kinds = declaration.subject.kind, declaration.object.kind
    if " ".join(kinds) not in predicate.relates:
        known = " or ".join(each.replace(" ", " to ") for each in predicate.relates)
        raise InvalidInput(
            f"{predicate.name} does not relate {kinds[0]} to {kinds[1]}: {predicate.why_not}",
            f"It relates {known}.",
        )


def _check_parameters(predicate: Predicate, declaration: Declaration) -> None:
    for name, (called, remedy) in PARAMETERS.items():
        value = getattr(declaration, name)
        if value is None and name in predicate.needs:
            raise InvalidInput(
                f"{predicate.name} needs {'an' if called[0] in 'aeiou' else 'a'} {called}", remedy
            )
        if value is not None and name not in predicate.needs + predicate.takes:
            raise InvalidInput(f"{predicate.name} takes no {called}", "Leave it out.")


def _check_edges_of_pairs(predicate: Predicate, declaration: Declaration) -> None:
    """raises InvalidInput"""
    debounce, is_moment = declaration.debounce, predicate.follows_from == "way"
    if declaration.certainty is not None:
        raise InvalidInput(
            "a probability is that of a position to lie in a fixed area, which a pair has not",
            "Leave certainty out, or use debounce.",
        )
    if declaration.between_samples is not None and not is_moment:
        raise InvalidInput(
            "both sides of a pair may move between two samples: one path alone gives no moment",
            "Leave between_samples out.",
        )
    if declaration.follows_amendments:
        raise InvalidInput(
            "relations of pairs do not follow amendments of tracks", "Leave follows_amendments out."
        )
    if not predicate.has_boundary and (debounce.enter_margin_m or debounce.leave_margin_m):
        raise InvalidInput(
            f"{predicate.name} has no boundary in metres that a margin could be beside",
            "Leave the margins out." if is_moment else "Use times to confirm instead.",
        )
    if is_moment and (debounce.enter_confirm_s or debounce.leave_confirm_s):
        raise InvalidInput(
            "a crossing is a moment, which lasts for no time that could be confirmed",
            "Leave the times to confirm out.",
        )
