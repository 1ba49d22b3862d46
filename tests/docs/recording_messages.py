"""What the reading of recordings can say, out of the source: each message with ... for what varies."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

INGEST = Path(__file__).parents[2] / "ingest" / "semap_ingest"
FOLDERS = ("recording", "pipeline", "frames", "image", "laser", "fusion", "synchronisation", "tracking")
RAISED = {
    "InvalidInput": 0,
    "Unusable": 0,
    "_unfit": 0,
    "wrong": 0,
    "Conflict": 0,
    "Flaw": 1,
    "BrokenImage": 2,
}
"""By what raises or makes it, which argument is the message."""
COUNTERS = {"left_out", "refused", "_left_out"}
REASONS = {
    "why_missing", "_outside", "why_none", "_reason_against", "_trouble", "_suspicion", "superfluous", "_better",
    "_fruitless", "_why_given_up", "refused", "left_out", "_what_it_is", "reason",
}  # fmt: skip
"""Functions that return, or collect, words that are told."""
TABLES = {"CAUSES": 1}
"""Tables of messages, and which part of each row is one."""


def told() -> set[str]:
    files = [file for folder in FOLDERS for file in (INGEST / folder).glob("*.py")]
    return {message for file in files for message in _messages(ast.parse(file.read_text(encoding="utf-8")))}


def _messages(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        match node:
            case ast.Call() if _name(node.func) in RAISED and len(node.args) > RAISED[_name(node.func)]:
                yield from _texts(node.args[RAISED[_name(node.func)]])
            case ast.ClassDef() if any(_name(base) in RAISED for base in node.bases):
                calls = [each for each in ast.walk(node) if isinstance(each, ast.Call)]
                yield from (
                    text for each in calls if _name(each.func) == "__init__" for text in _texts(each.args[0])
                )
            case ast.ClassDef(name="Why"):
                yield from (
                    text for each in node.body if isinstance(each, ast.Assign) for text in _texts(each.value)
                )
            case ast.Subscript() if _name(node.value) in COUNTERS:
                yield from _texts(node.slice)
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Tuple(elts=rows)) if name in TABLES:
                yield from (text for row in rows for text in _texts(row.elts[TABLES[name]]))  # type: ignore[attr-defined]
            case ast.FunctionDef() if node.name in REASONS:
                body = node.body if ast.get_docstring(node) is None else node.body[1:]
                yield from (text for each in body for text in _texts(each))


def _name(node: ast.expr) -> str:
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""


def _texts(node: ast.AST) -> Iterator[str]:
    """All texts in it that have words of their own."""
    if isinstance(node, ast.Constant | ast.JoinedStr):
        parts = node.values if isinstance(node, ast.JoinedStr) else [node]
        said = [str(part.value) if isinstance(part, ast.Constant) else "..." for part in parts]
        text = re.sub(r"(\.\.\.)+", "...", "".join(said)).strip()
        if isinstance(parts[0], ast.Constant | ast.FormattedValue) and re.search(
            r"[a-z]+ [A-Za-z]+|[a-z]{9}", text
        ):
            yield text
        return
    for child in ast.iter_child_nodes(node):
        yield from _texts(child)
