"""semap events"""

from __future__ import annotations

from typing import Annotated, Any

import typer

from semap_service.cli.output import clock, print_json_line
from semap_service.cli.session import AsJson, Dsn, database

PAGE = 500
WAKE_S = 1.0
WHY = {
    "appeared": "first seen there",
    "disappeared": "last seen there",
    "map": "the map was edited",
}
SINCE = """
    select e.seq, e.event_id, m.name as map, e.type, e.stamp, e.cause, e.rule_name as rule,
           e.rule_version, e.track_name as track, e.instance_name as instance, e.since, e.key, e.measures,
           e.confidence, a.verdict, b.seq as amended_by
    from semap.event e join semap.map m using (map_id) left join semap.event_amendment a using (event_id)
    left join semap.event b on b.event_id = a.by_event_id
    where e.seq > %(after)s and (%(map)s::text is null or m.name = %(map)s)
      and (%(type)s::text is null or e.type = %(type)s)
      and (%(rule)s::text is null or e.rule_name = %(rule)s)
    order by e.seq limit %(limit)s
"""


def events(
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Go on as new events happen.")] = False,
    after: Annotated[int, typer.Option(help="Only events after this number.", min=0)] = 0,
    limit: Annotated[int, typer.Option(help="At most so many; 0 for all.", min=0)] = 0,
    map_name: Annotated[str | None, typer.Option("--map", help="Only events on this map.")] = None,
    kind: Annotated[str | None, typer.Option("--type", help="Only events of this type.")] = None,
    rule: Annotated[str | None, typer.Option(help="Only events of this rule.")] = None,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Show events, oldest first, each with its number: who entered or left which room, and when."""
    from semap.store.database import connect  # noqa: PLC0415

    with database(dsn) as opened, connect(opened, "semap_read", application="semap events") as connection:
        connection.execute("listen semap_event")
        shown = 0
        while True:
            page = min(PAGE, limit - shown) if limit else PAGE
            wanted = {"after": after, "map": map_name, "type": kind, "rule": rule, "limit": page}
            cursor = connection.execute(SINCE, wanted)
            columns = [column.name for column in cursor.description or ()]
            rows = [dict(zip(columns, row, strict=True)) for row in cursor.fetchall()]
            for row in rows:
                print_json_line(row) if as_json else typer.echo(sentence(row))
                after = row["seq"]
            shown += len(rows)
            if limit and shown >= limit:
                return
            if len(rows) < page:
                if not follow:
                    break
                next(iter(connection.notifies(timeout=WAKE_S, stop_after=1)), None)
        if not shown and not as_json:
            typer.echo("No events yet. They are made while `semap up` or `semap work` runs.", err=True)


def sentence(row: dict[str, Any]) -> str:
    """An event as a line for people."""
    # what a rule finds by room is about that room, whichever of its doors came last
    said = [row["track"], row["type"], row["key"].get("room") or row["instance"]]
    if row["track"] is None and row["instance"] is None:
        said += [f"{name} {value}" for name, value in row["key"].items()]
    notes = [WHY.get(row["cause"], "")]
    notes += [f"{name} {_short(value)}" for name, value in row["measures"].items()]
    if row["confidence"] is not None:
        notes.append(f"confidence {row['confidence']:.2f}")
    by = row["amended_by"]
    notes.append(f"amended by {by}" if by is not None else row["verdict"] or "")
    remark = ", ".join(note for note in notes if note)
    line = " ".join(str(part) for part in said if part is not None)
    return f"{row['seq']:>6}  {clock(row['stamp'])}  {line}{f' ({remark})' if remark else ''}"


def _short(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
