"""semap events"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any
from uuid import UUID

import typer

from semap.errors import ServerUnavailable
from semap_service.cli.output import clock, print_json_line, say, visible
from semap_service.cli.session import AsJson, Dsn, database

if TYPE_CHECKING:
    from sqlalchemy import Engine

    from semap.store.event.event_selection import Selection
    from semap.store.event.events import StoredEvent, Stretch

PAGE = 500
WAKE_S = 1.0
AGAIN_S = 1.0
WHY = {
    "appeared": "first seen there",
    "disappeared": "last seen there",
    "map": "the map was edited",
}
HUES = ("cyan", "green", "magenta", "yellow", "blue", "bright_red", "bright_cyan", "bright_green")


def events(
    follow: Annotated[
        bool,
        typer.Option("--follow", "-f", help="Continue with new events, also after a restart of the server."),
    ] = False,
    after: Annotated[int, typer.Option(help="Only events after this number (the cursor).", min=0)] = 0,
    limit: Annotated[int, typer.Option(help="At most so many; 0 for all.", min=0)] = 0,
    map_name: Annotated[str | None, typer.Option("--map", help="Only events on this map.")] = None,
    kind: Annotated[str | None, typer.Option("--type", help="Only events of this type.")] = None,
    rule: Annotated[str | None, typer.Option(help="Only events of this rule.")] = None,
    where: Annotated[
        str | None,
        typer.Option(
            "--filter",
            metavar="CQL2",
            help="Only events that match this, such as \"track = 'ann' AND confidence > 0.8\".",
        ),
    ] = None,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Show events, oldest first, each with its number, stamp, track and instance."""
    from semap.store.event.event_selection import Selection  # noqa: PLC0415

    selection = Selection(map_name, kind, rule, where)
    selection.check()
    reader = _Reader(selection, limit, after)
    with database(dsn) as opened:
        if map_name is not None:
            _require_map(opened, map_name)
        while True:
            try:
                for row in reader.read(opened, follow):
                    print_json_line(row) if as_json else typer.echo(sentence(row))
                break
            except ServerUnavailable as error:
                if not follow:
                    raise
                if not reader.is_waiting:
                    say(f"semap: {error} Waiting for it; nothing will be missed.", err=True)
                reader.is_waiting = True
                time.sleep(AGAIN_S)
    if not reader.shown and not as_json:
        say("No events yet. They are made while `semap up` or `semap work` runs.", err=True)


Standing = Mapping[UUID, int]
"""The number of each event that stands in another's place, by its id."""


@dataclass
class _Reader:
    """What has been shown survives a lost connection, so that reading goes on after it."""

    selection: Selection
    limit: int
    after: int
    shown: int = 0
    is_waiting: bool = False

    def read(self, dsn: str, follow: bool) -> Iterator[dict[str, Any]]:
        """Events as they come; ends at the limit, or without `follow` where there are no more.

        raises  ServerUnavailable if the server does not answer, or went away
        """
        with _listening(dsn) as (wait, engine):
            self.is_waiting = False
            while True:
                stretch, stands = _stretch(engine, self.after, self.selection)
                for event in stretch.events:
                    self.after = event.seq
                    if self.selection.takes(event):
                        self.shown += 1
                        yield row_of(event, stands)
                        if self.shown == self.limit:
                            return
                self.after = stretch.last
                if stretch.is_full:
                    continue
                if not follow:
                    return
                wait(WAKE_S)


@contextmanager
def _listening(dsn: str) -> Iterator[tuple[Callable[[float], bool], Engine]]:
    """What waits for news for so many seconds, and what reads them."""
    from semap.store.database.connection import (  # noqa: PLC0415
        listen,
        one_session,
        translated,
        wait_for_notice,
    )

    with (
        one_session(dsn, "semap_read", application="semap events") as engine,
        listen(dsn, "semap_event", "semap_read", application="semap events") as listener,
        translated(),
    ):
        yield partial(wait_for_notice, listener), engine


def _stretch(engine: Engine, after: int, selection: Selection) -> tuple[Stretch, Standing]:
    from semap.store.database.connection import translated  # noqa: PLC0415
    from semap.store.event.events import numbers_of, read_stretch  # noqa: PLC0415

    with translated(), engine.begin() as connection:
        stretch = read_stretch(
            connection,
            after=after,
            limit=PAGE,
            map_name=selection.map,
            event_type=selection.type,
            rule_name=selection.rule,
        )
        return stretch, numbers_of(
            connection, {each.amended_by for each in stretch.events if each.amended_by}
        )


def _require_map(dsn: str, name: str) -> None:
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.places import place_of  # noqa: PLC0415

    with one_transaction(dsn, "semap_read", application="semap events") as connection:
        place_of(connection, name)


def row_of(event: StoredEvent, stands: Standing) -> dict[str, Any]:
    """An event as JSON gives it; `amended_by` is the number of the event that stands in its place."""
    return {
        "seq": event.seq,
        "event_id": event.event_id,
        "map": event.map,
        "type": event.type,
        "stamp": event.stamp,
        "cause": event.cause,
        "rule": event.rule,
        "rule_version": event.rule_version,
        "track": event.track_name,
        "instance": event.instance_name,
        "since": event.since,
        "key": dict(event.key),
        "measures": dict(event.measures),
        "confidence": event.confidence,
        "verdict": event.verdict,
        "amended_by": None if event.amended_by is None else stands.get(event.amended_by),
    }


def sentence(row: Mapping[str, Any]) -> str:
    """An event as a line for people, in colour on a terminal that has it."""
    # what a rule finds by room is about that room, whichever of its doors came last
    measures = dict(row["measures"])
    subject, object_ = row["track"], row["key"].get("room") or row["instance"]
    if row["cause"] is not None:
        subject, object_ = subject or _side(measures, "subject"), object_ or _side(measures, "other")
    said = [row["type"], object_]
    if subject is None and object_ is None:
        said += [f"{name} {value}" for name, value in row["key"].items()]
    notes = [WHY.get(row["cause"], "")]
    notes += [f"{name} {_short(value)}" for name, value in measures.items()]
    if row["confidence"] is not None:
        notes.append(f"confidence {row['confidence']:.2f}")
    by = row["amended_by"]
    notes.append(f"amended by {by}" if by is not None else row["verdict"] or "")
    remark = ", ".join(note for note in notes if note)
    line = " ".join(visible(str(part)) for part in said if part is not None)
    line = line if subject is None else f"{_hued(visible(subject))} {line}"
    number = _faint(f"{row['seq']:>6}  {clock(row['stamp'])}")
    return f"{number}  {line}{_faint(visible(f' ({remark})')) if remark else ''}"


def _side(measures: dict[str, Any], name: str) -> str | None:
    """The other kind of side of a relation, which is taken out of what the event measures."""
    measures.pop(f"{name}_id", None)
    found: str | None = measures.pop(name, None)
    return found


def _hued(name: str) -> str:
    """The same hue for the same name."""
    if not _in_colour():
        return name
    return typer.style(name, fg=HUES[sum(name.encode()) % len(HUES)], bold=True)


def _faint(text: str) -> str:
    return typer.style(text, dim=True) if _in_colour() else text


def _in_colour() -> bool:
    """A terminal that has colour, and a user who wants it (https://no-color.org)."""
    return sys.stdout.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def _short(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
