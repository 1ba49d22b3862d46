"""docs/configuration.md and what doctor and documentation tell users to type: true to the code."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import click
import pytest
import typer
from semap_service.cli import commands

CHECKOUT = Path(__file__).parents[2]
PAGE = (CHECKOUT / "docs" / "configuration.md").read_text()
OF_ITS_OWN = {"SEMAP_DEV", "SEMAP_PARENT", "SEMAP_LOGGERS", "SEMAP_FLINK"}
"""Said by one part of semap or of ./dev to another, or no variable of the environment."""

ROOT = typer.main.get_command(commands())


def sources() -> str:
    folders = ("semap", "ingest/semap_ingest", "service/semap_service", "docker")
    files = [
        file
        for folder in folders
        for file in (CHECKOUT / folder).rglob("*")
        if file.suffix in (".py", ".sh", ".yaml")
    ]
    return "\n".join(file.read_text() for file in files)


def test_each_variable_is_explained_and_is_one() -> None:
    read = set(re.findall(r"\bSEMAP_[A-Z_]+\b", sources())) - OF_ITS_OWN
    assert set(re.findall(r"\bSEMAP_[A-Z_]+\b", PAGE)) == read


@pytest.mark.parametrize("name", ["serve", "up", "work"])
def test_each_option_is_explained(name: str) -> None:
    section = PAGE.partition(f"\n## semap {name}\n")[2].partition("\n## ")[0]
    options = {
        flag for parameter in ROOT.commands[name].params for flag in parameter.opts if flag.startswith("--")
    }  # type: ignore[attr-defined]
    assert set(re.findall(r"--[a-z][a-z-]*", section)) == options - {"--help"}


def told() -> list[tuple[str, str]]:
    """Every `semap ...` that the doctor and the pages on operating tell somebody to type."""
    checks = CHECKOUT / "semap/store/operate/doctor", CHECKOUT / "service/semap_service/operations/doctor"
    pages = [
        *(file for folder in checks for file in folder.glob("*.py")),
        CHECKOUT / "docs/operations.md",
        CHECKOUT / "docs/configuration.md",
    ]
    return [
        (page.name, call)
        for page in pages
        for call in re.findall(r"semap ((?:[a-z][a-z-]*)(?: [a-z][a-z-]*)?)\b", page.read_text())
    ]


def test_what_users_are_told_to_type_is_there() -> None:
    unknown = []
    for page, call in told():
        command: click.Command | None = ROOT
        words = shlex.split(call)
        if words[0] not in ROOT.commands:  # type: ignore[attr-defined]
            continue  # a sentence about semap
        for word in words:
            if not hasattr(command, "commands"):
                break
            command = command.commands.get(word)
            if command is None:
                unknown.append((page, call))
                break
    assert unknown == []
    assert len(told()) > 20
