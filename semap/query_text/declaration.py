"""A text in SQL becomes the declaration of a continuous query, or is refused where it says something else."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from uuid import UUID

from semap.errors import InvalidInput
from semap.model.continuous_query import Declaration, Side
from semap.query_text.condition import Cql2, condition, require_readable, together
from semap.query_text.payload import payload_of
from semap.query_text.refusal import Refusal
from semap.query_text.relation import Relation, distance_between, is_spatial, near_by, relation_of
from semap.query_text.scope import Scope, Source, near, sides_of, whole
from semap.query_text.syntax import read
from semap.query_text.tree import Call, Column, Constant, Expression, Property, Range, Select, Subquery, Table
from semap.query_text.views import View, views_of

Known = Mapping[str, tuple[View, ...]]


def declaration_of(name: str, sql: str, concepts: Collection[str]) -> Declaration:
    """What a SELECT over a track or instances and a view of the map asks to be kept.

    concepts  the names of all there are, which have views
    raises    InvalidInput with line and column of what cannot be kept, why, and what to write instead
    """
    known = views_of(concepts)
    try:
        return _Reading(known).declaration(name, read(sql, lambda word: word if word in known else None))
    except Refusal as refusal:
        raise InvalidInput(refusal.message, refusal.remedy, _place(sql, refusal.at)) from refusal


def _place(sql: str, at: int | None) -> str:
    if at is None:
        return ""
    before = sql[:at]
    return f"line {before.count(chr(10)) + 1}, column {at - (before.rfind(chr(10)) + 1) + 1}"


@dataclass
class _Found:
    """What the conditions say, as it is gathered."""

    relations: list[tuple[Relation, int]] = field(default_factory=list)
    wheres: tuple[list[Cql2], list[Cql2]] = field(default_factory=lambda: ([], []))
    uids: list[list[UUID] | None] = field(default_factory=lambda: [None, None])
    is_apart: bool = False


class _Reading:
    """One text."""

    def __init__(self, known: Known) -> None:
        self.known = known
        self.found = _Found()
        self.sources: tuple[Source, ...] = ()
        self.views: tuple[View, View]
        self.concepts: list[str | None] = []
        self.limited: int | None = None

    def declaration(self, name: str, select: Select) -> Declaration:
        if select.order is not None:
            raise Refusal("order", select.order.at)
        if select.limit is not None:
            raise Refusal("limit", select.limit.at)
        self._name_sources(select.ranges)
        scope = Scope(self.sources)
        for n, each in enumerate(select.ranges):
            if isinstance(each, Subquery):
                self._read_subquery(n, each)
        for condition_ in select.conditions:
            for part in _conjuncts(condition_):
                self._take(scope.resolved(part), is_outer=True)
        relation = self._relation(select)
        sides = [
            Side(
                each.view.kind,
                self.concepts[each.side],
                None if (uids := self.found.uids[each.side]) is None else tuple(uids),
                together(self.found.wheres[each.side]),
            )
            for each in self.sources
        ]
        return Declaration(
            name,
            relation.predicate,
            sides[relation.subject],
            sides[relation.object],
            payload=payload_of(select.outputs, scope, relation),
            **relation.parameters,
        )

    def _name_sources(self, ranges: Sequence[Range]) -> None:
        if len(ranges) != 2:
            at = ranges[2].at if len(ranges) > 2 else 0
            raise Refusal("one view", at, what=("nothing", "one")[len(ranges)] if len(ranges) < 2 else "more")
        named = Counter(each.alias for each in ranges)
        twice = next((alias for alias, count in named.items() if count > 1), None)
        if twice is not None:
            raise Refusal("alias twice", ranges[1].at, what=twice or "nothing")
        self.sources = tuple(self._source(n, each) for n, each in enumerate(ranges))
        first, second = self.sources
        self.views = (first.view, second.view)
        self.concepts = [first.view.concept, second.view.concept]

    def _source(self, side: int, range_: Range) -> Source:
        if isinstance(range_, Table):
            return whole(side, range_.alias, self._view(range_))
        inner = range_.select.ranges
        if len(inner) != 1 or not isinstance(inner[0], Table):
            raise Refusal("inner subquery", range_.at)
        source = whole(side, inner[0].alias, self._view(inner[0]))
        columns: dict[str, str] = {}
        for output in range_.select.outputs:
            column = output.expression
            if not isinstance(column, Column):
                raise Refusal("computed", output.at)
            if column.name == "*":
                if column.table is not None:
                    Scope((source,)).source(column.table, column.at)
                named = dict(source.columns)
            else:
                taken = Scope((source,)).column(column)
                if not isinstance(taken, Property):
                    raise Refusal("whole row", column.at, what=source.alias)
                named = {output.alias or column.name: taken.name}
            twice = next((each for each in named if each in columns), None)
            if twice is not None:
                raise Refusal("same name", output.at, what=twice)
            columns |= named
        return Source(side, range_.alias, source.view, columns)

    def _view(self, table: Table) -> View:
        views = self.known.get(table.name, ())
        if not views:
            raise Refusal("no view", table.at, what=table.name, hint=near(table.name, self.known))
        if len(views) > 1:
            names = [str(each.concept) for each in views]
            raise Refusal("shared view", table.at, what=" and ".join(names), first=names[0])
        return views[0]

    def _read_subquery(self, side: int, range_: Subquery) -> None:
        """The conditions within a subquery, and what is nearest."""
        select = range_.select
        table = select.ranges[0]
        outer = Scope(self.sources[:side]) if range_.lateral else None
        scope = Scope((whole(side, table.alias, self.sources[side].view),), outer)
        for condition_ in select.conditions:
            for part in _conjuncts(condition_):
                self._take(self._within(scope, side, part), is_outer=False)
        if select.order is None and select.limit is None:
            return
        if select.limit is None:
            raise Refusal("no limit", range_.at)
        if select.order is None:
            raise Refusal("unordered limit", select.limit.at)
        order, count = self._within(scope, side, select.order), select.limit.value
        between = distance_between(order)
        if between is None:
            raise Refusal("order by", select.order.at)
        if not isinstance(count, int) or isinstance(count, bool) or not 1 <= count <= MOST:
            raise Refusal("limit count", select.limit.at)
        nearest = replace(near_by(*between, self.views).told(count=count), predicate="nearest")
        self.limited = side
        self.found.relations.append((replace(nearest, subject=1 - side, object=side), order.at))

    def _within(self, scope: Scope, side: int, part: Expression) -> Expression:
        """A part of a subquery, resolved; what it reads of the other side it may read."""
        try:
            return scope.resolved(part)
        except Refusal as refusal:
            if scope.outer is None and side == 1 and refusal.reason in ("no table", "column"):
                what = self.sources[0].alias
                try:
                    Scope(scope.sources, Scope(self.sources[:1])).resolved(part)
                except Refusal:
                    raise refusal from None
                raise Refusal("not lateral", refusal.at, what=what) from refusal
            raise

    def _take(self, part: Expression, *, is_outer: bool) -> None:
        """One of the conditions of which all must be true."""
        if part == Constant(True):
            return
        if is_spatial(part):
            self.found.relations.append((relation_of(part, self.views), part.at))
            return
        sides = sides_of(part)
        if len(sides) == 2:
            self._take_pair(part, is_outer)
            return
        if not sides:
            condition(part, self.views[0])
            raise Refusal("no column", part.at)
        (side,) = sides
        if is_outer and side == self.limited:
            raise Refusal("after limit", part.at)
        uids = _uids(part)
        if uids is not None:
            before = self.found.uids[side]
            both = uids if before is None else [each for each in before if each in uids]
            if not both:
                raise Refusal("no uid", part.at)
            self.found.uids[side] = both
            return
        where = condition(part, self.views[side])
        if self._is_of_concept(side, where):
            return
        require_readable(where, self.views[side].kind, part.at)
        self.found.wheres[side].append(where)

    def _is_of_concept(self, side: int, where: Cql2) -> bool:
        """Whether a condition says of which concept the instances are, as a view of them would."""
        match where:
            case {"op": "isA", "args": [str() as concept]} if self.concepts[side] in (None, concept):
                self.concepts[side] = concept
                return True
        return False

    def _take_pair(self, part: Expression, is_outer: bool) -> None:
        """What may stand between the sides beside the relation: one map, and two things."""
        match part:
            case Call(op="=", args=(Property(name="map" | "map_id" as a), Property(name=b))) if a == b:
                return
            case Call(op="<>", args=(Property(name="id" | "uid" as a), Property(name=b))) if a == b:
                if is_outer and self.limited is not None:
                    raise Refusal("after limit", part.at)
                self.found.is_apart = True
                return
            case Call(
                op="<" | ">" | "<=" | ">=",
                args=(Property(name="id" | "uid"), Property(name="id" | "uid")),
                at=at,
            ):
                raise Refusal("half pairs", at, first=self.sources[0].alias, second=self.sources[1].alias)
            case Call(args=args, at=at) if any(
                isinstance(each, Property) and each.name in HEIGHTS for each in args
            ):
                raise Refusal("heights", at)
        raise Refusal("between sides", part.at)

    def _relation(self, select: Select) -> Relation:
        if not self.found.relations:
            raise Refusal("no relation", select.ranges[1].at)
        if len(self.found.relations) > 1:
            raise Refusal("two relations", self.found.relations[1][1])
        ((relation, at),) = self.found.relations
        first, second = self.sources
        may_be_one = first.view == second.view or (
            first.view.kind == second.view.kind and None in (first.view.concept, second.view.concept)
        )
        if may_be_one and not self.found.is_apart:
            raise Refusal("itself", at, first=first.alias, second=second.alias)
        return relation


MOST = 100
"""So many nearest are kept at most."""
HEIGHTS = ("z_m", "z_min_m", "z_max_m")


def _conjuncts(expression: Expression) -> Iterator[Expression]:
    match expression:
        case Call(op="and", args=args):
            for each in args:
                yield from _conjuncts(each)
        case _:
            yield expression


def _uids(part: Expression) -> list[UUID] | None:
    """The uids that a condition asks for; None of another condition."""
    match part:
        case Call(op="=", args=(Property(name="uid"), Constant() as one)):
            items: tuple[Expression, ...] = (one,)
        case Call(op="=", args=(Constant() as one, Property(name="uid"))):
            items = (one,)
        case Call(op="in", args=(Property(name="uid"), *listed)):
            items = tuple(listed)
        case _:
            return None
    found = []
    for each in items:
        text = each.value if isinstance(each, Constant) else None
        try:
            found.append(UUID(text if isinstance(text, str) else ""))
        except ValueError as error:
            raise Refusal("uid", each.at, what=f"'{text}'" if isinstance(text, str) else "this") from error
    return list(dict.fromkeys(found))
