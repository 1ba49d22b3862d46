"""The reference that is made of the code has all of it."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest
from semap_service.serving.app import create_app

from semap import Client
from semap.rules.language.template import TEMPLATES

CHECKOUT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def generate() -> ModuleType:
    spec = importlib.util.spec_from_file_location("generate", CHECKOUT / "docs/reference/generate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_command_line(generate: ModuleType) -> None:
    page = generate.command_line()
    for command in (
        "semap up",
        "semap map import",
        "semap rule explain",
        "semap plot plan",
        "semap token add",
    ):
        assert re.search(rf"^#+ {command}$", page, re.M), command
    assert "| `-f, --follow` |" in page


def test_rest(generate: ModuleType) -> None:
    page = generate.rest()
    paths = create_app("").openapi()["paths"]
    for path, methods in paths.items():
        for method in methods:
            assert f"### {method.upper()} {path}\n" in page
    assert "urn:semap:problem:not-found" in page


def test_every_function_of_the_schema(generate: ModuleType) -> None:
    page = generate.sql()
    for file in (CHECKOUT / "sql").rglob("*.sql"):
        created = r"^create or replace (?:aggregate|function|procedure) semap(?:_query)?\.(\w+)"
        for name in re.findall(created, file.read_text(), re.M):
            assert f"### {name}\n" in page, name
    assert "semap.in_objects(" in page
    assert "semap_query.is_near(" in page


def test_the_rule_language_and_the_client(generate: ModuleType) -> None:
    language = generate.rule_language()
    assert all(f"### {name}\n" in language for name in TEMPLATES)
    assert "- `partition_by`\n" in language
    client = generate.python()
    public = [
        name for name in vars(Client) if not name.startswith("_") and name not in ("close", "carry_out")
    ]
    assert all(f"client.{name}(" in client for name in public)
