"""Pairs, futures and fates by trying everything: slow, and with nothing in common with the package."""

from __future__ import annotations

from functools import cache
from itertools import product

Stamps = tuple[int, ...]
Pairs = frozenset[tuple[int, int]]


@cache
def best_pairs(a: Stamps, b: Stamps, tolerance: int) -> Pairs:
    """The smallest gap first, of equal ones the earlier; no record twice, no two pairs that cross."""
    taken: set[tuple[int, int]] = set()
    for _, _, x, y in sorted((abs(x - y), x + y, x, y) for x, y in product(a, b) if abs(x - y) <= tolerance):
        if all(x != p and y != q and (x < p) == (y < q) for p, q in taken):
            taken.add((x, y))
    return frozenset(taken)


@cache
def all_ways_on(frontier: int, period: int, horizon: int) -> tuple[Stamps, ...]:
    """All that a source may still send before the horizon."""
    ways: list[Stamps] = [()]
    for first in range(frontier, horizon):
        ways += [(first, *rest) for rest in all_ways_on(first + period, period, horizon)]
    return tuple(ways)


def certain_fates(
    a: Stamps, b: Stamps, frontiers: tuple[int, int], periods: tuple[int, int], tolerance: int, horizon: int
) -> dict[tuple[str, int], int | None]:
    """Records (side, stamp) whose partner is the same in every future, with that partner's stamp."""
    seen: dict[tuple[str, int], set[int | None]] = {("a", x): set() for x in a} | {("b", y): set() for y in b}
    ways_a = all_ways_on(frontiers[0], periods[0], horizon)
    ways_b = all_ways_on(frontiers[1], periods[1], horizon)
    for more_a, more_b in product(ways_a, ways_b):
        pairs = best_pairs(a + more_a, b + more_b, tolerance)
        of_a, of_b = dict(pairs), {y: x for x, y in pairs}
        for x in a:
            seen["a", x].add(of_a.get(x))
        for y in b:
            seen["b", y].add(of_b.get(y))
    return {record: next(iter(fates)) for record, fates in seen.items() if len(fates) == 1}
