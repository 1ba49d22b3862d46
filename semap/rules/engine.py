"""From changes to events.

The state is the set of rules in force. `step` takes one input in the order of the log: a change of
a relation, or a change of a rule, which is in force for what follows it in the log. Same state and
same inputs give the same events with the same ids, so that a worker may repeat after a crash what
it had not committed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from uuid import UUID, uuid5

from semap.model.event import Event
from semap.model.relation import RelationChange
from semap.rules.declaration import Declaration, parse_declaration

EVENT_NAMESPACE = UUID("5f0c1f0e-6c1a-5b8e-9d55-0a6d3a3c9f11")


@dataclass(frozen=True)
class Rule:
    """A declaration in force: on which map, in which version, over which continuous query."""

    map_id: int
    query_id: int
    version: int
    enabled: bool
    declaration: Declaration

    @staticmethod
    def from_json(document: Mapping[str, object]) -> Rule:
        """Read what `semap.rule_json` of the database gives."""
        return Rule(
            map_id=int(str(document["map_id"])),
            query_id=int(str(document["query_id"])),
            version=int(str(document["version"])),
            enabled=bool(document["enabled"]),
            declaration=parse_declaration(document["declaration"], str(document["name"])),
        )

    def as_json(self) -> dict[str, object]:
        return {
            "map_id": self.map_id,
            "query_id": self.query_id,
            "version": self.version,
            "enabled": self.enabled,
            "name": self.declaration.name,
            "declaration": self.declaration.as_json(),
        }


@dataclass(frozen=True)
class RuleChanged:
    """A rule was added or edited, or removed (`rule` is None)."""

    rule_id: int
    rule: Rule | None


@dataclass(frozen=True)
class RuleSet:
    """The rules in force, by id, ascending."""

    rules: Mapping[int, Rule] = field(default_factory=lambda: MappingProxyType({}))

    def step(self, item: RelationChange | RuleChanged) -> tuple[RuleSet, tuple[Event, ...]]:
        """The state after `item`, and the events that it makes, in the order of the rules' ids."""
        if isinstance(item, RuleChanged):
            return self._with_rule(item), ()
        return self, tuple(
            event
            for rule in self.rules.values()
            if rule.enabled and rule.query_id == item.query_id
            for event in _events(rule, item)
        )

    def _with_rule(self, item: RuleChanged) -> RuleSet:
        rules = {rule_id: rule for rule_id, rule in self.rules.items() if rule_id != item.rule_id}
        if item.rule is not None:
            rules[item.rule_id] = item.rule
        return replace(self, rules=MappingProxyType(dict(sorted(rules.items()))))

    @staticmethod
    def from_json(document: Mapping[str, Mapping[str, object]]) -> RuleSet:
        rules = {int(key): Rule.from_json(value) for key, value in document.items()}
        return RuleSet(MappingProxyType(dict(sorted(rules.items()))))

    def as_json(self) -> dict[str, dict[str, object]]:
        return {str(rule_id): rule.as_json() for rule_id, rule in self.rules.items()}


def _events(rule: Rule, change: RelationChange) -> tuple[Event, ...]:
    kind = rule.declaration.began if change.kind == "began" else rule.declaration.ended
    if kind is None:
        return ()
    return (
        Event(
            event_id=event_id(rule, kind, (change.uid,)),
            map_id=change.map_id,
            rule_name=rule.declaration.name,
            rule_version=rule.version,
            type=kind,
            stamp=change.stamp,
            cause=change.cause,
            track_id=change.track_id,
            track_name=change.track_name,
            instance_id=change.instance_id,
            instance_name=change.instance_name,
            since=change.since,
            evidence=(change.uid,),
        ),
    )


def event_id(rule: Rule, kind: str, evidence: tuple[UUID, ...]) -> UUID:
    """The identity of an event: a function of rule, version, type and evidence (UUID version 5)."""
    parts = (rule.declaration.name, str(rule.version), kind, *map(str, evidence))
    return uuid5(EVENT_NAMESPACE, "|".join(parts))
