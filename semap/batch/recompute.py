"""Relations and rules once more over stored states, and what that says of the log of events.

The speed layer judges each state as it comes. Here tracks are smoothed over their whole length, edges are
crossed between states by the exact shapes, on the map as it is now, and the rules in force run over that. An
event of the log is then confirmed, amended by another, or retracted; what the log lacks is added. States of
objects, and relations of pairs, count as they were noted. All of it is one transaction; nothing of the log is
deleted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime, timedelta
from functools import reduce
from math import isinf
from operator import or_

import numpy as np
import psycopg
from psycopg.types.json import Jsonb

from semap.batch.crossing import Path, visits
from semap.batch.judging import Logged, Outcome, judge
from semap.batch.relation_rows import relation_rows
from semap.batch.smoothing import Motion, pieces, smooth
from semap.batch.stored_tracks import (
    StoredStates,
    StoredTrack,
    read_amended_tracks,
    read_regions,
    read_states,
    read_tracks,
)
from semap.errors import InvalidInput, NotFound
from semap.intake.enrichment import enriched
from semap.intake.history_rows import Span, history_rows
from semap.intake.kept import require_states
from semap.intake.map_facts import MapFacts
from semap.intake.stored_facts import load_map_facts
from semap.model.event import Event
from semap.model.given_up import GivenUp
from semap.rules.engine.event_document import event_json
from semap.rules.engine.rule import Rule
from semap.rules.engine.run_over import run_over
from semap.rules.engine.step import NEVER_US
from semap.rules.lookback import lookback_us
from semap.rules.needs import Needs, needs_of
from semap.rules.row import Row
from semap.store.database.connection import connect, translated
from semap.timeline.stamp import to_datetime, to_us
from semap.worker.progress import ROLE, WORKER

WARM_UP_S = 60.0
"""So much more is smoothed on both sides: what lies further away hardly counts."""

UNBOUND_LOOKBACK_S = 3600.0
"""A rule without a window is run from so long before."""

WINDOWS_BEFORE = 10
"""So many of its windows before the span a rule begins, if they are short: matches in a row stay aligned."""

# what the worker has not released yet is in no log that could be judged, whatever the sources say
MAP = """
    select m.map_id, (p.watermarks -> 'maps' -> m.map_id::text ->> 'released_us')::bigint
    from semap.map m left join semap.progress p on p.worker = %s where m.name = %s
"""
RULES = "select r.rule_id, semap.rule_json(r) from semap.rule r where r.map_id = %s and r.enabled order by 1"
IN_PAIRS = "select name from semap.continuous_query where map_id = %s and in_pairs"
LOGGED = """
    select e.event_id, e.rule_name, e.type, e.key, e.track_id, e.instance_id, e.stamp, e.by_batch,
           e.track_name, e.instance_name
    from semap.event e
    where e.map_id = %s and e.rule_name = any (%s) and e.stamp >= %s and e.stamp < %s
