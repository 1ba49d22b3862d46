"""What the batch layer says of the events that the speed layer made.

Events of one rule, type and key are paired in the order of their stamps, so that as many as can be find a
partner within the reach, and the stamps of partners differ by as little as can be in all.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Literal
from uuid import UUID

Verdict = Literal["confirmed", "retracted", "amended"]


@dataclass(frozen=True)
class Finding:
    """An event as the comparison sees it.

    kind   rule, type and key: only events of one kind can be the same
    facts  what the event says beside its stamp; partners that differ in it are no confirmation
    """

    event_id: UUID
    kind: Hashable
    stamp_us: int
    facts: Hashable = None


@dataclass(frozen=True)
class Judgement:
    """confirmed: by an event that says the same; amended: by one that says otherwise; retracted: by none."""

    event_id: UUID
    verdict: Verdict
    by_event_id: UUID | None = None

    def as_json(self) -> dict[str, object]:
        return {
            "event_id": str(self.event_id),
            "verdict": self.verdict,
            "by_event_id": None if self.by_event_id is None else str(self.by_event_id),
        }


@dataclass(frozen=True)
class Comparison:
    """Of each event of the speed layer what became of it, and the events that only the batch layer found."""

    judgements: tuple[Judgement, ...]
    found: tuple[UUID, ...]


def compare(speed: Iterable[Finding], batch: Iterable[Finding], same_us: int, reach_us: int) -> Comparison:
    """Judge the events of the speed layer by those of the batch layer.

    same_us   partners whose stamps differ by at most this, and whose facts are the same, say the same
    reach_us  at most this far apart may partners be; at least `same_us`
    """
    judgements: list[Judgement] = []
    found: list[UUID] = []
    for ours, theirs in _clusters(speed, batch, reach_us):
        for mine, other in _pairs(ours, theirs, reach_us):
            if mine is None:
                found.append(other.event_id)  # type: ignore[union-attr]  # one of both is there
            elif other is None:
                judgements.append(Judgement(mine.event_id, "retracted"))
            elif abs(mine.stamp_us - other.stamp_us) <= same_us and mine.facts == other.facts:
                judgements.append(Judgement(mine.event_id, "confirmed"))
            else:
                judgements.append(Judgement(mine.event_id, "amended", other.event_id))
    return Comparison(tuple(judgements), tuple(found))


def _clusters(
    speed: Iterable[Finding], batch: Iterable[Finding], reach_us: int
) -> Iterator[tuple[list[Finding], list[Finding]]]:
    """Findings of one kind that a chain of steps within the reach joins: no pair leaves its cluster."""
    marked = [(finding, True) for finding in speed] + [(finding, False) for finding in batch]
    marked.sort(key=lambda each: (str(each[0].kind), each[0].stamp_us, each[0].event_id))
    for _, of_kind in groupby(marked, key=lambda each: each[0].kind):
        cluster: tuple[list[Finding], list[Finding]] = ([], [])
        last_us: int | None = None
        for finding, is_speed in of_kind:
            if last_us is not None and finding.stamp_us - last_us > reach_us:
                yield cluster
                cluster = ([], [])
            cluster[not is_speed].append(finding)
            last_us = finding.stamp_us
        yield cluster


def _pairs(
    ours: Sequence[Finding], theirs: Sequence[Finding], reach_us: int
) -> list[tuple[Finding | None, Finding | None]]:
    """The alignment of two sequences with most pairs, and of those the one with the least sum of gaps."""
    best: list[list[tuple[int, int]]] = [[(0, 0)] * (len(theirs) + 1) for _ in range(len(ours) + 1)]
    for i in range(len(ours) - 1, -1, -1):
        for k in range(len(theirs) - 1, -1, -1):
            gap_us = abs(ours[i].stamp_us - theirs[k].stamp_us)
            choices = [best[i + 1][k], best[i][k + 1]]
            if gap_us <= reach_us:
                unpaired, cost_us = best[i + 1][k + 1]
                choices.append((unpaired - 1, cost_us + gap_us))
            best[i][k] = min(choices)
    pairs: list[tuple[Finding | None, Finding | None]] = []
    i = k = 0
    while i < len(ours) and k < len(theirs):
        gap_us = abs(ours[i].stamp_us - theirs[k].stamp_us)
        unpaired, cost_us = best[i + 1][k + 1]
        if gap_us <= reach_us and best[i][k] == (unpaired - 1, cost_us + gap_us):
            pairs.append((ours[i], theirs[k]))
            i, k = i + 1, k + 1
        elif best[i][k] == best[i + 1][k]:
            pairs.append((ours[i], None))
            i += 1
        else:
            pairs.append((None, theirs[k]))
            k += 1
    return [*pairs, *((mine, None) for mine in ours[i:]), *((None, other) for other in theirs[k:])]
