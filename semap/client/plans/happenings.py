"""What moves and what happens: tracks, relations, states of objects, events, rules."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import datetime
from typing import Any, Literal

from semap.client.exchange import PAGE, Plan, Request, ask, get, given, pages, read, without_none
from semap.client.table import Table
from semap.client.values import (
    DryRun,
    Event,
    Explanation,
    NewObjectState,
    ObjectState,
    Relation,
    Rule,
    Track,
)
from semap.errors import InvalidInput

MOST_STATES = 1000
"""So many states one request may hold."""

Backfill = datetime | Literal["all"] | None


def list_tracks(
    map: str | None = None,  # noqa: A002
    *,
    name: str | None = None,
    live: bool | None = None,
    limit: int | None = None,
) -> Plan[Table[Track]]:
    """Who is followed, and where they were last seen."""
    wanted = {"map": map, "name": name, "live": live}
    return Table(Track, (yield from pages(Track, "/tracks", "tracks", limit, **wanted)))


def get_track(track_id: int) -> Plan[Track]:
    """A track. raises NotFound"""
    return (yield from get(Track, f"/tracks/{track_id}"))


def list_relations(
    map: str | None = None,  # noqa: A002
    *,
    track: str | None = None,
    room: str | None = None,
    query: str | None = None,
    as_of: datetime | None = None,
    limit: int | None = None,
) -> Plan[Table[Relation]]:
    """Who is where now, by name; or who was where at an event time, since when and how long."""
    wanted = {"map": map, "track": track, "room": room, "query": query}
    if as_of is not None:
        wanted["as_of"] = _aware(as_of)
    return Table(Relation, (yield from pages(Relation, "/relations", "relations", limit, **wanted)))


def list_events(
    map: str | None = None,  # noqa: A002
    *,
    after: int = 0,
    type: str | None = None,  # noqa: A002
    rule: str | None = None,
    filter: str | None = None,  # noqa: A002
    limit: int | None = None,
) -> Plan[Table[Event]]:
    """Events after a number, oldest first; `filter` is CQL2 over their properties."""
    wanted = given({"map": map, "type": type, "rule": rule, "filter": filter})
    found: list[Event] = []
    while limit is None or len(found) < limit:
        size = PAGE if limit is None else min(PAGE, limit - len(found))
        request = Request("GET", "/events", {**wanted, "after": after, "limit": size})
        document = (yield from ask(request)).document()
        found += read(list[Event], document["events"])
        # a page of which a filter took nothing is not the last one as long as the cursor moves on
        if document["next"] <= after:
            break
        after = document["next"]
    return Table(Event, found)


def list_object_states(
    map: str | None = None,  # noqa: A002
    *,
    instance: str | None = None,
    property: str | None = None,  # noqa: A002
    limit: int | None = None,
) -> Plan[Table[ObjectState]]:
    """States of objects, such as doors that opened and closed, in the order of their arrival."""
    wanted = {"map": map, "instance": instance, "property": property}
    found = yield from pages(ObjectState, "/object-states", "object_states", limit, **wanted)
    return Table(ObjectState, found)


def add_object_states(
    map: str,  # noqa: A002
    source: str,
    states: Sequence[NewObjectState],
    *,
    watermark: datetime | None = None,
) -> Plan[int]:
    """Tell what a source saw of objects; returns how many states were not known before.

    They are sent in parts of 1,000, each all or nothing; what was sent before is passed over, so that a call
    may be repeated.

    watermark  the source gives no state up to this stamp any more, for which rules wait
    """
    added = 0
    for first in range(0, max(len(states), 1), MOST_STATES):
        part = states[first : first + MOST_STATES]
        is_last = first + MOST_STATES >= len(states)
        body = {
            "map": map,
            "source": source,
            "states": [{**asdict(each), "stamp": _aware(each.stamp)} for each in part],
            "watermark": _aware(watermark) if is_last and watermark is not None else None,
        }
        answer = yield from ask(Request("POST", "/object-states", body=body, repeatable=True))
        added += int(answer.document()["added"])
    return added


def list_rules(map: str | None = None, *, limit: int | None = None) -> Plan[Table[Rule]]:  # noqa: A002
    """Rules: which events are made."""
    return Table(Rule, (yield from pages(Rule, "/rules", "rules", limit, map=map)))


def get_rule(rule_id: int) -> Plan[Rule]:
    """A rule. raises NotFound"""
    return (yield from get(Rule, f"/rules/{rule_id}"))


def add_rule(
    map: str,  # noqa: A002
    name: str,
    declaration: Mapping[str, Any],
    *,
    backfill_from: Backfill = None,
) -> Plan[Rule]:
    """Make events from now on, and of what is stored from `backfill_from` on ("all": since ever).

    declaration  the clauses of the rule language, without `name`
    raises       InvalidInput for what is no rule, Conflict, NotFound
    """
    body = without_none(
        {"map": map, "name": name, "declaration": declaration, "backfill_from": _backfill(backfill_from)}
    )
    return (yield from ask(Request("POST", "/rules", body=body))).read(Rule)


def change_rule(
    rule_id: int,
    *,
    enabled: bool | None = None,
    declaration: Mapping[str, Any] | None = None,
    backfill_from: Backfill = None,
) -> Plan[Rule]:
    """Let a rule rest or work, or declare something else, which is a new version of it."""
    wanted = {"enabled": enabled, "declaration": declaration, "backfill_from": _backfill(backfill_from)}
    return (yield from ask(Request("PATCH", f"/rules/{rule_id}", body=without_none(wanted)))).read(Rule)


def delete_rule(rule_id: int) -> Plan[None]:
    """Delete a rule; the events that it made stay. raises NotFound, Conflict"""
    yield from ask(Request("DELETE", f"/rules/{rule_id}"))


def try_rule(
    map: str,  # noqa: A002
    declaration: Mapping[str, Any],
    *,
    start: datetime | None = None,
    end: datetime | None = None,
) -> Plan[DryRun]:
    """Run a rule over stored history, from `start` until before `end`; nothing is written.

    raises  InvalidInput, TooLarge for a span with too many rows
    """
    name = str(declaration.get("name", "dry_run"))
    wanted = {
        "map": map,
        "name": name,
        "declaration": {key: value for key, value in declaration.items() if key != "name"},
        "from": None if start is None else _aware(start),
        "to": None if end is None else _aware(end),
    }
    request = Request("POST", "/rules/dry-run", body=without_none(wanted), repeatable=True)
    return (yield from ask(request)).read(DryRun)


def explain_rule(rule_id: int, at: datetime, *, key: Mapping[str, str] | None = None) -> Plan[Explanation]:
    """Why a rule found something around a moment, or how far it came.

    key  a value for each property of the rule's `partition_by`
    """
    wanted: dict[str, Any] = {"at": _aware(at)}
    if key:
        wanted["key"] = [f"{name}={value}" for name, value in key.items()]
    return (yield from get(Explanation, f"/rules/{rule_id}/explanation", **wanted))


def _backfill(since: Backfill) -> str | None:
    return _aware(since) if isinstance(since, datetime) else since


def _aware(stamp: datetime) -> str:
    if stamp.tzinfo is None:
        raise InvalidInput(f"{stamp} has no time zone", "Give an aware stamp, such as one with tzinfo=UTC.")
    return stamp.isoformat()
