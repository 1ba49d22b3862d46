"""A rule in force: a declaration on a map, in a version."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import cast

from semap.rules.declaration import Declaration, Input
from semap.rules.language.reading import parse_declaration
from semap.rules.row import Source


@dataclass(frozen=True)
class Rule:
    """A declaration in force.

    queries  the ids of the continuous queries that it reads, by name
    """

    rule_id: int
    map_id: int
    version: int
    enabled: bool
    declaration: Declaration
    queries: Mapping[str, int] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.declaration.name

    @staticmethod
    def from_json(rule_id: int, document: Mapping[str, object]) -> Rule:
        """Read what `semap.rule_json` of the database gives.

        raises InvalidInput where the declaration is none
        """
        queries = cast(Mapping[str, object], document.get("queries") or {})
        return Rule(
            rule_id=rule_id,
            map_id=int(str(document["map_id"])),
            version=int(str(document["version"])),
            enabled=bool(document["enabled"]),
            declaration=parse_declaration(document["declaration"], str(document["name"])),
            queries={name: int(str(query_id)) for name, query_id in queries.items()},
        )

    def as_json(self) -> dict[str, object]:
        return {
            "map_id": self.map_id,
            "name": self.name,
            "version": self.version,
            "enabled": self.enabled,
            "declaration": self.declaration.as_json(),
            "queries": dict(self.queries),
        }

    def among(self, rule_names: frozenset[str]) -> Rule:
        """The same rule, saying by itself what it reads on a map with rules of these names."""
        inputs = tuple(
            replace(item, kind="rule") if self.source_of(item, rule_names) == "event" else item
            for item in self.declaration.inputs
        )
        return replace(self, declaration=replace(self.declaration, inputs=inputs))

    def source_of(self, item: Input, rule_names: frozenset[str]) -> Source:
        """What the rows of an input are, on a map with rules of these names."""
        if item.kind == "map":
            return "map"
        if item.kind == "object_state":
            return "object_state"
        if item.kind == "query" or (item.kind is None and item.name in self.queries):
            return "relation"
        if item.kind == "rule" or item.name in rule_names:
            return "event"
        return "object_state"
