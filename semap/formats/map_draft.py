"""A map while its file is read: what was named where, and what names what.

Names may be used before they are given, so that references are checked at the end.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from pathlib import Path

from semap.errors import InvalidInput
from semap.formats.refusals import LISTED_AT_MOST, Refusals
from semap.formats.validation import require_short
from semap.formats.yaml_node import Node
from semap.model.map_document import (
    ConceptEntry,
    DescriptionEntry,
    FrameEntry,
    InstanceEntry,
    OccupancyGrid,
    QueryEntry,
    RuleEntry,
)

ROOT = "map"
COMPARED_AT_MOST = 5_000


@dataclass(eq=False)
class Draft:
    """Entries as they are found.

    folder  that of the map; files of the map lie in it
    places  by kind and name, where a thing is given
    uses    kind and name of what is named elsewhere, and where
    standing_on  by instance of the short form, what it stands on
    wrong   what is wrong with entries
    """

    folder: Path
    rule_names: Collection[str] = ()
    concepts: list[ConceptEntry] = field(default_factory=list)
    frames: list[FrameEntry] = field(default_factory=list)
    descriptions: list[DescriptionEntry] = field(default_factory=list)
    instances: list[InstanceEntry] = field(default_factory=list)
    queries: list[QueryEntry] = field(default_factory=list)
    rules: list[RuleEntry] = field(default_factory=list)
    grids: list[OccupancyGrid] = field(default_factory=list)
    places: dict[tuple[str, str], str] = field(default_factory=dict)
    uses: list[tuple[str, str, str]] = field(default_factory=list)
    standing_on: dict[str, str] = field(default_factory=dict)
    wrong: Refusals = field(default_factory=Refusals)

    def read(self, section: Node, read: Callable[[str, Node, Draft], None]) -> None:
        """Read the entries of a section; those that are wrong are told by `check`."""
        for name, entry in section.mapping().items():
            with self.wrong.of_part(entry.mark.index):
                read(name, entry, self)

    def given(self, kind: str, name: str, node: Node) -> None:
        """Note that a thing is given here.

        raises  InvalidInput if one of its kind has that name already, or it has none, or a long one
        """
        if not name:
            raise node.wrong(f"a {kind} without a name", "Give it one.")
        if kind != "description":
            require_short(kind, name, node.where)
        before = self.places.setdefault((kind, name), node.where)
        if before != node.where:
            raise node.wrong(f"there is a {kind} {name!r} already, at {before}", "Give it another name.")

    def named(self, kind: str, node: Node) -> str:
        """The name that is used here."""
        self.uses.append((kind, node.text(), node.where))
        return node.text()

    def check(self, where: str) -> None:
        """raises  InvalidInput for entries that are wrong; else where a name is used that is not given; else
        where frames stand in a circle

        where  names the file
        """
        self.wrong.raise_if_any("entries", where)
        for place, use in enumerate(use for use in self.uses if use[:2] not in self.places):
            self.wrong.add(place, self._missing(*use, is_told=place < LISTED_AT_MOST))
        self.wrong.raise_if_any("names", where)
        self._refuse_circles()

    def _missing(self, kind: str, name: str, where: str, *, is_told: bool) -> InvalidInput:
        names = [known for of_kind, known in self.places if of_kind == kind] if is_told else []
        # The nearest of many takes seconds to find.
        near = difflib.get_close_matches(name, names, 1) if len(names) <= COMPARED_AT_MOST else []
        return InvalidInput(
            f"there is no {kind} {name!r} on this map",
            f"Did you mean {near[0]!r}?" if near else f"Add it, or name another {kind}.",
            where,
        )

    def inherit_storeys(self) -> None:
        """Give each instance of the short form the storey of what it stands on, where it names none.

        That has no circles, as `check` makes sure.
        """
        storeys = {each.name: each.storey for each in self.instances}
        is_storey = {each.name for each in self.instances if each.concept == "Storey"}
        for place, each in enumerate(self.instances):
            below: str | None = self.standing_on.get(each.name) if each.storey is None else None
            while below is not None:
                if (storey := below if below in is_storey else storeys.get(below)) is not None:
                    self.instances[place] = replace(each, storey=storey)
                    break
                below = self.standing_on.get(below)

    def _refuse_circles(self) -> None:
        parents = {each.name: each.parent for each in self.frames}
        safe: set[str | None] = {None}
        for name in parents:
            chain: list[str | None] = []
            above: str | None = name
            while above not in safe:
                if above in chain:
                    raise InvalidInput(
                        f"the frame {above!r} stands in itself",
                        "Give one of the frames on the circle another parent.",
                        self.places["frame", name],
                    )
                chain.append(above)
                above = parents[above] if above is not None else None
            safe.update(chain)
