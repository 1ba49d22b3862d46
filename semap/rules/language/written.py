"""A stored rule as the YAML that a person would write: what `reading` reads of it is the same rule."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

from semap.rules.language.source_text import is_text

CLAUSES = (
    "name",
    "input",
    "where",
    "partition_by",
    "pattern",
    "subset",
    "when",
    "formula",
    "define",
    "measures",
    "rows_per_match",
    "within",
    "after_match",
    "about",
    "confidence",
    "emit",
)
"""In the order in which they are read best; docs/rules.md writes them so."""

WIDTH = 100
SHORT_LIST = 80


def write_rule(name: str, declaration: Mapping[str, object]) -> str:
    """The text of a rule, with the name as its first clause."""
    clauses = {"name": name, **declaration}
    known = [clause for clause in CLAUSES if clause in clauses]
    others = [clause for clause in clauses if clause not in CLAUSES]
    return yaml.dump(
        {clause: clauses[clause] for clause in (*known, *others)},
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
        width=WIDTH,
    )


class _Dumper(yaml.SafeDumper):
    """Quotes what YAML 1.2, as rules are read, or YAML 1.1, as PyYAML reads, would take for no text."""

    def ignore_aliases(self, data: Any) -> bool:
        """Anchors and aliases are refused in rules."""
        return True


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = None if is_text(text) else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


def _list(dumper: yaml.SafeDumper, values: list[Any]) -> yaml.SequenceNode:
    node = dumper.represent_sequence("tag:yaml.org,2002:seq", values)
    node.flow_style = len(str(values)) <= SHORT_LIST
    return node


_Dumper.add_representer(str, _text)
_Dumper.add_representer(list, _list)
