"""One line at the end of a run of the tests: what was left out, and how to have it.

A test that is skipped says both in its reason: "there is no curl: apt-get install curl".
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Generator, Iterable

import pytest

BY_MARKER = {
    "not slow": "the slow ones (./dev test --all)",
    "not flink": "those against Flink (./dev flink, ./dev check)",
}


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> Generator[None]:
    """After pytest's own summary, so that it is not lost above a long list."""
    yield
    skipped = terminalreporter.stats.get("skipped", [])
    line = left_out((report.longrepr[2] for report in skipped), terminalreporter.config.option.markexpr)
    if line:
        terminalreporter.write_line(line)


def left_out(reasons: Iterable[str], marker_expression: str) -> str:
    """The line, which is empty when nothing was left out.

    reasons            why a test was skipped, one of each such test
    marker_expression  what `-m` said
    """
    wants: dict[str, Counter[str]] = defaultdict(Counter)
    for reason in reasons:
        want, _, remedy = reason.removeprefix("Skipped: ").rstrip(".").rpartition(": ")
        wants[remedy][want.removeprefix("there is no ")] += 1
    parts = [
        f"{each.total()} for want of {', '.join(sorted(each))} ({remedy})"
        for remedy, each in sorted(wants.items())
    ]
    parts += [text for marker, text in BY_MARKER.items() if marker in marker_expression]
    return f"left out: {'; '.join(parts)}" if parts else ""
