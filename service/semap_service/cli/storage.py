"""semap db size, retention and maintain"""

from __future__ import annotations

from dataclasses import asdict
from datetime import timedelta
from typing import TYPE_CHECKING, Annotated, Any

import typer

from semap_service.cli.output import counted, print_json, print_rows, say
from semap_service.cli.session import AsJson, Dsn, database

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from semap.store.operate.disk_use import DayOfStates, DiskUse
    from semap.store.operate.maintenance import Maintained
    from semap.store.operate.retention import Retention

SHOWN_DAYS = 14
NEVER = "never"


def size(as_json: AsJson = False, dsn: Dsn = None) -> None:
    """Show where bytes go, how fast the database grows, and when old states are dropped.

    Rows are about as many, as PostgreSQL estimates them; a day of states is one of event time, in UTC.
    """
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.operate.disk_use import read_disk_use  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_read") as connection:
        use = read_disk_use(connection)
    if as_json:
        print_json(_size_json(use))
        return
    print_rows(
        [
            {
                "what": part.name,
                "rows": part.rows,
                "table": _bytes(part.table_bytes),
                "indexes": _bytes(part.index_bytes),
                "in all": _bytes(part.bytes),
            }
            for part in use.parts
        ]
        + [{"what": "in all", "rows": None, "table": "", "indexes": "", "in all": _bytes(use.total_bytes)}],
        False,
        "",
    )
    say("")
    print_rows(_day_rows(use.days), False, "No states are kept.")
    say("")
    say(
        f"A day brings about {_bytes(use.growth_bytes)} and {counted(use.growth_states, 'state')}"
        " (mean of the last 7 days)."
    )
    say("\n".join(f"Next: {said}." for said in use.due()) or "No states will be dropped.")


