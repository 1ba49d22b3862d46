"""The condition that ties the two sides together becomes a predicate with its parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from semap.model.predicate import Predicate, RowFunction, predicates
from semap.query_text.refusal import Refusal
from semap.query_text.tree import Call, Constant, Expression, Function, Property, Row, inner_of, parts
from semap.query_text.views import ABSTRACTIONS, OF_SPACE, View

Views = tuple[View, View]

HOLDING: Mapping[str, tuple[str, int]] = {
    function: (each.name, area) for each in predicates().values() for function, area in each.areas.items()
}
"""Functions of an area and what is in it: the predicate, and which argument is the area."""
NEAR: Mapping[str, Literal[2, 3]] = {"st_dwithin": 2, "st_3ddwithin": 3}
DISTANCES: Mapping[str, Literal[2, 3]] = {"st_distance": 2, "st_3ddistance": 3}


@dataclass(frozen=True)
class Number:
    """An argument that is a number, by the name that `Declaration` has for it."""

    name: str
    what: str
    highest: float


DISTANCE = Number("distance_m", "the distance", 1e4)


NUMBERS = {
    each.name: each
    for each in (
        DISTANCE,
        Number("angle_rad", "the angle", math.pi),
        Number("speed_mps", "the speed", 1e4),
        Number("count", "the count", 100),
    )
}
OF_ROWS: Mapping[str, tuple[Predicate, RowFunction]] = {
    each.rows.name: (each, each.rows) for each in predicates().values() if each.rows is not None
}
"""semap's own predicates, of two rows."""

UNKEPT: Mapping[str, str] = {
    "st_touches": "Use ST_DWithin with a distance.",
    "st_overlaps": "Use ST_Intersects.",
    "st_crosses": "Use crosses(t, d), which looks at the way of a track.",
    "st_equals": "Use ST_DWithin with a distance.",
    "st_disjoint": "Keep ST_Intersects, and look for its ends.",
    "st_containsproperly": "Use ST_Contains.",
    "st_relate": "Use ST_Contains, ST_Covers or ST_Intersects.",
    "st_orderingequals": "Use ST_DWithin with a distance.",
    "st_dfullywithin": "Use ST_DWithin.",
    "st_3ddfullywithin": "Use ST_3DDWithin.",
    "st_3dintersects": "Use is_in(t, r), which looks at heights, or ST_Intersects.",
    "st_maxdistance": "Use ST_DWithin.",
    "st_hausdorffdistance": "Use ST_DWithin.",
    "st_distancesphere": "Use ST_Distance: a map is in metres.",
    "st_distancespheroid": "Use ST_Distance: a map is in metres.",
    "&&": "Boxes are not compared: use ST_Intersects.",
    "&&&": "Boxes are not compared: use is_in(t, r), which looks at heights, or ST_Intersects.",
    "<#>": "Boxes are not compared: use <->.",
    "<<->>": "Use ST_3DDWithin.",
    "|=|": "Use ST_DWithin.",
}
"""Relations that PostGIS has and a continuous query has not, with what to use."""

SPATIAL = {*HOLDING, *NEAR, *DISTANCES, *OF_ROWS, *UNKEPT, "st_intersects", "<->"}


@dataclass(frozen=True)
class Relation:
    """What ties the sides together; subject and object are sides.

    parameters  as `Declaration` has them
    """

    predicate: str
    subject: int
    object: int
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def told(self, **parameters: Any) -> Relation:
        """The same with these parameters, too."""
        return replace(self, parameters={**self.parameters, **parameters})


def is_spatial(expression: Expression) -> bool:
    """Whether a spatial relation or a distance is anywhere in it."""
    return any(
        (isinstance(each, Function) and each.name in SPATIAL)
        or (isinstance(each, Call) and each.op in SPATIAL)
        for each in parts(expression)
    )


