"""What a continuous query asks: between which subjects and objects which relation is kept true.

A relation holds between one subject and one object: `subject predicate object`, as in "the room contains the
track". Which of the two is written first follows the predicate's reading and changes nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal
from uuid import UUID

from semap.errors import InvalidInput
from semap.model.predicate import Kind, predicates

Direction = Literal["left_to_right", "right_to_left"]
"""Of crossing a line, seen along it in the order of its vertices."""


@dataclass(frozen=True)
class Side:
    """Which tracks or instances a query is about: those that all of this is true of.

    concept  this one or one below it; None: any
    uids     None: any
    where    a CQL2 condition on name and attributes, in its JSON form; None: any
    """

    kind: Kind
    concept: str | None = None
    uids: tuple[UUID, ...] | None = None
    where: Mapping[str, object] | None = None


@dataclass(frozen=True)
class Debounce:
    """How far and how long something must hold before it counts; the margins are beside the boundary.

    enter_margin_m   how deep inside it has to come [m]
    leave_margin_m   how far outside it has to go [m]
    enter_confirm_s  how long it has to stay in [s of event time]
    leave_confirm_s  how long it has to stay out [s of event time]
    """

    enter_margin_m: float = 0.0
    leave_margin_m: float = 0.0
    enter_confirm_s: float = 0.0
    leave_confirm_s: float = 0.0


DEFAULT_DEBOUNCE = Debounce(0.15, 0.15)
"""Three times the noise of a good tracker (5 cm): what is asked for by "debounce" without more."""


@dataclass(frozen=True)
class Certainty:
    """How probable a containment must be to begin, and how improbable to end, from a position's covariance.

    enter         in [0.5, 1)
    leave         in (0, 0.5]
    widest_std_m  a position that is less exact than this is evidence of neither
    """

    enter: float = 0.9
    leave: float = 0.1
    widest_std_m: float = 1.0


@dataclass(frozen=True)
class BetweenSamples:
    """The way between two samples is taken as a straight line, unless it is too long or too fast to be one.

    longest_gap_s  no line between samples further apart in time
    fastest_mps    no line that asks for a higher speed
    """

    longest_gap_s: float = 30.0
    fastest_mps: float = 30.0


@dataclass(frozen=True)
class Declaration:
    """A continuous query.

    distance_m, count, angle_rad, speed_mps, direction
                    what the predicate needs or takes (semap.model.predicate); a direction is seen along the
                    line that is crossed: into an area is "right_to_left"
    abstraction     which abstraction of instances is compared; tracks are where their position is
    dimensions      3: heights count, too
    between_samples None: relations follow the samples alone
    follows_amendments  where a tracker finds that it had mistaken tracks, relations are corrected
    payload         what each row of the result carries: a property of a side by the name of its column, such
                    as {"room": "object.name", "track": "subject.name"}; empty: all there are
    """

    name: str
    predicate: str
    subject: Side
    object: Side
    distance_m: float | None = None
    count: int | None = None
    angle_rad: float | None = None
    speed_mps: float | None = None
    direction: Direction | None = None
    abstraction: str = "Footprint"
    dimensions: Literal[2, 3] = 3
    debounce: Debounce = field(default_factory=Debounce)
    certainty: Certainty | None = None
    between_samples: BetweenSamples | None = None
    follows_amendments: bool = False
    payload: Mapping[str, str] = field(default_factory=dict)

    @property
    def in_pairs(self) -> bool:
        """Whether it is kept pair by pair: regions answer only where a track is to an instance."""
        return predicates()[self.predicate].in_pairs(self.subject.kind, self.object.kind)


SIDES: Mapping[str, Kind] = {"subject": "track", "object": "instance"}
"""What each side is of where nothing else is said."""
PARTS = {"debounce": Debounce, "certainty": Certainty, "between_samples": BetweenSamples}


def options_of(declaration: Declaration) -> Mapping[str, object]:
    """What a declaration says beyond its name, predicate and its object's concept, as JSON; no defaults."""
    plain = Declaration(
        declaration.name, declaration.predicate, Side("track"), Side("instance", declaration.object.concept)
    )
    found: dict[str, object] = {}
    for each in fields(Declaration):
        value = getattr(declaration, each.name)
        if value == getattr(plain, each.name):
            continue
        if isinstance(value, Side):
            value = {
                "kind": None if value.kind == SIDES[each.name] else value.kind,
                "concept": None if each.name == "object" else value.concept,
                "uids": None if value.uids is None else [str(uid) for uid in value.uids],
                "where": None if value.where is None else dict(value.where),
            }
            value = {key: said for key, said in value.items() if said is not None}
        elif each.name in PARTS:
            value = asdict(value)
        elif isinstance(value, Mapping):
            value = dict(value)
        found[each.name] = value
    return found


def declared(name: str, predicate: str, concept: str | None, options: Mapping[str, object]) -> Declaration:
    """A declaration of what `options_of` gave.

    raises  InvalidInput if it is not of that form
    """
    try:
        said: dict[str, Any] = dict(options)
        for part, kind in PARTS.items():
            if part in said:
                said[part] = kind(**said[part])
        for side, kind_of in SIDES.items():
            given = dict(said.pop(side, {}))
            uids = given.pop("uids", None)
            said[side] = Side(
                kind=given.pop("kind", kind_of),
                concept=given.pop("concept", concept if side == "object" else None),
                uids=None if uids is None else tuple(UUID(uid) for uid in uids),
                where=given.pop("where", None),
                **given,
            )
        return Declaration(name=name, predicate=predicate, **said)
    except (TypeError, ValueError, AttributeError) as error:
        raise InvalidInput(
            f"the query does not say what it asks: {error}", "Write it as an exported map has it.", name
        ) from error
