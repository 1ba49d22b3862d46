"""What the commands on rules take: a rule by its name, or in a file."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from semap.errors import InvalidInput

if TYPE_CHECKING:
    from semap.rules.declaration import Declaration

MapOption = Annotated[str | None, typer.Option("--map", help="Only those of this map.")]
MapOfRule = Annotated[
    str | None, typer.Option("--map", help="Its map, where several maps have a rule of that name.")
]
RuleName = Annotated[
    str, typer.Argument(metavar="RULE", help="Name or number of the rule, as `semap rule list` shows it.")
]
RuleFile = Annotated[
    Path, typer.Argument(help="The rule as YAML or JSON; - reads standard input.", allow_dash=True)
]


def declaration_in(file: Path, name: str | None = None) -> Declaration:
    """The rule in a file; `name` stands in for a missing clause `name`.

    raises  InvalidInput
    """
    from semap.rules.language.reading import read_declaration  # noqa: PLC0415

    try:
        text = sys.stdin.read() if str(file) == "-" else file.read_text(encoding="utf-8")
    except OSError as error:
        raise InvalidInput(f"{file} cannot be read: {error.strerror}", "Check the path.") from error
    except UnicodeDecodeError as error:
        raise InvalidInput("not a text in UTF-8", "Check that it is the right file.", str(file)) from error
    return read_declaration(text, name)
