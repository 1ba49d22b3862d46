"""The log's events beside those that the batch layer found: what to write."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from uuid import UUID

from semap.batch.verdict import Finding, Judgement, compare
from semap.model.event import Event
from semap.model.given_up import GivenUp
from semap.timeline.stamp import to_us


@dataclass(frozen=True)
class Logged:
    """An event of the log.

    by_batch  an earlier run added it
    """

    event_id: UUID
    rule_name: str
    type: str
    key: Mapping[str, object]
    track_id: int | None
    instance_id: int | None
    stamp: datetime
    by_batch: bool
    track_name: str | None
    instance_name: str | None


@dataclass(frozen=True)
class Changed:
    """An event that the log had otherwise.

    verdict   amended, retracted or added
    by_stamp  of an amended one: when it happened in truth
    """

    verdict: str
    stamp: datetime
    type: str
    rule: str
    track: str | None
    instance: str | None
    by_stamp: datetime | None = None


@dataclass(frozen=True)
class Outcome:
    """What a run says.

    judgements  on each event of the log; those of earlier runs that still hold have none
    events      that the log lacks, or with which it amends others
    changed     in the order of stamps
    run_id      None of a run that only looked
    given_up    by the name of the rule, because too much was under way in a key: what it found lacks these
    """

    judgements: Sequence[Judgement]
    events: Sequence[Event]
    changed: Sequence[Changed]
    run_id: int | None = None
    given_up: Mapping[str, GivenUp] = field(default_factory=dict)

    def counts(self) -> dict[str, int]:
        verdicts = Counter(judgement.verdict for judgement in self.judgements)
        return {
            "confirmed": verdicts["confirmed"],
            "amended": verdicts["amended"],
            "retracted": verdicts["retracted"],
            "added": sum(change.verdict == "added" for change in self.changed),
        }

    def of_run(self, run_id: int) -> Outcome:
        return replace(self, run_id=run_id)


def judge(logged: Sequence[Logged], found: Sequence[Event], same_s: float, reach_s: float) -> Outcome:
    """Judge the events of the speed layer; those that earlier runs added hold if they were found again."""
    by_id = {event.event_id: event for event in found}
    speed = {event.event_id: event for event in logged if not event.by_batch}
    comparison = compare(
        [_finding(event) for event in speed.values()],
        [_finding(event) for event in by_id.values()],
        round(same_s * 1e6),
        round(reach_s * 1e6),
    )
    amending = {each.by_event_id for each in comparison.judgements if each.by_event_id is not None}
    wanted = amending | set(comparison.found)
    stale = [event for event in logged if event.by_batch and event.event_id not in wanted]
    judgements = [*comparison.judgements, *(Judgement(event.event_id, "retracted") for event in stale)]
    of_log = {event.event_id: event for event in logged}
    changed = [
        _changed(
            of_log[each.event_id], each.verdict, by_id.get(each.by_event_id) if each.by_event_id else None
        )
        for each in judgements
        if each.verdict != "confirmed"
    ]
    changed += [_changed(by_id[event_id], "added") for event_id in comparison.found]
    return Outcome(
        judgements,
        [event for event in found if event.event_id in wanted and event.event_id not in of_log],
        sorted(changed, key=lambda change: (change.stamp, change.rule, change.type)),
    )


def _finding(event: Event | Logged) -> Finding:
    about: Hashable = (
        event.rule_name,
        event.type,
        event.track_id or 0,
        event.instance_id or 0,
        json.dumps(event.key, sort_keys=True),
    )
    return Finding(event.event_id, about, to_us(event.stamp))


def _changed(event: Event | Logged, verdict: str, by: Event | None = None) -> Changed:
    return Changed(
        verdict, event.stamp, event.type, event.rule_name, event.track_name, event.instance_name,
        by.stamp if by is not None else None,
    )  # fmt: skip
