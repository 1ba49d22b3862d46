"""Lists that become tables of pandas and GeoPandas (the extra `pandas`)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Generic, TypeVar, get_args, get_origin, get_type_hints, overload

from semap.errors import InvalidInput

if TYPE_CHECKING:
    import geopandas
    import pandas

T = TypeVar("T")

SHAPES = ("footprint", "geometry")
PLACES = ("state",)


class Table(Sequence[T], Generic[T]):
    """A sequence of values, all of one kind."""

    def __init__(self, kind: type[T], entries: Iterable[T]) -> None:
        self.kind = kind
        self._entries = tuple(entries)

    @overload
    def __getitem__(self, place: int) -> T: ...
    @overload
    def __getitem__(self, place: slice) -> Table[T]: ...
    def __getitem__(self, place: int | slice) -> T | Table[T]:
        if isinstance(place, slice):
            return Table(self.kind, self._entries[place])
        return self._entries[place]

    def __len__(self) -> int:
        return len(self._entries)

    def __iter__(self) -> Iterator[T]:
        return iter(self._entries)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Table) and self._entries == other._entries

    __hash__ = None  # type: ignore[assignment]  # its values hold mappings

    def __repr__(self) -> str:
        return f"<{len(self)} x {self.kind.__name__}>"

    def to_pandas(self) -> pandas.DataFrame:
        """A row for each entry; a value in a value gives columns such as `track_id` and `track_name`.

        raises  InvalidInput without pandas
        """
        try:
            import pandas  # noqa: PLC0415
        except ImportError as error:
            raise _missing("pandas") from error
        kind: Any = self.kind
        columns = _columns(kind)
        rows = [[_value(entry, path) for _, path in columns] for entry in self]
        return pandas.DataFrame(rows, columns=[name for name, _ in columns])

    def to_geopandas(self) -> geopandas.GeoDataFrame:
        """The same with a geometry, in metres of the map frame: the shape of a thing, the place of a track.

        raises  InvalidInput without geopandas, or where the entries are nowhere
        """
        try:
            import geopandas  # noqa: PLC0415
        except ImportError as error:
            raise _missing("GeoPandas") from error
        from shapely.geometry import Point, shape  # noqa: PLC0415

        names = {each.name for each in fields(self.kind)}  # type: ignore[arg-type]
        shaped = next((name for name in SHAPES if name in names), None)
        placed = next((name for name in PLACES if name in names), None)
        if shaped is None and placed is None and not {"x_m", "y_m"} <= names:
            raise InvalidInput(
                f"a table of {self.kind.__name__} has no shapes", "Use to_pandas(), or features()."
            )
        geometry: list[Any] = []
        entry: Any
        for entry in self:
            if shaped is not None:
                found = getattr(entry, shaped)
                geometry.append(None if found is None else shape(found))
                continue
            place = entry if placed is None else getattr(entry, placed)
            geometry.append(None if place is None else Point(place.x_m, place.y_m))
        frame = self.to_pandas()
        if shaped is not None:
            frame = frame.drop(columns=[shaped], errors="ignore")
        return geopandas.GeoDataFrame(frame, geometry=geometry)


Column = tuple[str, tuple[str, ...]]
"""A name, and the members that lead to its value."""


@cache
def _columns(kind: Any) -> tuple[Column, ...]:
    """The same for every list of this kind, whatever is in it."""
    found: list[Column] = []
    hints = get_type_hints(kind)
    for each in fields(kind):
        inner = _inner(hints[each.name])
        if inner is None:
            found.append((each.name, (each.name,)))
        else:
            found += [(f"{each.name}_{name}", (each.name, *path)) for name, path in _columns(inner)]
    return tuple(found)


def _inner(hint: Any) -> type | None:
    """The kind of value that a member is or may be; None where it is a plain one, or several."""
    return next((each for each in (hint, *get_args(hint)) if is_dataclass(each) and not _is_many(hint)), None)  # type: ignore[return-value]


def _is_many(hint: Any) -> bool:
    return get_origin(hint) is tuple


def _value(entry: object, path: Sequence[str]) -> Any:
    for name in path:
        entry = getattr(entry, name, None)
    return entry


def _missing(package: str) -> InvalidInput:
    return InvalidInput(f"tables need {package}, which is not installed", "pip install 'semap[pandas]'")
