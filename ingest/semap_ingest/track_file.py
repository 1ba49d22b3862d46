"""Finished tracks in a table: CSV (any usual delimiter) or Parquet.

One row is one state of one track. `read_tracks` gives them in the order of their stamps, in metres
and microseconds, and tells which rows it left out and why.
"""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap.model.building import Finding
from semap.timeline.stamp import parse_stamp

METRES_PER_UNIT = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}
MICROSECONDS_PER_UNIT = {"s": 1e6, "ms": 1e3, "us": 1.0, "ns": 1e-3}
USUAL_NAMES: Mapping[str, tuple[str, ...]] = {
    "track": ("track", "track_id", "id", "name"),
    "stamp": ("stamp", "timestamp", "time", "ts", "t"),
    "x": ("x_m", "x"),
    "y": ("y_m", "y"),
    "z": ("z_m", "z"),
    "std": ("std_m", "std", "sigma"),
}
OPTIONAL = ("z", "std")
REACH_M = 1e7


@dataclass(frozen=True)
class Layout:
    """How to read a file.

    columns     what is in which column, where it has not one of the usual names
    names       names of the columns of a file without a header
    track       name of the one track of a file without a column for it
    stamp_unit  iso, s, ms, us, ns, or frames at a rate: 25fps
    epoch_us    the time of stamp 0 [us since 1970]; not for iso
    unit        of lengths: m, cm, mm, ft, in
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    track: str | None = None
    stamp_unit: str = "iso"
    epoch_us: int = 0
    unit: str = "m"


@dataclass(frozen=True, eq=False)
class Tracks:
    """States in the order of their stamps; one entry of every array is one state.

    names     of the tracks; `track` holds indices of it, (n,) int64
    stamp_us  (n,) int64 [us since 1970], ascending
    x_m, y_m  (n,) float64 [m]
    z_m, std_m  (n,) float64 [m], NaN where a row has none
    """

    names: tuple[str, ...]
    track: NDArray[np.int64]
    stamp_us: NDArray[np.int64]
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    z_m: NDArray[np.float64]
    std_m: NDArray[np.float64]
    findings: tuple[Finding, ...] = ()

    def __len__(self) -> int:
        return len(self.stamp_us)


Columns = dict[str, NDArray[np.str_]]


def fingerprint(path: Path, layout: Layout, *options: object) -> str:
    """Identity of a file read in a certain way: SHA-256 of its bytes, the layout and further options."""
    digest = hashlib.sha256(repr((layout, *options)).encode())
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def read_tracks(path: Path, layout: Layout) -> Tracks:
    """Read a file of tracks.

    raises InvalidInput where the file cannot be read so, naming the line where there is one
    """
    if not path.is_file():
        raise InvalidInput(f"there is no file {path}", "Check the path.")
    if path.suffix.lower() in (".parquet", ".pq"):
        names, columns, first_line = _read_parquet(path, layout)
    else:
        names, columns, first_line = _read_csv(path.read_text(encoding="utf-8-sig", errors="replace"), layout)
    if not columns or len(next(iter(columns.values()))) == 0:
        raise InvalidInput("the file holds no states", "Check that it is the right file.", path.name)
    return _assemble(names, columns, first_line, layout)


def _read_parquet(path: Path, layout: Layout) -> tuple[list[str], Columns, int]:
    try:
        from pyarrow import ArrowInvalid, parquet  # noqa: PLC0415
    except ImportError as error:
        raise InvalidInput(
            "reading Parquet needs pyarrow", "pip install 'semap[parquet]'", path.name
        ) from error
    try:
        table = parquet.read_table(path)
    except ArrowInvalid as error:
        raise InvalidInput(f"not a Parquet file: {error}", "Check the file.", path.name) from error
    wanted = _choose(table.column_names, layout)
    columns: Columns = {}
    for role, name in wanted.items():
        column = table.column(name)
        if role == "stamp" and str(column.type).startswith("timestamp"):
            if column.type.tz is None:
                raise InvalidInput("the stamps have no time zone", "Write them with one (UTC).", name)
            columns[role] = np.array([value.isoformat() for value in column.to_pylist()])
        else:
            columns[role] = np.array(["" if value is None else str(value) for value in column.to_pylist()])
    return list(wanted), columns, 1


def _read_csv(text: str, layout: Layout) -> tuple[list[str], Columns, int]:
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        return [], {}, 1
    delimiter = _delimiter(lines[0][1])
    rows = _split((line for _, line in lines), delimiter)
    header = list(layout.names) or next(rows)
    if not layout.names and all(_is_number(cell) for cell in header):
        raise InvalidInput(
            f"the first line is no header: {lines[0][1][:60]}",
            f"Name the {len(header)} columns in their order: --names track,stamp,x,y,...",
            f"line {lines[0][0]}",
        )
    wanted = _choose(header, layout)
    places = [header.index(name) for name in wanted.values()]
    cells: list[list[str]] = [[] for _ in places]
    skipped = 0 if layout.names else 1
    for (number, _), row in zip(lines[skipped:], rows, strict=True):
        if len(row) < len(header):
            raise InvalidInput(
                f"{len(row)} values where {len(header)} are expected",
                "Mend the line, or remove it.",
                f"line {number}",
            )
        for column, place in zip(cells, places, strict=True):
            column.append(row[place])
    first_line = lines[skipped][0] if len(lines) > skipped else 1
    return (
        list(wanted),
        {role: np.array(column) for role, column in zip(wanted, cells, strict=True)},
        first_line,
    )


def _split(lines: Iterator[str], delimiter: str) -> Iterator[list[str]]:
    if delimiter == " ":
        return (line.split() for line in lines)
    return csv.reader(io.StringIO("\n".join(lines)), delimiter=delimiter, skipinitialspace=True)


def _delimiter(line: str) -> str:
    return max((",", ";", "\t"), key=line.count) if any(mark in line for mark in ",;\t") else " "


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _choose(present: Sequence[str], layout: Layout) -> dict[str, str]:
    """Which column plays which role."""
    chosen = {}
    for role, usual in USUAL_NAMES.items():
        named = layout.columns.get(role)
        if named is not None and named not in present:
            raise InvalidInput(f"there is no column {named!r}", f"The columns are: {', '.join(present)}.")
        name = named or next((name for name in usual if name in present), None)
        if role == "track" and layout.track is not None:
            continue
        if name is not None:
            chosen[role] = name
        elif role not in OPTIONAL:
            options = f"--{role}-column NAME" + (
                ", or --track NAME for a single track" if role == "track" else ""
            )
            raise InvalidInput(
                f"no column for the {role} was found",
                f"The columns are: {', '.join(present)}. Name it: {options}.",
            )
    return chosen


def _assemble(roles: list[str], columns: Columns, first_line: int, layout: Layout) -> Tracks:
    count = len(columns["stamp"])
    scale = _scale(METRES_PER_UNIT, layout.unit, "unit of length")
    values = {
        role: _floats(columns[role], role) * scale if role in roles else np.full(count, np.nan)
        for role in ("x", "y", "z", "std")
    }
    stamp_us, has_stamp = _stamps(columns["stamp"], layout)
    if "track" in roles:
        names, track = np.unique(columns["track"], return_inverse=True)
    else:
        names, track = np.array([layout.track]), np.zeros(count, dtype=np.int64)

    finite = has_stamp & (np.abs(values["x"]) <= REACH_M) & (np.abs(values["y"]) <= REACH_M)
    finite &= np.isnan(values["z"]) | (np.abs(values["z"]) <= REACH_M)
    findings = []
    if not finite.all():
        where = first_line + int(np.argmin(finite))
        findings.append(
            Finding(
                "skipped",
                f"{int((~finite).sum())} rows",
                f"no finite stamp, x, y or z (first near line {where})",
            )
        )
    order = np.flatnonzero(finite)
    if np.any(np.diff(stamp_us[order]) < 0):
        findings.append(Finding("note", "the order of rows", "not that of the stamps; sorted"))
    order = order[np.lexsort((track[order], stamp_us[order]))]
    twice = np.zeros(len(order), dtype=bool)
    twice[1:] = (np.diff(stamp_us[order]) == 0) & (np.diff(track[order]) == 0)
    if twice.any():
        findings.append(Finding("skipped", f"{int(twice.sum())} rows", "same track and stamp as another row"))
        order = order[~twice]
    if len(order) == 0:
        raise InvalidInput("no row has a finite stamp, x and y", "Check the columns and the units.")
    used, track = np.unique(track[order], return_inverse=True)
    return Tracks(
        tuple(str(name) for name in names[used]),
        track.astype(np.int64),
        stamp_us[order],
        values["x"][order],
        values["y"][order],
        values["z"][order],
        values["std"][order],
        tuple(findings),
    )


def _floats(cells: NDArray[np.str_], role: str) -> NDArray[np.float64]:
    """Numbers of a column; an empty cell is NaN."""
    try:
        return np.where(np.char.strip(cells) == "", "nan", cells).astype(np.float64)
    except ValueError:
        for row, cell in enumerate(cells, 1):
            if str(cell).strip() and not _is_number(str(cell)):
                raise InvalidInput(
                    f"{str(cell)!r} is not a number",
                    f"Mend it, or name another column: --{role}-column NAME.",
                    f"row {row}, {role}",
                ) from None
        raise


def _stamps(cells: NDArray[np.str_], layout: Layout) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    if layout.stamp_unit == "iso":
        return np.array([parse_stamp(str(cell)) for cell in cells], dtype=np.int64), np.ones(
            len(cells), dtype=bool
        )
    numbers = _floats(cells, "stamp")
    finite = np.isfinite(numbers) & (np.abs(numbers) * _stamp_scale(layout.stamp_unit) < 2**62)
    stamp_us = np.zeros(len(numbers), dtype=np.int64)
    stamp_us[finite] = np.round(numbers[finite] * _stamp_scale(layout.stamp_unit)).astype(np.int64)
    return stamp_us + layout.epoch_us, finite


def _stamp_scale(unit: str) -> float:
    if unit.endswith("fps") and _is_number(unit[:-3]) and float(unit[:-3]) > 0:
        return 1e6 / float(unit[:-3])
    return _scale(MICROSECONDS_PER_UNIT, unit, "unit of stamps")


def _scale(table: Mapping[str, float], unit: str, what: str) -> float:
    try:
        return table[unit]
    except KeyError:
        known = ", ".join(table) + (", iso or a rate such as 25fps" if "ns" in table else "")
        raise InvalidInput(f"{unit!r} is not a {what}", f"Use {known}.") from None
