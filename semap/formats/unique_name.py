"""Names that occur once in a building, made from names that need not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from semap.model.building import Finding


def unique_names(
    wanted: Sequence[tuple[str, str | None]], taken: Iterable[str] = ()
) -> tuple[tuple[str, ...], tuple[Finding, ...]]:
    """One name for each wanted (name, storey), in order, with a finding for each that was changed.

    A name wanted on several storeys gets its storey appended; what is still taken then gets a number.
    """
    storeys: dict[str, set[str | None]] = {}
    for name, storey in wanted:
        storeys.setdefault(name, set()).add(storey)
    repeated = {name for name, count in Counter(name for name, _ in wanted).items() if count > 1}
    # Names that are fine as they are go first, so that a renamed one never takes theirs.
    used = {*taken}
    kept = {name for name, _ in wanted if name not in repeated and name not in used}
    used |= kept
    names: list[str] = []
    findings: list[Finding] = []
    for name, storey in wanted:
        if name in kept:
            names.append(name)
            continue
        stem = f"{name} ({storey})" if len(storeys[name]) > 1 and storey is not None else name
        unique, number = stem, 2
        while unique in used:
            unique, number = f"{stem} {number}", number + 1
        used.add(unique)
        names.append(unique)
        if unique != name:
            findings.append(Finding("note", unique, f"its name {name!r} is not the only one of its kind"))
    return tuple(names), tuple(findings)
