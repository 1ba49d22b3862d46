"""Who takes what, so that nothing is taken twice and the sum of gains is greatest.

Each taker has choices, each a gain and the things that it takes (bits of an integer), or takes nothing.
Takers that have no thing in common are independent of one another. For the others: branch and bound. The
bound lets each taker have the best that is left to it, as if it were alone; where those are disjoint,
that is the best. Otherwise one of those who quarrel gets its wish, or has it struck off its list.

Exact up to `MAX_STEPS` steps for takers that have things in common; beyond, the best that was found.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

MAX_STEPS = 300
NOTHING_LEFT = 2**31


class Choice(NamedTuple):
    """gain above taking nothing; things as a bit mask, not 0; place that the caller knows it by."""

    gain: float
    things: int
    place: int


class _Node(NamedTuple):
    """Wishes that are granted, and for each taker the first choice that is not struck off."""

    gain: float
    things: int
    granted: tuple[tuple[int, Choice], ...]
    first: tuple[int, ...]


def best_disjoint(choices: Sequence[Sequence[Choice]]) -> list[int | None]:
    """For each taker the place of its choice, or None.

    Of equal sums the one that grants the best single wishes first.
    """
    ordered = [sorted((choice for choice in own if choice.gain > 0), reverse=True) for own in choices]
    taken: list[int | None] = [None] * len(choices)
    for takers in _that_share(ordered):
        for taker, choice in _search([ordered[taker] for taker in takers]):
            taken[takers[taker]] = choice.place
    return taken


def _that_share(choices: Sequence[Sequence[Choice]]) -> list[list[int]]:
    """Takers in groups; those of different groups have no thing in common."""
    groups: list[tuple[int, list[int]]] = []
    for taker, own in enumerate(choices):
        things, takers = 0, [taker]
        for choice in own:
            things |= choice.things
        apart = []
        for other_things, others in groups:
            if other_things & things:
                things |= other_things
                takers = others + takers
            else:
                apart.append((other_things, others))
        groups = [*apart, (things, takers)]
    return [takers for _, takers in groups]


def _search(choices: Sequence[Sequence[Choice]]) -> tuple[tuple[int, Choice], ...]:
    best: tuple[tuple[int, Choice], ...] = ()
    best_gain = 0.0
    stack = [_Node(0.0, 0, (), (0,) * len(choices))]
    for _ in range(MAX_STEPS):
        if not stack:
            break
        node = stack.pop()
        wishes = _wishes(choices, node)
        if node.gain + sum(wish.gain for _, _, wish in wishes) <= best_gain:
            continue
        granted, quarrel = _granted(wishes, node)
        gain = sum(choice.gain for _, choice in granted)
        if gain > best_gain:
            best, best_gain = granted, gain
        if quarrel is not None:
            stack += _branches(node, *quarrel)
    return best


def _wishes(choices: Sequence[Sequence[Choice]], node: _Node) -> list[tuple[int, int, Choice]]:
    """(taker, place in its list, choice): the best that is left to each, the greatest gain first."""
    wishes = []
    for taker, own in enumerate(choices):
        for place in range(node.first[taker], len(own)):
            if not own[place].things & node.things:
                wishes.append((taker, place, own[place]))
                break
    wishes.sort(key=_gain_of, reverse=True)
    return wishes


def _gain_of(wish: tuple[int, int, Choice]) -> float:
    return wish[2].gain


def _granted(
    wishes: Sequence[tuple[int, int, Choice]], node: _Node
) -> tuple[tuple[tuple[int, Choice], ...], tuple[int, int, Choice] | None]:
    """The wishes that do not collide with a greater one, and the greatest that another collides with."""
    granted = list(node.granted)
    things = node.things
    quarrel = None
    for taker, place, wish in wishes:
        if not wish.things & things:
            granted.append((taker, wish))
            things |= wish.things
        elif quarrel is None:
            quarrel = taker, place, wish
    if quarrel is not None:
        quarrel = next(each for each in wishes if each[2].things & quarrel[2].things)
    return tuple(granted), quarrel


def _branches(node: _Node, taker: int, place: int, wish: Choice) -> tuple[_Node, _Node]:
    """The wish struck off, and the wish granted."""
    first = list(node.first)
    first[taker] = place + 1
    struck = _Node(node.gain, node.things, node.granted, tuple(first))
    first[taker] = NOTHING_LEFT
    granted = (*node.granted, (taker, wish))
    return struck, _Node(node.gain + wish.gain, node.things | wish.things, granted, tuple(first))
