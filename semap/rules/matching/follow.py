"""Which positions may follow which: a pattern unrolled (Glushkov's construction, with preference).

A **position** is one place of the unrolled pattern that binds a row: a variable and the **frames** around it,
each a part of the pattern and how far that part has come. Rounds without end share one frame. `after` walks
from a position to every position that may bind the next row, the preferred ones first, and gathers on the
way what stands between the two: the joint, the absences, the conditions that end a repetition.

Three rules that the definition in `pattern` leaves open:
* The joint between two rows is that of the innermost part that holds both, on its element with the second.
  So the first row that a group binds takes the joint of the group, whichever of its elements binds it.
* A round beyond the least that binds no row is the last (as in Perl), so that no walk goes in circles.
* Ways to the same position over the same things in between are one way, the preferred.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

from semap.errors import InvalidInput
from semap.rules.pattern import (
    Absent,
    Alternation,
    Anchor,
    Joint,
    Node,
    Permutation,
    Repeat,
    Sequence,
    Variable,
)

POSITIONS_AT_MOST = 300
VISITS_AT_MOST = 100_000
DEEPEST = 1 << 30
END = "$"
"""The absence of any row."""


@dataclass(frozen=True, eq=False, slots=True)
class Frame:
    """A part of the pattern around a position, compared by identity.

    progress  a sequence: (element,); a repetition: (round,); a permutation: the nodes that are left
    depth     1 is outermost
    """

    around: Sequence | Permutation | Repeat
    progress: tuple[int, ...]
    parent: Frame | None
    depth: int


class Position(NamedTuple):
    """Binds one row to the variable."""

    variable: str
    frame: Frame | None


class Between(NamedTuple):
    """What may stand between a row and the next one bound.

    element   the part that the joint belongs to, None at the start; rows satisfy a part, not a position
    absences  names of conditions; True: asked of the very next row only
    depth     of the innermost frame that the row before shares
    opened    rounds beyond the least that have begun since the row before
    begins    whether the next row bound is the first of its partition (`^`)
    """

    joint: Joint
    element: Frame | None
    absences: tuple[tuple[str, bool], ...]
    depth: int
    opened: frozenset[Frame]
    begins: bool = False


class Step(NamedTuple):
    """To a position, or to the end of the pattern (None).

    staying   conditions that no row up to and with the next one bound may satisfy
    entering  conditions that the next row bound may not satisfy
    """

    to: Position | None
    between: Between
    staying: tuple[str, ...] = ()
    entering: tuple[str, ...] = ()


Place: TypeAlias = tuple[Node | None, Frame | None, Between]
"""About to enter the node in the frame; without a node: having left what the frame is around."""


class Following:
    """The unrolled pattern: `start()` and `after(position)` give steps, preferred first.

    Both raise InvalidInput once all walks together have made more than VISITS_AT_MOST visits.
    """

    def __init__(self, pattern: Node) -> None:
        self._pattern = pattern
        self._visits = 0
        self._frames: dict[tuple[int, tuple[int, ...], Frame | None], Frame] = {}

    def start(self) -> tuple[Step, ...]:
        between = Between("next", None, (), 0, frozenset())
        return tuple(self._walk((self._pattern, None, between)))

    def after(self, position: Position) -> tuple[Step, ...]:
        between = Between("next", None, (), DEEPEST, frozenset())
        return tuple(self._walk((None, position.frame, between)))

    def _walk(self, place: Place) -> Iterator[Step]:
        seen = set()
        found = set()
        to_visit = [place]
        while to_visit:
            node, frame, between = place = to_visit.pop()
            key = (id(node), frame, between)
            if key in seen:
                continue
            seen.add(key)
            self._visits += 1
            if self._visits > VISITS_AT_MOST:
                raise InvalidInput(
                    "The pattern has too many ways from one row to the next once its counts are written out.",
                    "Use smaller counts, or A{0,9} in place of (A?){9}.",
                )
            if isinstance(node, Variable) or (node is None and frame is None):
                step = _step(node.label if node else None, frame, between)
                if (known := (step.to, *_constraints(step))) not in found:
                    found.add(known)
                    yield step
            else:
                to_visit.extend(reversed(tuple(self._next_places(place))))

    def _next_places(self, place: Place) -> Iterator[Place]:
        node, frame, between = place
        match node:
            case Absent():
                absence = (node.name, between.joint == "next")
                yield None, frame, between._replace(absences=(*between.absences, absence))
            case Anchor():
                yield from _anchored(node, frame, between)
            case Sequence(()):
                yield None, frame, between
            case Sequence():
                yield node.elements[0].node, self._frame(node, (0,), frame), between
            case Alternation():
                for option in node.options:
                    yield option, frame, between
            case Permutation():
                yield from self._choices(node, tuple(range(len(node.nodes))), frame, between, joined=False)
            case Repeat():
                yield from self._rounds(node, 0, frame, between)
            case _:
                yield from self._left(frame, between)

    def _left(self, frame: Frame | None, between: Between) -> Iterator[Place]:
        assert frame is not None  # noqa: S101
        around, parent = frame.around, frame.parent
        match around:
            case Sequence():
                index = frame.progress[0] + 1
                if index == len(around.elements):
                    yield None, parent, between
                else:
                    element = around.elements[index]
                    into = self._frame(around, (index,), parent)
                    yield element.node, into, _joined(between, element.joint, into)
            case Permutation() if frame.progress:
                yield from self._choices(around, frame.progress, parent, between, joined=True)
            case Permutation():
                yield None, parent, between
            case Repeat():
                if frame in between.opened:
                    yield None, parent, between
                else:
                    yield from self._rounds(around, frame.progress[0], parent, between)

    def _choices(
        self,
        around: Permutation,
        left: tuple[int, ...],
        parent: Frame | None,
        between: Between,
        *,
        joined: bool,
    ) -> Iterator[Place]:
        for index in left:
            # what may follow depends on what is left, so that orders of the same nodes share their frames
            into = self._frame(around, tuple(other for other in left if other != index), parent)
            yield around.nodes[index], into, _joined(between, around.joint, into) if joined else between

    def _rounds(self, around: Repeat, done: int, parent: Frame | None, between: Between) -> Iterator[Place]:
        leave: Place = (None, parent, between)
        if done == around.most:
            yield leave
            return
        endless_from = max(around.least, 1)
        into = self._frame(
            around, (min(done + 1, endless_from) if around.most is None else done + 1,), parent
        )
        if done:
            between = _joined(between, around.joint, into)
        if done < around.least:
            yield around.node, into, between
            return
        another: Place = (around.node, into, between._replace(opened=between.opened | {into}))
        yield from (another, leave) if around.greedy else (leave, another)

    def _frame(
        self, around: Sequence | Permutation | Repeat, progress: tuple[int, ...], parent: Frame | None
    ) -> Frame:
        key = (id(around), progress, parent)
        if key not in self._frames:
            self._frames[key] = Frame(around, progress, parent, parent.depth + 1 if parent else 1)
        return self._frames[key]


def may_be_empty(pattern: Node) -> bool:
    """Whether it can match without binding a row."""
    return any(step.to is None for step in Following(pattern).start())


def _anchored(anchor: Anchor, frame: Frame | None, between: Between) -> Iterator[Place]:
    """Past an anchor, if that can be: before a begin stands no row, before an end at least one."""
    no_row_yet = between.depth == 0
    if anchor.at == "begin" and no_row_yet:
        yield None, frame, between._replace(begins=True)
    elif anchor.at == "end" and not no_row_yet:
        yield None, frame, between._replace(absences=(*between.absences, (END, False)))


def _joined(between: Between, joint: Joint, into: Frame) -> Between:
    """Past a joint: it counts unless a part further out has set one since the row before."""
    if into.depth > between.depth:
        return between
    return between._replace(joint=joint, element=into, depth=into.depth)


def _step(name: str | None, frame: Frame | None, between: Between) -> Step:
    if name is None:
        return Step(None, between)
    staying: list[str] = []
    entering: list[str] = []
    outer = frame
    while outer is not None:
        if isinstance(outer.around, Repeat) and outer.around.until is not None:
            (staying if outer.depth <= between.depth else entering).append(outer.around.until)
        outer = outer.parent
    return Step(Position(name, frame), between, tuple(staying), tuple(entering))


def _constraints(step: Step) -> tuple[object, ...]:
    between = step.between
    return between.joint, between.element, between.absences, between.begins, step.staying, step.entering


def positions(following: Following) -> dict[Position, tuple[Step, ...]]:
    """Every position that can be reached, in the order of discovery, with the steps after it.

    raises  InvalidInput if there are more than POSITIONS_AT_MOST, or too many ways between them
    """
    found: dict[Position, tuple[Step, ...]] = {}
    to_visit = [step.to for step in reversed(following.start()) if step.to]
    while to_visit:
        position = to_visit.pop()
        if position in found:
            continue
        if len(found) == POSITIONS_AT_MOST:
            raise InvalidInput(
                f"The pattern has more than {POSITIONS_AT_MOST} positions once its counts are written out.",
                "Use smaller counts, or + with a condition on count().",
            )
        found[position] = following.after(position)
        to_visit.extend(step.to for step in reversed(found[position]) if step.to)
    return found
