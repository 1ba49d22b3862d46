"""Writing of YAML that differs little between exports: keys keep their order, floats round-trip."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import yaml

from semap.formats.yaml_node import RESOLVED, TAG

WIDTH = 110


class Flow(dict[str, object]):
    """A mapping on one line: {a: 1, b: 2}."""


class Row(list[object]):
    """A list on one line: [1, 2]."""


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    """Writes what is the same in YAML 1.1 and 1.2, without anchors."""

    def ignore_aliases(self, data: Any) -> bool:
        """Repeat rather than refer, as a diff is read from top to bottom."""
        return True


_Dumper.add_representer(Flow, lambda dumper, data: dumper.represent_mapping(TAG + "map", data.items(), True))
_Dumper.add_representer(Row, lambda dumper, data: dumper.represent_sequence(TAG + "seq", data, True))
# Texts that either version would take for something else are put in quotes.
for _name, (_pattern, _first) in RESOLVED.items():
    _Dumper.add_implicit_resolver(TAG + _name, _pattern, _first)


def yaml_text(tree: Mapping[str, object]) -> str:
    """A tree of mappings, lists, texts, numbers, booleans and None as YAML."""
    return str(
        yaml.dump(
            tree, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=WIDTH, default_flow_style=False
        )
    )


def row(numbers: Iterable[float]) -> Row:
    """Numbers on one line."""
    return Row(float(number) for number in numbers)
