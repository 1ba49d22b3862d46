"""Rows as columns of JSON: what many rows say alike is written once.

Rows of a batch are mostly of few shapes: the same properties, often with the same values (the query's name,
the concept, what is known of a room). Rows of one shape are together, in a table of columns. A column is a
list of values; or of places in a list of different ones; or one value, where all are the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import repeat
from operator import itemgetter
from typing import TypeAlias, cast

import shapely

from semap.rules.row import Row, Source
from semap.rules.row_json import SHAPES

Column: TypeAlias = object
"""A list of values, {"is": value} of all, or {"of": values, "at": places}."""
Table: TypeAlias = Mapping[str, object]
OF_ROW = ("stamp_us", "rank", "uid", "source", "concepts")


def dump_rows(rows: Sequence[Row]) -> list[Table]:
    """The rows as tables, a place of each in their order with them, as JSON takes them."""
    tables: dict[tuple[str, ...], list[int]] = {}
    for place, row in enumerate(rows):
        tables.setdefault(tuple(row.values), []).append(place)
    return [_table(names, [rows[place] for place in places], places) for names, places in tables.items()]


def load_rows(tables: Iterable[Table]) -> list[Row]:
    """The rows that `dump_rows` gave, in their order; what was written once is one value of several."""
    rows: list[Row] = []
    order: list[int] = []
    for table in tables:
        rows += _rows(table)
        order += cast(Sequence[int], table["places"])
    return [row for _, row in sorted(zip(order, rows, strict=True), key=itemgetter(0))]


def _rows(table: Table) -> Iterator[Row]:
    names, count = cast(Sequence[str], table["names"]), len(cast(Sequence[int], table["places"]))
    columns = cast(Sequence[Column], table["columns"])
    said = [_read(name, column, count) for name, column in zip(names, columns, strict=True)]
    stamps, ranks, uids, sources, concepts = (_values(table[name], count) for name in OF_ROW)
    for stamp_us, rank, uid, source, above, values in zip(
        cast(Iterable[int], stamps),
        cast(Iterable[int], ranks),
        cast(Iterable[str], uids),
        cast(Iterable[Source], sources),
        map(tuple, cast(Iterable[Sequence[str]], concepts)),
        zip(*said, strict=True) if said else repeat((), count),
        strict=True,
    ):
        yield Row(stamp_us, rank, uid, source, dict(zip(names, values, strict=True)), above)


def _table(names: Sequence[str], rows: Sequence[Row], places: Sequence[int]) -> Table:
    by_name = zip(*(row.values.values() for row in rows), strict=True)
    return {
        "names": names,
        "places": places,
        "columns": [_column(_plain(name, values)) for name, values in zip(names, by_name, strict=True)],
        **{name: _column([getattr(row, name) for row in rows]) for name in OF_ROW},
    }


def _plain(name: str, values: Sequence[object]) -> Sequence[object]:
    if not _is_shape(name):
        return values
    return [shapely.to_wkb(each, hex=True) if isinstance(each, shapely.Geometry) else each for each in values]


def _read(name: str, column: Column, count: int) -> Iterable[object]:
    values = _values(column, count)
    if not _is_shape(name):
        return values
    return [None if each is None else shapely.from_wkb(cast(str, each)) for each in values]


def _is_shape(name: str) -> bool:
    # what a row says of a neighbour ends with the name of the property
    return name.rpartition(" ")[2] in SHAPES


def _column(values: Sequence[object]) -> Column:
    """Values that are the same object, or the same text, are written once, where that is shorter."""
    first = values[0]
    if type(first) is not str and all(each is first for each in values):
        return {"is": first}
    if isinstance(first, int | float):
        return values
    keys = [each if type(each) is str else id(each) for each in values]
    known = dict(zip(keys, values, strict=True))
    if len(known) == 1:
        return {"is": first}
    if 2 * len(known) > len(values):
        return values
    numbers = {key: number for number, key in enumerate(known)}
    return {"of": list(known.values()), "at": [numbers[key] for key in keys]}


def _values(column: Column, count: int) -> Iterable[object]:
    if not isinstance(column, Mapping):
        return cast(Iterable[object], column)
    if "is" in column:
        return [column["is"]] * count
    return map(cast(list[object], column["of"]).__getitem__, column["at"])
