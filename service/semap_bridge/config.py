"""The config of bridges: YAML, whose errors name the line and what to write there.

    map: office
    bridges:
      - name: robot
        kind: ndjson
        ...             # settings of the adapter

Paths in it are meant from the folder of the file. Secrets are not in it: it names the files that have them.
A kind of adapter and a map are a config, too, where that needs no more settings.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, ValidationInfo

from semap.errors import InvalidInput
from semap.formats.checked_node import checked
from semap.formats.refusals import Refusals
from semap.formats.yaml_node import Node, parse_yaml
from semap_bridge.adapter import Adapter, Settings
from semap_bridge.context import Context
from semap_bridge.kinds import KINDS, adapter_of


def _from_folder(path: Path, info: ValidationInfo) -> Path:
    folder: Path = (info.context or {}).get("folder", Path())
    return folder / path


ConfigPath = Annotated[Path, AfterValidator(_from_folder)]
"""A path that is meant from the folder of the config."""


@dataclass(frozen=True)
class Entry:
    """A bridge of a config."""

    map_name: str
    kind: type[Adapter[Any]]
    settings: Settings

    def adapter(self, context: Context) -> Adapter[Any]:
        """A new connection to its peer."""
        return self.kind(self.settings, context)


@dataclass(frozen=True)
class Config:
    """A map, and what it is connected with."""

    path: Path
    map_name: str
    bridges: tuple[Entry, ...]

    def of(self, name: str) -> Entry:
        """raises InvalidInput"""
        for each in self.bridges:
            if each.settings.name == name:
                return each
        names = ", ".join(each.settings.name for each in self.bridges)
        raise InvalidInput(f"it has no bridge {name}", f"It has {names}.", str(self.path))


def read_config(path: Path, map_name: str | None = None) -> Config:
    """The config of a file, or of a kind of adapter and a map.

    raises  InvalidInput, which names each line that is wrong
    """
    kind = str(path)
    if kind in KINDS and not path.exists():
        if map_name is None:
            raise InvalidInput("a kind needs a map", f"Name it: semap bridge {kind} --map MAP", kind)
        said = json.dumps({"map": map_name, "bridges": [{"name": kind, "kind": kind}]})
        return _config(said.encode(), path)
    if map_name is not None:
        raise InvalidInput("a config names its map itself", "Omit --map.", kind)
    try:
        return _config(path.read_bytes(), path)
    except OSError as error:
        raise InvalidInput(
            f"cannot be read: {error.strerror}",
            f"Name the config's file, or with --map one of {', '.join(sorted(KINDS))}.",
            kind,
        ) from error


def _config(data: bytes, path: Path) -> Config:
    document = parse_yaml(data, str(path))
    fields = document.fields({"map", "bridges"})
    for key, remedy in (("map", "Write map: NAME."), ("bridges", "Write bridges: and a list of them.")):
        if key not in fields:
            raise document.wrong(f"there is no {key}", remedy)
    refusals = Refusals()
    entries: list[Entry] = []
    for node in fields["bridges"].sequence(least=1):
        with refusals.of_part(node.mark.line):
            entry = _entry(node, fields["map"].text(), path.resolve().parent)
            if entry.settings.name in (each.settings.name for each in entries):
                name = node.mapping()["name"]
                raise name.wrong(f"another bridge is called {entry.settings.name}", "Give it another name.")
            entries.append(entry)
    refusals.raise_if_any("bridges", str(path))
    return Config(path, fields["map"].text(), tuple(entries))


def _entry(node: Node, map_name: str, folder: Path) -> Entry:
    mapping = node.mapping()
    if "kind" not in mapping:
        raise node.wrong("there is no kind", "Write kind: and an adapter; see semap bridge kinds.")
    kind = mapping["kind"]
    adapter = adapter_of(kind.text(), kind.where)
    settings = checked(node, adapter.Settings, {"folder": folder})
    return Entry(map_name, adapter, settings)
