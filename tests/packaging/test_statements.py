"""Statements are where ARCHITECTURE.md says; import-linter holds who may use which library."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[2]
SERVICE = CHECKOUT / "service" / "semap_service"
EXECUTES = {"execute", "executemany", "exec_driver_sql", "scalar", "scalars", "stream", "copy", "cursor"}
ASKS = {
    "bindparam",
    "column",
    "delete",
    "func",
    "insert",
    "literal",
    "select",
    "table",
    "text",
    "update",
    "values",
}


def asked_in(tree: ast.AST) -> Iterator[str]:
    """What sends a statement, or makes one of SQLAlchemy's parts."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in EXECUTES:
            yield f"{node.lineno}: .{node.func.attr}()"
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "sqlalchemy":
            yield from (f"{node.lineno}: {each.name}" for each in node.names if each.name in ASKS)
        if isinstance(node, ast.ImportFrom) and node.module == "semap.store.database.tables":
            yield f"{node.lineno}: tables"


@pytest.mark.parametrize(
    "code",
    [
        "connection.execute('select 1')",
        "with engine.begin() as c:\n    c.exec_driver_sql(TEXT)",
        "from sqlalchemy import Connection, text",
        "from semap.store.database.tables import track",
    ],
)
def test_a_statement_is_found(code: str) -> None:
    assert list(asked_in(ast.parse(code)))


def test_no_statement_is_in_the_service_or_its_command_line() -> None:
    found = {
        str(file.relative_to(SERVICE)): asked
        for file in SERVICE.rglob("*.py")
        if (asked := list(asked_in(ast.parse(file.read_text()))))
    }
    assert found == {}