def relation_of(expression: Expression, views: Views) -> Relation:
    """What a resolved condition in which there is something spatial ties together.

    raises  Refusal
    """
    match expression:
        case Function(name=name, args=args, at=at) if name in OF_ROWS:
            return _of_rows(name, args, at, views)
        case Function(name=name, args=args, at=at) if name in HOLDING:
            predicate, area = HOLDING[name]
            _require_count(expression, 2)
            return _holding(predicate, _shape(args[area], views), _shape(args[1 - area], views), name, views)
        case Function(name="st_intersects", args=args):
            _require_count(expression, 2)
            return _intersecting(_shape(args[0], views), _shape(args[1], views), views)
        case Function(name=name, args=args) if name in NEAR:
            _require_count(expression, 3)
            distance_m = _number(args[2], DISTANCE)
            return near_by(args[0], args[1], name, NEAR[name], views).told(distance_m=distance_m)
        case Call(op="<" | "<=" | ">" | ">=" | "=" | "<>", args=(left, right)):
            return _compared_distance(expression, left, right, views)
        case Function(name=name, at=at) | Call(op=name, at=at) if name in UNKEPT:
            raise Refusal("unkept predicate", at, what=name, hint=UNKEPT[name])
        case Function(name=name, at=at) if name in DISTANCES:
            raise Refusal("distance", at)
        case Call(op="<->", at=at):
            raise Refusal("distance", at)
    raise _nested(expression)


def _nested(expression: Expression) -> Refusal:
    """Of a relation that is not a condition by itself: what is around it."""
    around: list[str] = []
    part = expression
    while any(is_spatial(each) for each in inner_of(part)):
        around.append(part.op if isinstance(part, Call) else "")
        part = next(each for each in inner_of(part) if is_spatial(each))
    is_logic = set(around) <= {"and", "or", "not"}
    reasons = {"or": "or relation", "not": "not relation"}
    outermost = next((reasons[op] for op in around if op in reasons), "within expression")
    return Refusal(outermost if is_logic else "within expression", part.at)


def distance_between(expression: Expression) -> tuple[Expression, Expression, str, Literal[2, 3]] | None:
    """The shapes between which a distance is, its function and dimensions; None of what is no distance."""
    match expression:
        case Function(name=name, args=(a, b)) if name in DISTANCES:
            return a, b, name, DISTANCES[name]
        case Call(op="<->", args=(a, b)):
            return a, b, "<->", 2
    return None


def near_by(a: Expression, b: Expression, function: str, dimensions: Literal[2, 3], views: Views) -> Relation:
    """Two shapes whose distance counts; of a track and an instance the track is the subject."""
    shapes = _shape(a, views), _shape(b, views)
    for each in shapes:
        if views[each.side].kind == "track":
            _require_position(each, views)
        elif dimensions == 2 and ABSTRACTIONS[each.name] in OF_SPACE:
            raise Refusal("solid", each.at, what=each.name, function=function)
        elif dimensions == 3 and each.name != "position_3d":
            is_solid = ABSTRACTIONS[each.name] in OF_SPACE
            raise Refusal("shell" if is_solid else "flat", each.at, what=each.name, function=function)
    subject, object_ = sorted(shapes, key=lambda each: views[each.side].kind != "track")
    _require_two(subject, object_)
    return _compared("within_distance", subject, object_, dimensions, views)


def _compared_distance(whole: Call, left: Expression, right: Expression, views: Views) -> Relation:
    if isinstance(left, Constant):
        turned = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}.get(whole.op, whole.op)
        return _compared_distance(replace(whole, op=turned), right, left, views)
    for each in (left, right):
        if isinstance(each, Function | Call) and _symbol(each) in UNKEPT:
            raise Refusal("unkept predicate", each.at, what=_symbol(each), hint=UNKEPT[_symbol(each)])
    between = distance_between(left)
    if between is None or not isinstance(right, Constant):
        raise Refusal("distance", whole.at) if between is not None else _nested(whole)
    if whole.op in (">", ">="):
        raise Refusal("beyond", left.at)
    if whole.op not in ("<", "<="):
        raise Refusal("distance", left.at)
    distance_m = _number(right, DISTANCE)
    if whole.op == "<":
        distance_m = math.nextafter(distance_m, 0)  # the next one that is less
    return near_by(*between, views).told(distance_m=distance_m)


def _symbol(expression: Function | Call) -> str:
    return expression.name if isinstance(expression, Function) else expression.op


def _holding(predicate: str, area: Property, inner: Property, function: str, views: Views) -> Relation:
    if views[area.side].kind == "track":
        raise Refusal("track inside", area.at)
    _require_area(area, function)
    if views[inner.side].kind == "track":
        _require_position(inner, views)
    elif ABSTRACTIONS[inner.name] in OF_SPACE:
        raise Refusal("solid", inner.at, what=inner.name, function=function)
    _require_two(inner, area)
    return _compared(predicate, inner, area, 2, views)


