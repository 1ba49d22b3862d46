"""Findings of one kind told once: a hundred equal lines hide the one that matters."""

from __future__ import annotations

import re
from collections.abc import Iterable

from semap.model.building import Finding

APART_AT_MOST = 5
NAMED = 3
PARTICULAR = re.compile(r"'[^']*'|\"[^\"]*\"|[-+]?\d[\d.]*(?:e[-+]?\d+)?")
"""What two reasons of one kind may differ in: names in quotes, and numbers."""


def folded(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings in their order, where more than five of one kind become one that names some and counts all."""
    kinds: dict[tuple[str, str], list[Finding]] = {}
    for finding in findings:
        kinds.setdefault((finding.action, PARTICULAR.sub("#", finding.reason)), []).append(finding)
    told: list[Finding] = []
    for (action, _), alike in kinds.items():
        if len(alike) <= APART_AT_MOST:
            told += alike
            continue
        names = ", ".join(each.subject for each in alike[:NAMED])
        first = alike[0]
        is_same = all(each.reason == first.reason for each in alike)
        reason = first.reason if is_same else f"{first.reason}; the others likewise"
        told.append(Finding(action, f"{names} and {len(alike) - NAMED} more", reason))
    return tuple(told)
