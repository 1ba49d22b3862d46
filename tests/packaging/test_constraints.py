"""constraints.txt: what `./dev` installs is always the same."""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

CHECKOUT = Path(__file__).parents[2]
BY_THEMSELVES = ("trackeval", "pycocotools", "tabulate")
"""Installed by ./dev without what they ask for."""


def needed() -> set[str]:
    """Names of all packages that the extra `dev` leads to, as far as they are installed here."""
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    named = (*extras["dev"][0].removeprefix("semap[").removesuffix("]").split(","), "dev")
    found: set[str] = set()
    waiting = [Requirement(text) for text in project["dependencies"]]
    waiting += [Requirement(text) for name in named for text in extras[name] if not text.startswith("semap[")]
    seen: set[str] = set()
    while waiting:
        wanted = waiting.pop()
        if str(wanted) in seen:
            continue
        seen.add(str(wanted))
        try:
            texts = requires(wanted.name) or []
        except PackageNotFoundError:
            continue
        found.add(canonicalize_name(wanted.name))
        for each in map(Requirement, texts):
            if each.marker is None or any(each.marker.evaluate({"extra": e}) for e in wanted.extras or {""}):
                waiting.append(each)
    return found


def test_every_package_of_the_environment_has_its_version() -> None:
    lines = (CHECKOUT / "constraints.txt").read_text().splitlines()
    pinned = [line.partition("==")[0] for line in lines if not line.startswith("#")]
    assert all(re.fullmatch(r"[\w.-]+==[\w.+!-]+", line) for line in lines if not line.startswith("#"))
    assert pinned == sorted(pinned, key=str.lower)
    names = {canonicalize_name(name) for name in pinned}
    assert needed() - names == set()
    assert set(BY_THEMSELVES) <= names
    assert "opencv-python" not in names
