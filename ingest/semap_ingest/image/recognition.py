"""Which layout a model's outputs have: the one that is named, or the only one that is likely."""

from __future__ import annotations

from semap.errors import InvalidInput
from semap_ingest.image.arrangement import Arrangement, Evidence
from semap_ingest.image.layout import LAYOUTS, Layout


class Ambiguous(InvalidInput):
    """layouts  which it may be"""

    def __init__(self, layouts: tuple[str, ...], found: str, where: str) -> None:
        super().__init__(
            f"its outputs have an ambiguous layout, which may be {', '.join(layouts)}; it has {found}",
            f"Name the one that it was exported with: --camera-layout {layouts[0]}; its classes in a file,"
            " one in each line, may settle it too: --camera-classes FILE. What each finds in a picture:"
            f" semap detector add {where}",
            where,
        )
        self.layouts = layouts


def fitting(evidence: Evidence) -> tuple[str, ...]:
    """All layouts that its outputs may have, be it likely or not."""
    return tuple(each.name for each in LAYOUTS.values() if each.arrange(evidence) is not None)


def recognise(
    evidence: Evidence, found: str, layout: str | Layout | None, where: str
) -> tuple[Layout, Arrangement]:
    """The layout, and which output is what in it.

    found   inputs and outputs, as an error tells them
    layout  which one it is, where that is known
    raises  InvalidInput where the outputs are not of that layout, of none, or of more than one
    """
    if layout is not None:
        return _as_named(evidence, found, layout, where)
    possible = [(each, fits) for each in LAYOUTS.values() if (fits := each.arrange(evidence)) is not None]
    if not possible:
        raise InvalidInput(
            f"{_what_it_is(evidence)}; it has {found}{_names_said(evidence)}",
            f"Give a person detector with one of these outputs: {', '.join(LAYOUTS)}."
            " Where its metadata name other classes than it has, name them: --camera-classes FILE.",
            where,
        )
    likely = [(each, fits) for each, fits in possible if each.likely(evidence)]
    if len(likely) == 1:
        return likely[0]
    raise Ambiguous(tuple(each.name for each, _ in likely or possible), found, where)


def _as_named(evidence: Evidence, found: str, layout: str | Layout, where: str) -> tuple[Layout, Arrangement]:
    if isinstance(layout, str):
        if layout not in LAYOUTS:
            raise InvalidInput(f"there is no layout {layout!r}", f"There are {', '.join(LAYOUTS)}.", where)
        layout = LAYOUTS[layout]
    fits = layout.arrange(evidence)
    if fits is None:
        raise InvalidInput(
            f"its outputs are not of the layout {layout.name!r}; it has {found}{_names_said(evidence)}",
            "Leave --camera-layout out to have it recognised, or name another.",
            where,
        )
    return layout, fits


def _what_it_is(evidence: Evidence) -> str:
    sizes = [output.sizes for output in evidence.outputs]
    if len(sizes) == 1 and len([side for side in sizes[0] if side != 1]) <= 1:
        return "a classifier, or another model with one list of numbers for an image, and no detector"
    return "no detector whose outputs are known"


def _names_said(evidence: Evidence) -> str:
    return f" and {evidence.class_count} class names" if evidence.class_count is not None else ""
