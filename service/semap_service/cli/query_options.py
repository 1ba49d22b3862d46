"""The options of `semap query add`, and what they say together."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from semap.errors import InvalidInput
from semap.model.continuous_query import (
    DEFAULT_DEBOUNCE,
    BetweenSamples,
    Certainty,
    Debounce,
    Declaration,
    Side,
)
from semap.model.predicate import Kind, needed_for, predicates

Predicate = Annotated[str, typer.Option(help=f"{', '.join(predicates())}.")]
Concept = Annotated[str | None, typer.Option(help="Which objects, with the concepts below. [default: any]")]
Where = Annotated[
    str | None, typer.Option(help='Only objects that satisfy this CQL2 condition: "attributes.floor = 2".')
]
ObjectKind = Annotated[str, typer.Option("--object", help="Kind of the objects: instance, track.")]
SubjectConcept = Annotated[
    str | None, typer.Option("--subject-concept", "--track-concept", help="Only subjects of this concept.")
]
SubjectWhere = Annotated[
    str | None,
    typer.Option(
        "--subject-where",
        "--track-where",
        help="Only subjects that satisfy this: \"source = 'camera'\".",
    ),
]
SubjectKind = Annotated[str, typer.Option("--subject", help="Kind of the subjects: track, instance.")]
Distance = Annotated[float | None, typer.Option(help=f"How far it reaches [m]. {needed_for('distance_m')}.")]
Count = Annotated[int | None, typer.Option(help=f"How many are near. {needed_for('count')}.", min=1, max=100)]
Angle = Annotated[
    float | None,
    typer.Option(
        help=f"The largest angle between heading and bearing [degrees]. {needed_for('angle_rad')}.",
        min=0,
        max=180,
    ),
]
Speed = Annotated[
    float | None,
    typer.Option(help=f"The distance falls so fast or faster [m/s]. {needed_for('speed_mps')}.", min=0),
]
Direction = Annotated[
    str | None,
    typer.Option(
        help="left_to_right or right_to_left, seen along the line. [default: both]"
        f" {needed_for('direction')}."
    ),
]
Abstraction = Annotated[
    str, typer.Option(help="Shape of an instance: Footprint, FootprintHull, Position2D ...")
]
Flat = Annotated[bool, typer.Option("--flat", help="Ignore heights.")]
Debounced = Annotated[
    bool, typer.Option("--debounce", help="Suppress flicker at the boundary: --margin 0.15, both ways.")
]
Margin = Annotated[
    float | None, typer.Option(help="Distance from the boundary to the enter and leave thresholds [m].")
]
Confirm = Annotated[float | None, typer.Option(help="Confirmation time, both ways [s of event time].")]
Probability = Annotated[
    float | None,
    typer.Option(
        help="Begin at this probability, end at this one of the opposite: 0.9.",
        min=0.5,
        max=0.999999,
    ),
]
Between = Annotated[
    bool,
    typer.Option(
        "--between-samples",
        help="Interpolate linearly between samples: exact transition times, no room is missed.",
    ),
]
LongestGap = Annotated[float, typer.Option(help="Do not interpolate longer gaps [s].")]
Fastest = Annotated[float, typer.Option(help="Do not interpolate higher speeds [m/s].")]
FollowsAmendments = Annotated[
    bool,
    typer.Option(
        "--follows-amendments",
        help="Correct relations where a tracker finds that it had mistaken tracks: semap track amendments.",
    ),
]
Sql = Annotated[
    str | None,
    typer.Option(help="Instead of the sides and the predicate: a SELECT over the views of semap_query."),
]


def side(kind: str, concept: str | None, where: str | None, option: str) -> Side:
    """A side as it is declared.

    raises  InvalidInput if there is no such kind, or the condition cannot be read
    """
    from semap.store.relation.queries import read_condition  # noqa: PLC0415

    kinds: dict[str, Kind] = {"track": "track", "instance": "instance"}
    if kind not in kinds:
        raise InvalidInput(
            f"{kind} is neither track nor instance", "Write track or instance.", "--subject, --object"
        )
    return Side(kinds[kind], concept, None, None if where is None else read_condition(where, option))


def edges(
    debounce: bool,
    margin: float | None,
    confirm: float | None,
    probability: float | None,
    between: tuple[float, float] | None,
) -> dict[str, Any]:
    """What makes edges honest, as a declaration has it.

    between  the longest gap [s] and the highest speed [m/s] of a way between two samples; None: there is none
    """
    beside_m = margin if margin is not None else DEFAULT_DEBOUNCE.enter_margin_m if debounce else 0.0
    return {
        "debounce": Debounce(beside_m, beside_m, confirm or 0.0, confirm or 0.0),
        "certainty": None if probability is None else Certainty(probability, 1 - probability),
        "between_samples": None if between is None else BetweenSamples(*between),
    }


def require_plain(asked: Declaration) -> None:
    """raises InvalidInput where options say what a text in SQL says"""
    if asked != Declaration(asked.name, "contains", Side("track"), Side("instance")):
        raise InvalidInput(
            "the text says what is related to what, and how",
            "Leave out --predicate and the options of both sides.",
            "--sql",
        )
