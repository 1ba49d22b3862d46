"""The command line asks the store, and sends no statement of its own."""

import re
from pathlib import Path

import semap_service.cli

STATEMENT = re.compile(r"\.(execute|exec_driver_sql|scalar|scalars|copy)\(|\bsemap\.store\.tables\b")


def test_the_command_line_sends_no_statement() -> None:
    files = sorted(Path(semap_service.cli.__file__).parent.rglob("*.py"))
    assert len(files) > 20
    assert [file.name for file in files if STATEMENT.search(file.read_text())] == []