"""
COMMIT = "select semap.commit_recompute(%s, %s, %s, %s, %s, %s, %s, %s, %s, %s)"


@dataclass(frozen=True)
class Plan:
    """What to compute again: a map's events with stamps from `start` on and before `end`.

    rules    names; None for all in force
    same_s   an event is confirmed by one that differs by at most this, and amended by one further away
    reach_s  up to this
    """

    map_name: str
    start: datetime
    end: datetime
    rules: Sequence[str] | None = None
    motion: Motion = field(default_factory=Motion)
    same_s: float = 0.5
    reach_s: float = 3.0


def recompute(
    dsn: str, plan: Plan, advance: Callable[[str], None] = lambda _: None, *, dry_run: bool = False
) -> Outcome:
    """Run the batch layer over a span; a dry run writes nothing.

    advance  is told what is being done
    raises   NotFound if there is no such map or rule; InvalidInput if the span is empty, not all of its
             states are there yet, or some of them were dropped
    """
    started_at = datetime.now(UTC)
    with connect(dsn, ROLE, application="semap recompute") as connection, translated():
        map_id, complete_to = _map(connection, plan)
        rules = _rules(connection, map_id, plan)
        given_up: dict[str, GivenUp] = {}
        found = _found(connection, map_id, rules, plan, complete_to, advance, given_up)
        advance("comparing with the log")
        names = [rule.name for rule in rules.values()]
        logged = [
            Logged(*row)
            for row in connection.execute(LOGGED, [map_id, names, plan.start, plan.end]).fetchall()
        ]
        outcome = replace(judge(logged, found, plan.same_s, plan.reach_s), given_up=given_up)
        if dry_run:
            return outcome
        advance("writing the verdicts")
        row = connection.execute(
            COMMIT,
            [
                WORKER,
                map_id,
                names,
                plan.start,
                plan.end,
                started_at,
                Jsonb(
                    {
                        "motion": asdict(plan.motion),
                        "same_s": plan.same_s,
                        "reach_s": plan.reach_s,
                        "given_up": {name: each.as_json() for name, each in given_up.items()},
                    }
                ),
                Jsonb(outcome.counts()),
                Jsonb([{**event_json(event), "by_batch": True} for event in outcome.events]),
                Jsonb([judgement.as_json() for judgement in outcome.judgements]),
            ],
        ).fetchone()
    return outcome.of_run(int(row[0]) if row else 0)


def _map(connection: psycopg.Connection, plan: Plan) -> tuple[int, datetime]:
    """The map, and up to when all of its states are there and the rules have taken them."""
    row = connection.execute(MAP, [WORKER, plan.map_name]).fetchone()
    if row is None:
        raise NotFound("map", plan.map_name, "List the maps: semap map list.")
    map_id, released_us = row
    if plan.end <= plan.start:
        raise InvalidInput("it ends before it begins", "Give the earlier time first.", "FROM TO")
    if released_us is None or released_us == NEVER_US:
        raise InvalidInput("its rules have read no states yet", "Bring in movement first.", plan.map_name)
    complete_to = to_datetime(released_us)
    if plan.end > complete_to + timedelta(microseconds=1):
        raise InvalidInput(
            f"the map's rules have come only up to {complete_to.isoformat()}",
            "Give a TO at or before that, or wait for the sources and for `semap work`.",
            "TO",
        )
    return map_id, complete_to


def _rules(connection: psycopg.Connection, map_id: int, plan: Plan) -> Mapping[int, Rule]:
    """The rules to run, by id: those that were asked for, and those whose events they read.

    Rules over changes of the map are left out: history does not keep at which moment these were committed.
    """
    known = {
        rule_id: Rule.from_json(rule_id, document)
        for rule_id, document in connection.execute(RULES, [map_id]).fetchall()
    }
    by_name = {rule.name: rule for rule in known.values()}
    wanted = list(by_name if plan.rules is None else plan.rules)
    for name in wanted:
        if name not in by_name:
            raise NotFound("rule in force", name, "List the rules of the map: semap rule list --map MAP.")
        wanted += [each for each in _inputs(by_name[name]) if each in by_name and each not in wanted]
    unknown = {
        name for name, rule in by_name.items() if any(i.kind == "map" for i in rule.declaration.inputs)
    }
    while beyond := {n for n in set(wanted) - unknown if unknown.intersection(_inputs(by_name[n]))}:
        unknown |= beyond
    if plan.rules is not None and unknown.intersection(wanted):
        raise InvalidInput(
            f"{', '.join(sorted(unknown.intersection(wanted)))}: changes of the map cannot be computed again",
            "Name other rules.",
            "--rule",
        )
    return {rule_id: rule for rule_id, rule in known.items() if rule.name in set(wanted) - unknown}


def _inputs(rule: Rule) -> list[str]:
    return [item.name for item in rule.declaration.inputs]


def _found(
    connection: psycopg.Connection,
    map_id: int,
    rules: Mapping[int, Rule],
    plan: Plan,
    complete_to: datetime,
    advance: Callable[[str], None],
    given_up: dict[str, GivenUp],
) -> list[Event]:
    """The events of the span by the batch layer."""
    before, after = _reach(lookback_us(rule.declaration for rule in rules.values()))
    first = plan.start - before
    last = min(plan.end + after, complete_to)
    margin = timedelta(seconds=WARM_UP_S)
    require_states(connection, map_id, plan.start, before + margin)
    facts = load_map_facts(connection, datetime.now(UTC))
    advance("reading states")
    states = read_states(connection, map_id, first - margin, last + margin)
    tracks = read_tracks(connection, np.unique(states.track_id).tolist(), first - margin, last + margin)
    advance(f"smoothing {len(states.stamp_us)} states of {len(tracks)} tracks")
    path = _path(states, tracks, plan.motion)
    advance("finding visits")
    regions = read_regions(connection, map_id)
    found = visits(path, [region.area for region in regions.values()])
    before_us = to_us(first - margin) - 1
    following = {number: region for number, region in regions.items() if region.follows_amendments}
    amended = _amended(connection, map_id, first - margin, last + margin) if following else None
    if amended is not None:
        found = (each for each in found if not (each.region_id in following and each.track in amended[1]))
    rows: dict[str, Row] = {row.uid: row for row in relation_rows(found, tracks, regions, facts, before_us)}
    if amended is not None:
        found = visits(_path(*amended, plan.motion), [region.area for region in following.values()])
        rows |= {row.uid: row for row in relation_rows(found, amended[1], regions, facts, before_us)}
    advance("running the rules")
    span = Span(to_us(first), to_us(last), with_held=True)
    rows |= _noted_rows(connection, map_id, rules, span, facts)
    # together, since the farthest that any rule asks for an actor counts, as it does for the worker
    needs = reduce(or_, (needs_of(rule.declaration) for rule in rules.values()), Needs())
    ready = enriched(connection, map_id, list(rows.values()), needs)
    events = run_over(
        rules.values(), ready, to_us(last), tell=lambda rule, what: given_up.update({rule.name: what})
    )
    return [event for event in events if plan.start <= event.stamp < plan.end]


def _amended(
    connection: psycopg.Connection, map_id: int, start: datetime, end: datetime
) -> tuple[StoredStates, Mapping[int, StoredTrack]]:
    """The states of amended tracks as queries that follow amendments take them, and all of these tracks."""
    states = read_states(connection, map_id, start, end, as_amended=True)
    return states, read_amended_tracks(connection, map_id, start, end)


def _reach(lookback_us: float) -> tuple[timedelta, timedelta]:
    """So much before and after a span is read that rules find in it what they find running all along."""
    unbound_us = UNBOUND_LOOKBACK_S * 1e6
    after_us = unbound_us if isinf(lookback_us) else lookback_us
    before_us = max(after_us, min(WINDOWS_BEFORE * after_us, unbound_us))
    return timedelta(microseconds=before_us), timedelta(microseconds=after_us)


def _noted_rows(
    connection: psycopg.Connection, map_id: int, rules: Mapping[int, Rule], span: Span, facts: MapFacts
) -> dict[str, Row]:
    """States of objects and relations of pairs that the rules read, as they were noted."""
    names = frozenset(rule.name for rule in rules.values())
    in_pairs = {name for (name,) in connection.execute(IN_PAIRS, [map_id])}
    rows = (row for rule in rules.values() for row in history_rows(connection, rule, names, span, facts))
    return {
        row.uid: row
        for row in rows
        if row.source == "object_state" or (row.source == "relation" and row.values["input"] in in_pairs)
    }


def _path(states: StoredStates, tracks: Mapping[int, StoredTrack], motion: Motion) -> Path:
    """The tracks' smoothed ways; a track that ended has ended with its last state, or later without one."""
    track, stamp_us = states.track_id, states.stamp_us
    is_last = states.is_last.copy()
    begins = np.concatenate([[True], np.diff(track) != 0])[: len(track)]
    ends = np.concatenate([begins[1:], [True]])[: len(track)]
    over_us = stamp_us.copy()
    for place in np.flatnonzero(ends).tolist():
        ended_at = tracks[int(track[place])].ended_at
        if ended_at is not None:
            is_last[place], over_us[place] = True, max(over_us[place], to_us(ended_at))
    was_there = np.array([tracks[number].was_there for number in track[begins].tolist()], np.bool_)
    is_first = np.concatenate([[False], is_last[:-1]])[: len(track)]
    is_first[begins] = ~was_there
    piece = pieces(track, stamp_us, motion)
    smoothed_m, std_m = smooth(piece, stamp_us, states.position_m, states.std_m, motion)
    return Path(track, stamp_us, smoothed_m, std_m, states.z_m, piece, is_last, is_first, over_us)
