"""Which instances of a map are meant, by what is known of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

Source = str | Mapping[str, object]


@dataclass(frozen=True)
class Selection:
    """Instances that meet all that is given; None asks for nothing.

    ids         among these
    names       with one of these names or aliases
    concept     of this concept, by name or IRI, or of one below it
    attributes  whose attributes contain these
    filter      CQL2 text, or CQL2 JSON, over the properties of `INSTANCE`
    """

    ids: tuple[int, ...] | None = None
    names: tuple[str, ...] | None = None
    concept: str | None = None
    attributes: Mapping[str, object] | None = None
    filter: Source | None = None
