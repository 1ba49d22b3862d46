"""The order in which rules read one another's events: what is read comes first."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from graphlib import CycleError, TopologicalSorter

from semap.errors import InvalidInput


def order_of_rules(inputs: Mapping[str, Iterable[str]]) -> tuple[str, ...]:
    """The rules, those that others read before them, and by name where either order would do.

    inputs  of each rule, the names that it reads; a name that is no rule's counts for nothing
    raises  InvalidInput that names the cycle, if rules read one another in a circle
    """
    sorter = TopologicalSorter(
        {name: sorted(set(read) & inputs.keys()) for name, read in sorted(inputs.items())}
    )
    try:
        sorter.prepare()
    except CycleError as error:
        circle = " reads ".join(reversed(error.args[1]))
        raise InvalidInput(
            f"rules read one another in a circle: {circle}", "Let one of them read something else.", "input"
        ) from error
    order: list[str] = []
    while sorter.is_active():
        ready = sorted(sorter.get_ready())
        order += ready
        sorter.done(*ready)
    return tuple(order)
