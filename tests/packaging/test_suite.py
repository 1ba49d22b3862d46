"""The tests themselves: none lets time pass but in `patience`, and none asserts how much did."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
EXEMPT = {"patience.py", "soak"}
"""Where waiting is kept, and what works for as long as it is told."""

ASLEEP = {"sleep", "sleep_until", "usleep"}
OF_PROCESSOR = {
    "process_time", "process_time_ns", "thread_time", "thread_time_ns", "perf_counter", "perf_counter_ns",
    "default_timer", "getrusage", "cpu_times",
}  # fmt: skip
CLOCKS = {"monotonic", "monotonic_ns", "time", "time_ns", "now", "utcnow"}


def faults(source: str) -> Iterator[tuple[int, str]]:
    """The lines that let time pass or ask how much did, and what they call."""
    clocked: set[str] = set()
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and _is_clock(node.value):
            clocked |= {target.id for target in node.targets if isinstance(target, ast.Name)}
    for node in ast.walk(tree):
        match node:
            case ast.ImportFrom(module="time" | "timeit" | "resource" | "asyncio" as module, names=names):
                yield from (
                    (node.lineno, f"{module}.{each.name}")
                    for each in names
                    if each.name in ASLEEP | OF_PROCESSOR
                )
            case ast.Call(func=ast.Attribute(attr=name) | ast.Name(id=name)) if name in ASLEEP | OF_PROCESSOR:
                if not _yields_once(node):
                    yield node.lineno, name
            case ast.Call(
                func=ast.Attribute(value=ast.Call(func=ast.Name(), args=[]), attr="wait"), args=[_]
            ):
                yield node.lineno, "wait of nobody's event"
            case ast.BinOp(op=ast.Sub(), left=left) if _is_clock(left) or (
                isinstance(left, ast.Name) and left.id in clocked and _was_clock(node.right, clocked)
            ):
                yield node.lineno, "time that went by"
            case ast.Assert(test=test):
                if any(_is_limit(each) for each in ast.walk(test)):
                    yield node.lineno, "a clock against a number"


def _called(node: ast.AST) -> str | None:
    match node:
        case ast.Call(func=ast.Attribute(attr=name)):
            return name
        case ast.Call(func=ast.Name(id=name)):
            return name
    return None


def _is_clock(node: ast.AST) -> bool:
    return _called(node) in {"monotonic", "monotonic_ns"}


def _was_clock(node: ast.AST, clocked: set[str]) -> bool:
    return _is_clock(node) or (isinstance(node, ast.Name) and node.id in clocked)


def _is_limit(node: ast.AST) -> bool:
    """A difference from the present compared with a number."""
    return isinstance(node, ast.Compare) and any(
        isinstance(part, ast.BinOp)
        and isinstance(part.op, ast.Sub)
        and any(_called(each) in CLOCKS for each in ast.walk(part))
        for side in (node.left, *node.comparators)
        for part in ast.walk(side)
    )


def _yields_once(call: ast.Call) -> bool:
    """asyncio.sleep(0) lets others have a turn, and no time pass."""
    return len(call.args) == 1 and isinstance(call.args[0], ast.Constant) and call.args[0].value == 0


def test_no_test_sleeps_or_asserts_a_time() -> None:
    found = [
        f"{path.relative_to(TESTS)}:{line}: {what}"
        for path in sorted(TESTS.rglob("*.py"))
        if not EXEMPT & set(path.relative_to(TESTS).parts)
        for line, what in faults(path.read_text())
    ]
    assert found == [], "wait by patience.until; what is to be quick is measured by ./dev bench"


@pytest.mark.parametrize(
    "source",
    [
        "time.sleep(0.1)",
        "async def f():\n    await asyncio.sleep(0.01)",
        "from time import sleep",
        "from time import process_time",
        "began = time.process_time()",
        "Event().wait(0.5)",
        "Signal().wait(dice.uniform(0.1, 0.2))",
        "assert time.monotonic() - began_s < 5",
        "began_s = time.monotonic()\ntook_s = time.monotonic() - began_s",
        "a = time.monotonic()\nb = time.monotonic()\nassert b - a < 1",
        "assert abs(datetime.now(UTC).timestamp() - received_at) < 60",
    ],
)
def test_what_lets_time_pass_is_found(source: str) -> None:
    assert len(list(faults(source))) >= 1


@pytest.mark.parametrize(
    "source",
    [
        "async def f():\n    await asyncio.sleep(0)",
        "deadline_s = time.monotonic() + 60\nassert time.monotonic() < deadline_s",
        "soon = datetime.now(UTC) - timedelta(days=1)",
        "stop.wait(10)",
    ],
)
def test_what_lets_none_pass_is_left_alone(source: str) -> None:
    assert list(faults(source)) == []
