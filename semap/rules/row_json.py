"""Rows as JSON, so that they can wait in a table and stand in the state of a program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias, cast

import shapely

from semap.rules.row import PROPERTIES, Row, Source

RowJson: TypeAlias = list[object]
"""[stamp_us, rank, uid, source, values, concepts]; shapes are WKB in hex."""

SHAPES = tuple(name for name, kind in PROPERTIES.items() if kind == "shape")


def dump_row(row: Row) -> RowJson:
    """The row as JSON."""
    values: Mapping[str, object] = row.values
    shapes = [name for name, value in values.items() if isinstance(value, shapely.Geometry)]
    if shapes:
        values = {**values, **{name: shapely.to_wkb(values[name], hex=True) for name in shapes}}
    return [row.stamp_us, row.rank, row.uid, row.source, values, list(row.concepts)]


def load_row(document: object) -> Row:
    """The row that `dump_row` gave."""
    stamp_us, rank, uid, source, found, concepts = cast(Sequence[object], document)
    values = dict(cast(Mapping[str, object], found))
    for name, value in values.items():
        # what a row says of a neighbour ends with the name of the property
        if name.rpartition(" ")[2] in SHAPES and value is not None:
            values[name] = shapely.from_wkb(cast(str, value))
    return Row(
        cast(int, stamp_us),
        cast(int, rank),
        cast(str, uid),
        cast(Source, source),
        values,
        tuple(cast(Sequence[str], concepts)),
    )
