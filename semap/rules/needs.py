"""What a rule reads of its rows beyond what they bring with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from semap.rules.condition import reads
from semap.rules.declaration import Declaration, Edges

OF_ACTOR = frozenset({"actor", "actor_id", "actor_likelihood", "actor_distance_m"})
LOOKED_UP = OF_ACTOR | {"position", "footprint"}
"""Known once all rows before have come: they are asked of the database when the row is due."""

IN_ORDER = LOOKED_UP | {"occupants"}


@dataclass(frozen=True)
class Needs:
    """What the rows of which inputs need before the rules of a map take them.

    actor_within_m  the farthest distance that any rule asks for, by the name of the input
    position        names of inputs
    footprint       names of inputs
    actor_nearer_m  the shorter distances that other rules ask for: each has an actor of its own
    """

    actor_within_m: Mapping[str, float] = field(default_factory=dict)
    position: frozenset[str] = frozenset()
    footprint: frozenset[str] = frozenset()
    actor_nearer_m: Mapping[str, frozenset[float]] = field(default_factory=dict)

    def __or__(self, other: Needs) -> Needs:
        farthest, nearer = {}, {}
        for name in self.actor_within_m.keys() | other.actor_within_m.keys():
            asked_m = self._actor_within_m(name) | other._actor_within_m(name)
            farthest[name] = max(asked_m)
            nearer[name] = asked_m - {farthest[name]}
        return Needs(
            farthest,
            self.position | other.position,
            self.footprint | other.footprint,
            {name: asked_m for name, asked_m in nearer.items() if asked_m},
        )

    def _actor_within_m(self, name: str) -> frozenset[float]:
        """All distances that rules ask for in rows of an input."""
        if name not in self.actor_within_m:
            return frozenset()
        return self.actor_nearer_m.get(name, frozenset()) | {self.actor_within_m[name]}


def properties_read(declaration: Declaration) -> frozenset[str]:
    """Properties that a rule's clauses ask for, of whatever row."""
    expressions = [*declaration.define.values(), *declaration.measures.values()]
    if declaration.where is not None:
        expressions.append(declaration.where)
    keys = {name.partition(".")[0] for name in declaration.partition_by}
    return frozenset(keys).union(*map(reads, expressions))


def needs_of(declaration: Declaration) -> Needs:
    """What one rule needs."""
    read = properties_read(declaration)
    inputs = frozenset(item.name for item in declaration.inputs)
    within = {
        item.name: item.actor_within_m for item in declaration.inputs if item.actor_within_m is not None
    }
    return Needs(
        actor_within_m=within if read & OF_ACTOR else {},
        position=inputs if "position" in read else frozenset(),
        footprint=inputs if "footprint" in read else frozenset(),
    )


def needs_no_order(declaration: Declaration) -> bool:
    """Whether a rule finds the same in rows of any order: edges that need nothing looked up."""
    return isinstance(declaration.body, Edges) and not properties_read(declaration) & IN_ORDER
