"""Sets of chains of bound rows, in parts that they share, and walked through only when they are asked for.

A set is a `Link` (a row bound to a variable after each chain of another set, or as the first row) or a
`Union` of two sets that have no chain in common. So a row adds a few parts to what is there, however many
chains that makes (the timed enumerable compact sets of M. Bucchi et al., CORE: a Complex Event Recognition
Engine, PVLDB 2022).

Chains are known by the number of their first row, which grows with each. Those below a number may be left
out, as windows end; a set says which number is its newest, so that no walk looks in vain.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from semap.rules.bound import Bound
from semap.rules.row import Row


@dataclass(slots=True, eq=False)
class Link:
    """before: None where the row is the first."""

    variable: str
    row: Row
    before: Chains | None
    newest: int


@dataclass(slots=True, eq=False)
class Union:
    """Of two sets; `left` is walked through first."""

    left: Chains
    right: Chains
    newest: int


Chains: TypeAlias = Link | Union


def joined(left: Chains, right: Chains) -> Union:
    """Of sets that have no chain in common."""
    return Union(left, right, left.newest if left.newest > right.newest else right.newest)


def walk(chains: Chains, oldest: int) -> Iterator[tuple[Row, Bound]]:
    """The chains that begin with row `oldest` or later, each with its first row."""
    to_visit: list[tuple[Chains, Any]] = [(chains, None)]
    while to_visit:
        each, after = to_visit.pop()
        if each.newest < oldest:
            continue
        if isinstance(each, Union):
            to_visit.append((each.right, after))
            to_visit.append((each.left, after))
        elif each.before is not None:
            to_visit.append((each.before, (each, after)))
        else:
            bound = Bound(each.variable, each.row)
            while after is not None:
                link, after = after
                bound = Bound(link.variable, link.row, bound)
            yield each.row, bound


def needed(made: Sequence[Chains], sets: Iterable[Chains], oldest: int) -> list[Chains]:
    """The parts that chains of the sets from `oldest` on go through, each after those that it is made of.

    made  these parts and others, each after those that it is made of
    """
    wanted = set(map(id, sets))
    found: list[Chains] = []
    for each in reversed(made):
        if id(each) in wanted and each.newest >= oldest:
            found.append(each)
            wanted.update(map(id, parts_of(each)))
    found.reverse()
    return found


def parts_of(each: Chains) -> tuple[Chains, ...]:
    """What it is made of."""
    if isinstance(each, Union):
        return each.left, each.right
    return () if each.before is None else (each.before,)


def firsts(parts: Iterable[Chains]) -> list[int]:
    """The numbers of the rows that chains begin with, ascending."""
    return sorted({each.newest for each in parts if isinstance(each, Link) and each.before is None})


def renumbered(parts: Iterable[Chains], numbers: Mapping[int, int]) -> dict[int, Chains]:
    """New sets in place of these, by their identities, without those that `needed` left out.

    parts    as `needed` gives them
    numbers  new numbers of rows, by those that they had
    """
    new: dict[int, Chains] = {}
    for each in parts:
        if isinstance(each, Union):
            left, right = new.get(id(each.left)), new.get(id(each.right))
            both = left is not None and right is not None
            new[id(each)] = joined(left, right) if both else left or right  # type: ignore[arg-type, assignment]
        elif each.before is None:
            new[id(each)] = Link(each.variable, each.row, None, numbers[each.newest])
        else:
            before = new[id(each.before)]
            new[id(each)] = Link(each.variable, each.row, before, before.newest)
    return new


def counts(chains: Chains, parts: Sequence[Chains], end: int) -> list[int]:
    """How many chains begin with row 0 or later, with row 1 or later, and so on to `end`.

    parts  with all that it is made of, as `needed` gives them
    """
    ways = {id(chains): 1}
    found = [0] * (end + 1)
    for each in reversed(parts):
        way = ways.get(id(each))
        if way is None:
            continue
        if isinstance(each, Union):
            for part in (each.left, each.right):
                ways[id(part)] = ways.get(id(part), 0) + way
        elif each.before is not None:
            ways[id(each.before)] = ways.get(id(each.before), 0) + way
        else:
            found[each.newest] += way
    for place in range(end - 1, -1, -1):
        found[place] += found[place + 1]
    return found
