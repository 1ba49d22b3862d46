"""The log of events as other tools want it, and what held meanwhile, for a timeline."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import Connection, text

from semap.model.event_log import Entry, Lane, Mark, Stay
from semap.store.database.connection import translated
from semap.store.map.maps import map_id_of

PAGE = 5_000

ENTRIES = """
    select e.event_id, e.type, e.stamp, e.since, m.name as map, e.rule_name as rule, e.rule_version,
           e.track_id, e.track_name as track, e.instance_id, e.instance_name as instance,
           c.name as concept, e.cause, e.confidence, a.verdict, e.key, e.measures
    from semap.event e
    join semap.map m using (map_id)
    left join semap.instance i using (instance_id)
    left join semap.concept c using (concept_id)
    left join semap.event_amendment a using (event_id)
    where e.map_id = :map_id
      and (cast(:start as timestamptz) is null or e.stamp >= :start)
      and (cast(:end as timestamptz) is null or e.stamp < :end)
      and (cast(:rules as text[]) is null or e.rule_name = any (:rules))
      and (:standing or a.verdict is null or a.verdict = 'confirmed')
"""
ORDERS = {None: "e.stamp, e.seq", "instance": "e.instance_id, e.instance_name, e.stamp, e.seq",
          "track": "e.track_id, e.track_name, e.stamp, e.seq"}  # fmt: skip

# which track was in what: of a pair, such as who faces a table, neither is in the other
STAYS = text("""
    select p.instance_id, p.instance_name, p.track_name, p.since, p.until as stamp
    from semap.relation_past p
    where p.map_id = :map_id and tstzrange(p.since, p.until, '[]') && tstzrange(:start, :end)
      and p.track_id is not null and p.instance_id is not null
      and not exists (select from semap.continuous_query q where q.query_id = p.query_id and q.in_pairs)
    union all
    select n.instance_id, n.instance, n.track, n.since, null
    from semap.relation_now n join semap.continuous_query q using (query_id)
    where n.map_id = :map_id and n.since < :end and not q.in_pairs
    order by instance_name, since, track_name
""")
OBJECT_STAYS = text("""
    select instance_id, instance_name, value, stamp, until
    from (
      select instance_id, instance_name, property, value, stamp,
             lead(stamp) over (partition by instance_id, property order by stamp) as until
      from semap.object_state
      where map_id = :map_id and stamp < :end and previous is distinct from value
    ) s
    where (until is null or until >= :start) and value = any (:values)
    order by instance_name, stamp
""")


@dataclass(frozen=True)
class Selection:
    """Which events: of a map, with stamps from `start` on and before `end`, of these rules (None: of all).

    with_retracted  also those that the batch layer took back or amended
    """

    map_name: str
    start: datetime | None = None
    end: datetime | None = None
    rules: Sequence[str] | None = None
    with_retracted: bool = False


def log_entries(connection: Connection, selection: Selection, case: str | None = None) -> Iterator[Entry]:
    """Entries in the order of their stamps; with a case (instance, track) case by case. Not all in memory.

    raises NotFound if there is no such map
    """
    parameters = {**_span(connection, selection), "rules": selection.rules and list(selection.rules),
                  "standing": selection.with_retracted}  # fmt: skip
    statement = text(f"{ENTRIES} order by {ORDERS[case]}")
    with translated():
        for row in connection.execute(
            statement, parameters, execution_options={"yield_per": PAGE}
        ).mappings():
            yield Entry(**row)


def lanes(
    connection: Connection, selection: Selection, open_values: Sequence[str] = ("open",)
) -> tuple[Lane, ...]:
    """The rooms and then the doors of a timeline, by name, with what held in them and their events.

    Events of rules that only say what the bars show already (both edges of a relation) are left out.
    """
    parameters = {**_span(connection, selection), "values": list(open_values)}
    names: dict[tuple[bool, int], str] = {}
    stays: dict[tuple[bool, int], list[Stay]] = {}
    with translated():
        for is_door, statement in ((False, STAYS), (True, OBJECT_STAYS)):
            for instance_id, name, who, start, end in connection.execute(statement, parameters):
                names[is_door, instance_id] = name
                stays.setdefault((is_door, instance_id), []).append(Stay(start, end, who))
    marks: dict[tuple[bool, int], list[Mark]] = {}
    for entry in log_entries(connection, selection):
        if entry.instance_id is None or entry.cause is not None:
            continue
        lane = _lane_of(entry, names)
        names.setdefault(lane, entry.instance or "")
        who = f" ({entry.track})" if entry.track else ""
        marks.setdefault(lane, []).append(Mark(entry.stamp, entry.type.replace("_", " ") + who))
    return tuple(
        Lane(name, lane[0], tuple(stays.get(lane, ())), tuple(marks.get(lane, ())))
        for lane, name in sorted(names.items(), key=lambda each: (each[0][0], each[1], each[0][1]))
    )


def _lane_of(entry: Entry, names: Mapping[tuple[bool, int], str]) -> tuple[bool, int]:
    """Where an event is shown: with the room that it is about, else with its instance."""
    room = entry.key.get("room")
    for lane, name in names.items():
        if name == room and not lane[0]:
            return lane
    instance_id = entry.instance_id or 0
    return (True, instance_id) if (True, instance_id) in names else (False, instance_id)


def span_of(connection: Connection, map_name: str) -> tuple[datetime, datetime] | None:
    """From the first event of a map to its last; None where there is none.

    raises NotFound if there is no such map
    """
    wanted = _span(connection, Selection(map_name))
    with translated():
        first, last = connection.execute(
            text("select min(stamp), max(stamp) from semap.event where map_id = :map_id"), wanted
        ).one()
    return None if first is None else (first, last)


def _span(connection: Connection, selection: Selection) -> dict[str, object]:
    map_id = map_id_of(connection, selection.map_name)
    return {"map_id": map_id, "start": selection.start, "end": selection.end}
