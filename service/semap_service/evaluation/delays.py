"""How long after the last record that affects an event the event is out: the paper's Fig. 5.

A recording is played at its own pace. The clock of an event starts when the record was due that completed
what the event is made of, whether or not semap was ready to take it, and stops when a client has the event.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from semap_ingest.pipeline.found import Found
from semap_ingest.pipeline.ingest_recording import Plan, ingest_recording
from semap_ingest.pipeline.pace import Pace

from semap_service.evaluation.play import listening, wait_for_rules

DOOR_EVENTS = ("door_opening", "door_opened", "door_closing", "door_closed")
PERSON_EVENTS = ("person_entered", "person_left")


@dataclass(frozen=True)
class Delays:
    """Of one play [ms]; `unknown` events whose record was not found, which should be none."""

    door_ms: tuple[float, ...]
    person_ms: tuple[float, ...]
    unknown: int


def measure_delays(dsn: str, plan: Plan) -> Delays:
    """Play once, at the recording's own pace."""
    plan = replace(plan, speed=1.0)
    pace = Pace(1.0)
    sent_us: dict[tuple[str, int], int] = {}

    def remember(found: Found) -> None:
        sent_us.update({("person", each.states.stamp_us): each.sent_us for each in found.persons})
        sent_us.update({("door", each.lines.stamp_us): each.sent_us for each in found.lines})

    with listening(dsn, plan.map_name) as events:
        ingest_recording(dsn, plan, committed=remember, pace=pace)
        wait_for_rules(dsn)
    of_kind: dict[str, list[float]] = {"door": [], "person": []}
    unknown = 0
    for event in events:
        kind = "door" if event.type in DOOR_EVENTS else "person" if event.type in PERSON_EVENTS else None
        if kind is None:
            continue
        begun_us = sent_us.get((kind, event.stamp_us))
        if begun_us is None:
            unknown += 1
        else:
            of_kind[kind].append((event.received_s - pace.due_s(begun_us)) * 1e3)
    return Delays(tuple(of_kind["door"]), tuple(of_kind["person"]), unknown)


def row(name: str, kind: str, delays_ms: Sequence[float]) -> dict[str, object]:
    """A line of the table."""
    if not delays_ms:
        return {"images": name, "events": kind, "count": 0}
    p25, p50, p75, p99 = np.percentile(delays_ms, [25, 50, 75, 99])
    return {
        "images": name,
        "events": kind,
        "count": len(delays_ms),
        "p25_ms": round(float(p25), 1),
        "median_ms": round(float(p50), 1),
        "p75_ms": round(float(p75), 1),
        "p99_ms": round(float(p99), 1),
        "max_ms": round(float(max(delays_ms)), 1),
    }