def retention(
    drop_states_after: Annotated[
        str | None, typer.Option(metavar="AGE", help="Drop the states of days of this age.")
    ] = None,
    drop_lines_after: Annotated[
        str | None, typer.Option(metavar="AGE", help="Drop the lines that sources saw.")
    ] = None,
    drop_changes_after: Annotated[
        str | None,
        typer.Option(metavar="AGE", help="Drop relation changes, the history of relations."),
    ] = None,
    drop_events_after: Annotated[
        str | None, typer.Option(metavar="AGE", help="Drop events, with their evidence and verdicts.")
    ] = None,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Show, or change, how long what is kept; an age is a number and a unit such as 7d, or never.

    Age is by event time: a recording of last year that comes in today is as old as last year. The rule worker
    does what is due once an hour, `semap db maintain` at once. Without an age nothing is dropped.
    """
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.operate.retention import change_retention, read_retention  # noqa: PLC0415

    ages = {
        "states": drop_states_after,
        "lines": drop_lines_after,
        "changes": drop_changes_after,
        "events": drop_events_after,
    }
    said: Any = {kind: _age(text, kind) for kind, text in ages.items() if text is not None}
    with database(dsn) as opened, one_transaction(opened, "semap_admin") as connection:
        kept = change_retention(connection, said) if said else read_retention(connection)
    rows = [_retention_row(each) for each in kept.values()]
    if as_json:
        print_json([_retention_json(each) for each in kept.values()])
        return
    print_rows(rows, False, "")


def maintain(
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only show the steps.")] = False,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Run maintenance now: make partitions ahead, and drop old data by `semap db retention`.

    The rule worker does the same once an hour. It may be stopped at any moment; tables in use are left for
    the next time.
    """
    from semap.store.operate.maintenance import maintain as do_all  # noqa: PLC0415

    with database(dsn) as opened:
        done = do_all(opened, lambda text: say(f"{text} ...", err=True), dry_run=dry_run)
    if as_json:
        print_json(_maintained_json(done))
        return
    for line in _told(done, dry_run=dry_run):
        say(line)


def _told(done: Maintained, *, dry_run: bool) -> list[str]:
    """What was done, a line each."""
    if done.is_busy:
        return ["Another process is at it; nothing was done."]
    was, were = ("would be", "would be") if dry_run else ("was", "were")
    lines = [f"{counted(len(done.made_days), 'day')} ahead {were} made."] if done.made_days else []
    for table, days in done.dropped_days.items():
        what = "states" if table == "state_chunk" else "lines"
        lines += [f"The partition of {what} of {day} {was} dropped." for day in days]
    for kind, rows in done.dropped_rows.items():
        what = "chunks of states" if kind == "states" else f"rows of {kind}"
        lines.append(f"{rows} {what} {were} dropped.")
    lines += [f"In use, and left for the next time: {what}." for what in done.put_off]
    return lines or ["Nothing is due."]


def _maintained_json(done: Maintained) -> dict[str, Any]:
    return {
        **asdict(done),
        "made_days": [str(day) for day in done.made_days],
        "dropped_days": {table: [str(day) for day in days] for table, days in done.dropped_days.items()},
    }


def _age(text: str, kind: str) -> timedelta | None:
    """None for never.

    raises  InvalidInput for anything else that is no age
    """
    from semap.errors import InvalidInput  # noqa: PLC0415
    from semap.rules.language.duration import read_duration  # noqa: PLC0415

    option = f"--drop-{kind}-after"
    if text.strip() == NEVER:
        return None
    if text.strip().replace(".", "").isdigit():
        raise InvalidInput(f"{text} has no unit", "Write 7d, 12h, or never.", option)
    return timedelta(microseconds=read_duration(text, option))


def _retention_row(kept: Retention) -> dict[str, Any]:
    from semap.store.operate.retention import WORDS  # noqa: PLC0415

    return {
        "what": WORDS[kept.kind],
        "dropped after": _age_text(kept.drop_after),
        "dropped up to": "" if kept.gone_before is None else f"{kept.gone_before:%Y-%m-%d}",
    }


def _retention_json(kept: Retention) -> dict[str, Any]:
    return {
        "kind": kept.kind,
        "drop_after_s": None if kept.drop_after is None else kept.drop_after.total_seconds(),
        "gone_before": kept.gone_before,
    }


def _age_text(age: timedelta | None) -> str:
    from semap.rules.language.duration import write_duration  # noqa: PLC0415

    return NEVER if age is None else write_duration(age // timedelta(microseconds=1))


def _day_rows(days: Sequence[DayOfStates]) -> list[Mapping[str, Any]]:
    """The last days one by one, and those before together; those without states are left out."""
    days = [each for each in days if each.states]
    recent = set(sorted({each.day for each in days if each.day})[-SHOWN_DAYS:])
    rows: list[Mapping[str, Any]] = []
    if before := [each for each in days if each.day and each.day not in recent]:
        rows.append(
            _day_row(
                f"{counted(len(before), 'day')} before",
                sum(each.states for each in before),
                sum(each.table_bytes for each in before),
                sum(each.index_bytes for each in before),
            )
        )
    shown = [each for each in days if each.day is None or each.day in recent]
    rows += [
        _day_row(str(each.day or "no partition"), each.states, each.table_bytes, each.index_bytes)
        for each in shown
    ]
    return rows


def _day_row(day: str, states: int, table: int, index: int) -> Mapping[str, Any]:
    return {
        "states of": day,
        "states": states,
        "table": _bytes(table),
        "indexes": _bytes(index),
        "bytes a state": round((table + index) / states) if states else None,
    }


def _size_json(use: DiskUse) -> dict[str, Any]:
    return {
        "at": use.at,
        "total_bytes": use.total_bytes,
        "parts": [{**asdict(part), "bytes": part.bytes} for part in use.parts],
        "days": [
            {**asdict(each), "day": each.day and str(each.day), "bytes": each.bytes} for each in use.days
        ],
        "growth_bytes_a_day": use.growth_bytes,
        "growth_states_a_day": use.growth_states,
        "due": list(use.due()),
    }


def _bytes(count: int) -> str:
    """1.5 MB, to three figures."""
    value, unit = float(count), "B"
    for larger in ("kB", "MB", "GB", "TB"):
        if value < 1000:
            break
        value, unit = value / 1000, larger
    return f"{value:.0f} {unit}" if unit == "B" or value >= 100 else f"{value:.1f} {unit}"