def _intersecting(a: Property, b: Property, views: Views) -> Relation:
    subject, object_ = sorted((a, b), key=lambda each: views[each.side].kind != "track")
    _require_two(subject, object_)
    is_point = views[subject.side].kind == "track" and subject.name == "position"
    if views[object_.side].kind == "track":
        for each in (subject, object_):
            if each.name != "footprint":
                raise Refusal("track point", each.at, what=views[each.side].name)
    elif is_point:
        return _holding("covers", object_, subject, "ST_Intersects", views)
    for each in (subject, object_):
        if views[each.side].kind == "instance":
            _require_area(each, "ST_Intersects")
    return _compared("intersects", subject, object_, 2, views)


def _of_rows(name: str, args: Sequence[Expression], at: int, views: Views) -> Relation:
    predicate, known = OF_ROWS[name]
    count = 2 + len(known.numbers)
    if len(args) != count:
        raise Refusal("arguments", at, what=name, count=f"{count} arguments", usage=known.usage)
    subject, object_ = args[0], args[1]
    for each in (subject, object_):
        if not isinstance(each, Row):
            raise Refusal("rows", each.at, what=name, usage=known.usage)
    assert isinstance(subject, Row) and isinstance(object_, Row)  # noqa: S101, PT018  (seen above)
    if subject.side == object_.side:
        raise Refusal("one side", at)
    if known.of_instance and views[object_.side].kind == "track":
        raise Refusal("object track", object_.at, what=name, usage=known.usage)
    if known.by_track and views[subject.side].kind == "instance":
        raise Refusal("subject instance", subject.at, what=name, usage=known.usage)
    numbers = {each: _number(arg, NUMBERS[each]) for each, arg in zip(known.numbers, args[2:], strict=True)}
    found = Relation(predicate.name, subject.side, object_.side, {**known.always, **numbers})
    if known.of_instances is not None and any(each.kind == "instance" for each in views):
        return found.told(abstraction=known.of_instances)
    return found


def _require_count(function: Function, count: int) -> None:
    if len(function.args) != count:
        usage = f"{function.name}(r.footprint, t.position{', 2.5' if count == 3 else ''})"
        what = f"{count} arguments"
        raise Refusal("arguments", function.at, what=function.name, count=what, usage=usage)


def _shape(expression: Expression, views: Views) -> Property:
    match expression:
        case Property(side=side, name=name) if views[side].columns[name] == "shape":
            return expression
        case Property(side=side, name=name, at=at):
            hint = ", ".join(each for each, use in views[side].columns.items() if use == "shape")
            raise Refusal("not a shape", at, what=name, hint=hint)
        case Row(side=side, at=at):
            raise Refusal("not a shape", at, what=views[side].name, hint="position or footprint")
    if any(isinstance(each, Property | Row) for each in parts(expression)):
        raise Refusal("derived shape", expression.at)
    raise Refusal("fixed area", expression.at)


def _require_position(shape: Property, views: Views) -> None:
    if shape.name != "position":
        raise Refusal("track shape", shape.at, what=views[shape.side].name)


def _require_area(shape: Property, function: str) -> None:
    if ABSTRACTIONS[shape.name] in OF_SPACE:
        raise Refusal("solid", shape.at, what=shape.name, function=function)
    if shape.name == "position":
        raise Refusal("point inside", shape.at, what="r")


def _require_two(a: Property, b: Property) -> None:
    if a.side == b.side:
        raise Refusal("one side", a.at)


def _compared(
    predicate: str, subject: Property, object_: Property, dimensions: Literal[2, 3], views: Views
) -> Relation:
    """A relation of two shapes; all instances in it are compared by one abstraction."""
    of_instances = [each for each in (subject, object_) if views[each.side].kind == "instance"]
    names = sorted({each.name for each in of_instances})
    if len(names) > 1:
        raise Refusal("two abstractions", of_instances[0].at, what=" and ".join(names))
    found = Relation(predicate, subject.side, object_.side, {"dimensions": dimensions})
    return found.told(abstraction=ABSTRACTIONS[names[0]]) if names else found


def _number(expression: Expression, wanted: Number) -> float:
    value: float | None = None
    match expression:
        case Constant(value=int() | float() as number) if not isinstance(number, bool):
            value = float(number)
        case Function(name="radians", args=(Constant(value=int() | float() as degrees),)):
            value = math.radians(degrees)
    if value is None or not 0 < value <= wanted.highest:
        limits = f"is above 0 and at most {wanted.highest:,.6g}"
        raise Refusal("number", expression.at, what=wanted.what, range=limits)
    return value
