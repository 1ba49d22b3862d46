"""Tables in files: CSV (any usual delimiter) or Parquet, read as texts column by column.

A table has roles, such as a stamp; a column plays one because it is named so, or has one of its usual names.
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
from semap.timeline.stamp import parse_stamp

MICROSECONDS_PER_UNIT = {"s": 1e6, "ms": 1e3, "us": 1.0, "ns": 1e-3}
STAMP_NAMES = ("stamp", "timestamp", "time", "ts", "t")

Cells = NDArray[np.str_]


@dataclass(frozen=True)
class Roles:
    """What the columns of a table are.

    usual     by role, the names that its column usually has
    optional  roles that a table may lack
    named     by role, the name that its column has here
    header    names of the columns of a file without a header
    or_else   by role, what else to do where no column plays it
    """

    usual: Mapping[str, Sequence[str]]
    optional: Sequence[str] = ()
    named: Mapping[str, str] = field(default_factory=dict)
    header: Sequence[str] = ()
    or_else: Mapping[str, str] = field(default_factory=dict)

    def choose(self, present: Sequence[str]) -> dict[str, str]:
        """Which column plays which role.

        raises  InvalidInput where a column that is named, or must be there, is missing
        """
        chosen = {}
        for role, usual in self.usual.items():
            named = self.named.get(role)
            if named is not None and named not in present:
                raise InvalidInput(f"there is no column {named!r}", f"The columns are: {', '.join(present)}.")
            name = named or next((name for name in usual if name in present), None)
            if name is not None:
                chosen[role] = name
            elif role not in self.optional:
                options = f"--{role}-column NAME{self.or_else.get(role, '')}"
                raise InvalidInput(
                    f"no column for the {role} was found",
                    f"The columns are: {', '.join(present)}. Name it: {options}.",
                )
        return chosen


@dataclass(frozen=True, eq=False)
class Table:
    """The cells of a table by role, each column (n,); its first row is in this line of the file."""

    columns: Mapping[str, Cells]
    first_line: int = 1

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))


def fingerprint(path: Path, *options: object) -> str:
    """Identity of a file read in a certain way: SHA-256 of its bytes and the options."""
    digest = hashlib.sha256(repr(options).encode())
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def read_table(path: Path, roles: Roles) -> Table:
    """Read a file.

    raises InvalidInput where it cannot be read so, or holds no row, naming the line where there is one
    """
    if not path.is_file():
        raise InvalidInput(f"there is no file {path}", "Check the path.")
    if path.suffix.lower() in (".parquet", ".pq"):
        table = _read_parquet(path, roles)
    else:
        table = _read_csv(path.read_text(encoding="utf-8-sig", errors="replace"), roles)
    if len(table) == 0:
        raise InvalidInput("the file holds no states", "Check that it is the right file.", path.name)
    return table


def _read_parquet(path: Path, roles: Roles) -> Table:
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
    columns: dict[str, Cells] = {}
    for role, name in roles.choose(table.column_names).items():
        column = table.column(name)
        if role == "stamp" and str(column.type).startswith("timestamp"):
            if column.type.tz is None:
                raise InvalidInput("the stamps have no time zone", "Write them with one (UTC).", name)
            columns[role] = np.array([value.isoformat() for value in column.to_pylist()])
        else:
            columns[role] = np.array(["" if value is None else str(value) for value in column.to_pylist()])
    return Table(columns)


def _read_csv(text: str, roles: Roles) -> Table:
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        return Table({})
    delimiter = _delimiter(lines[0][1])
    rows = _split((line for _, line in lines), delimiter)
    header = list(roles.header) or next(rows)
    if not roles.header and all(is_number(cell) for cell in header):
        raise InvalidInput(
            f"the first line is no header: {lines[0][1][:60]}",
            f"Name the {len(header)} columns in their order: --names {','.join(roles.usual)},...",
            f"line {lines[0][0]}",
        )
    wanted = roles.choose(header)
    places = [header.index(name) for name in wanted.values()]
    cells: list[list[str]] = [[] for _ in places]
    skipped = 0 if roles.header else 1
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
    columns = {role: np.array(column, dtype=np.str_) for role, column in zip(wanted, cells, strict=True)}
    return Table(columns, first_line)


def _split(lines: Iterator[str], delimiter: str) -> Iterator[list[str]]:
    if delimiter == " ":
        return (line.split() for line in lines)
    return csv.reader(io.StringIO("\n".join(lines)), delimiter=delimiter, skipinitialspace=True)


def _delimiter(line: str) -> str:
    return max((",", ";", "\t"), key=line.count) if any(mark in line for mark in ",;\t") else " "


def is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def read_floats(cells: Cells, role: str) -> NDArray[np.float64]:
    """Numbers of a column; an empty cell is NaN.

    raises InvalidInput naming the row of a cell that is no number
    """
    try:
        return np.where(np.char.strip(cells) == "", "nan", cells).astype(np.float64)
    except ValueError:
        for row, cell in enumerate(cells, 1):
            if str(cell).strip() and not is_number(str(cell)):
                raise InvalidInput(
                    f"{str(cell)!r} is not a number",
                    f"Mend it, or name another column: --{role}-column NAME.",
                    f"row {row}, {role}",
                ) from None
        raise


def read_stamps(cells: Cells, unit: str, epoch_us: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Stamps [us since 1970], and which of them are there and finite.

    unit      iso, s, ms, us, ns, or frames at a rate: 25fps
    epoch_us  the time of stamp 0 [us since 1970]; not for iso
    """
    if unit == "iso":
        return np.array([parse_stamp(str(cell)) for cell in cells], dtype=np.int64), np.ones(
            len(cells), dtype=bool
        )
    scale = _stamp_scale(unit)
    numbers = read_floats(cells, "stamp")
    finite = np.isfinite(numbers) & (np.abs(numbers) * scale < 2**62)
    stamp_us = np.zeros(len(numbers), dtype=np.int64)
    stamp_us[finite] = np.round(numbers[finite] * scale).astype(np.int64)
    return stamp_us + epoch_us, finite


def _stamp_scale(unit: str) -> float:
    if unit.endswith("fps") and is_number(unit[:-3]) and float(unit[:-3]) > 0:
        return 1e6 / float(unit[:-3])
    return scale_of(MICROSECONDS_PER_UNIT, unit, "unit of stamps")


def scale_of(table: Mapping[str, float], unit: str, what: str) -> float:
    """raises InvalidInput for a unit that the table does not have"""
    try:
        return table[unit]
    except KeyError:
        known = ", ".join(table) + (", iso or a rate such as 25fps" if "ns" in table else "")
        raise InvalidInput(f"{unit!r} is not a {what}", f"Use {known}.") from None
