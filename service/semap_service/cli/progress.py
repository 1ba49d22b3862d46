"""How far a long command is, on standard error: a bar where a person watches it, else a line now and then."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from semap_service.cli.output import say

LINE_EACH_S = 5.0

Advance = Callable[[int, int], None]
"""Called with what is done and what there is in all."""


@contextmanager
def progress_bar(what: str, *, quiet: bool = False) -> Iterator[Advance]:
    """Gives a function to call with what is done and what there is in all."""
    if quiet:
        yield lambda done, total: None
        return
    if not sys.stderr.isatty():
        yield in_lines(what, lambda line: say(line, err=True))
        return
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415

    with Progress(
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(what),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
    ) as bar:
        task = bar.add_task(what)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def in_lines(what: str, say: Callable[[str], None], clock: Callable[[], float] = time.monotonic) -> Advance:
    """Says how far it is each five seconds, so that a short command says nothing.

    clock  [s] goes on steadily
    """
    said_s = clock()

    def advance(done: int, total: int) -> None:
        nonlocal said_s
        if clock() - said_s >= LINE_EACH_S:
            said_s = clock()
            say(f"{done} of {total} {what} ({100 * done // max(total, 1)} %)")

    return advance
