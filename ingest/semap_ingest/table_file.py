"""Tables in files: CSV (any usual delimiter) or Parquet, read as texts column by column.

A table has roles, such as a stamp; a column plays one because it is named so, or has one of its usual names.
"""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap_ingest.left_out import Flaws

if TYPE_CHECKING:
    from pyarrow import ChunkedArray

STAMP_NAMES = ("stamp", "timestamp", "time", "ts", "t")
NO_TEXT = "\ufffd"
"""It stands for bytes that are no text, and here for NUL, which no database keeps."""
LONGEST_NAME = 200
UTF_16 = (b"\xff\xfe", b"\xfe\xff")

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

        raises  InvalidInput where a column that is named, or must be there, is missing or there twice
        """
        chosen = {}
        for role, usual in self.usual.items():
            named = self.named.get(role)
            if named is not None and named not in present:
                raise InvalidInput(f"there is no column {named!r}", f"The columns are: {', '.join(present)}.")
            name = named or next((name for name in usual if name in present), None)
            if name is not None and list(present).count(name) > 1:
                raise InvalidInput(
                    f"several columns are called {name!r}",
                    f"Give each its own name; --{role}-column says which.",
                )
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
    """The cells of a table by role, each column (n,), and what is wrong with its rows."""

    columns: Mapping[str, Cells]
    flaws: Flaws

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def text(self, role: str) -> Cells:
        """A column without the white space around; rows where it is no text are flawed."""
        cells = np.char.strip(self.columns[role])
        is_none = np.char.find(cells, NO_TEXT) >= 0
        self.flaws.add(
            is_none, lambda _: f"the {role} is no text in UTF-8, or has NUL in it", "Save it in UTF-8."
        )
        return cells

    def name(self, role: str) -> Cells:
        """The same of a column with names."""
        cells = self.text(role)
        self.flaws.add(cells == "", lambda _: f"the {role} has no name", "Name it, or remove the row.")
        self.flaws.add(
            np.char.str_len(cells) > LONGEST_NAME,
            lambda row: f"the {role} {cells[row][:20]}... has a name of {len(cells[row])} characters",
            f"Choose one of at most {LONGEST_NAME}.",
        )
        return cells

    def numbers(self, role: str) -> NDArray[np.float64]:
        """Numbers of a column; NaN where a cell is empty, or none: then its row is flawed."""
        cells = np.char.strip(self.columns[role])
        is_given = cells != ""
        values = np.full(len(cells), np.nan)
        try:
            values[is_given] = cells[is_given].astype(np.float64)
        except ValueError:
            is_numeric = np.array([is_number(str(cell)) for cell in cells], dtype=np.bool_)
            values[is_numeric] = cells[is_numeric].astype(np.float64)
            self.flaws.add(
                is_given & ~is_numeric,
                lambda row: f"{role}: {cells[row][:60]!r} is not a number",
                f"Mend it, or name another column: --{role}-column NAME.",
            )
            is_given = is_numeric
        self.flaws.add(
            is_given & ~np.isfinite(values),
            lambda row: f"{role} is {cells[row]}, no finite number",
            "Mend it, or remove the row.",
        )
        return values


def fingerprint(path: Path, *options: object) -> str:
    """Identity of a file read in a certain way: SHA-256 of its bytes and the options."""
    digest = hashlib.sha256(repr(options).encode())
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


@contextmanager
def named_in_errors(path: Path) -> Iterator[None]:
    """What is wrong with a file is said with its name."""
    try:
        yield
    except InvalidInput as error:
        said = str(error)
        if not said.startswith(path.name):
            raise InvalidInput(f"{path.name}{', ' if error.where else ': '}{said}", error.remedy) from error
        raise


def read_table(path: Path, roles: Roles) -> Table:
    """Read a file.

    raises InvalidInput where it cannot be read so, or holds no row
    """
    if not path.is_file():
        raise InvalidInput(f"there is no file {path}", "Check the path.")
    if path.suffix.lower() in (".parquet", ".pq"):
        table = _read_parquet(path, roles)
    else:
        table = _read_csv(path.name, _text(path), roles)
    if len(table) == 0:
        raise InvalidInput("the file holds no states", "Check that it is the right file.", path.name)
    return table


def _text(path: Path) -> str:
    data = path.read_bytes()
    text = data.decode("utf-16" if data[:2] in UTF_16 else "utf-8-sig", errors="replace")
    return text.replace("\0", NO_TEXT)


def _read_parquet(path: Path, roles: Roles) -> Table:
    try:
        from pyarrow import ArrowException, parquet  # noqa: PLC0415
    except ImportError as error:
        raise InvalidInput(
            "reading Parquet needs pyarrow", "pip install 'semap[parquet]'", path.name
        ) from error
    try:
        table = parquet.read_table(path)
        chosen = roles.choose(table.column_names)
        columns = {role: _parquet_texts(table.column(name)) for role, name in chosen.items()}
    except ArrowException as error:
        raise InvalidInput(f"not a Parquet file: {error}", "Check the file.", path.name) from error
    return Table(columns, Flaws(path.name, np.arange(1, table.num_rows + 1), "row"))


def _parquet_texts(column: ChunkedArray) -> Cells:
    """The cells as CSV would have them; those of instants in UTC, with Z where the column has a zone."""
    import pyarrow  # noqa: PLC0415

    if not pyarrow.types.is_timestamp(column.type):
        return np.array(
            ["" if value is None else str(value).replace("\0", NO_TEXT) for value in column.to_pylist()],
            dtype=np.str_,
        )
    instants = column.cast(pyarrow.timestamp("us", column.type.tz), safe=False).to_numpy()
    texts = np.datetime_as_string(instants.astype("datetime64[us]"))
    with_zone = np.char.add(texts, "Z") if column.type.tz else texts
    return np.where(np.isnat(instants), "", with_zone)


def _read_csv(file: str, text: str, roles: Roles) -> Table:
    first = next(_content(text), None)
    if first is None:
        return Table({}, Flaws(file, np.zeros(0, dtype=np.int64), "line"))
    rows = _split(text, _delimiter(first[1]))
    header = list(roles.header) or next(rows)[1]
    if not roles.header and all(is_number(cell) for cell in header):
        raise InvalidInput(
            f"the first line is no header: {first[1].strip()[:60]}",
            f"Name the {len(header)} columns in their order: --names {','.join(roles.usual)},...",
            f"line {first[0]}",
        )
    wanted = roles.choose(header)
    columns = [header.index(name) for name in wanted.values()]
    cells: list[list[str]] = [[] for _ in columns]
    places: list[int] = []
    sizes: list[int] = []
    for place, row in rows:
        places.append(place)
        sizes.append(len(row))
        whole = row if len(row) >= len(header) else [*row, *[""] * (len(header) - len(row))]
        for column, each in zip(cells, columns, strict=True):
            column.append(whole[each])
    flaws = Flaws(file, np.array(places, dtype=np.int64), "line")
    flaws.add(
        np.array(sizes, dtype=np.int64) != len(header),
        lambda row: f"{sizes[row]} values where {len(header)} are expected",
        "Mend the line: commas within a value want quotes, decimals a point.",
    )
    texts = (np.array(column, dtype=np.str_) for column in cells)
    return Table(dict(zip(wanted, texts, strict=True)), flaws)


def _content(text: str) -> Iterator[tuple[int, str]]:
    """The lines that are neither empty nor comments, with their numbers."""
    for number, line in enumerate(io.StringIO(text, newline=None), 1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, line


def _split(text: str, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """The cells of each row, with the line that it begins in; empty ones at its end do not count.

    raises InvalidInput for a quote that is never closed, or closed within a value
    """
    begins_in = 0

    def lines() -> Iterator[str]:
        nonlocal begins_in
        for number, line in _content(text):
            begins_in = begins_in or number
            yield line

    if delimiter == " ":
        yield from ((number, line.split()) for number, line in _content(text))
        return
    reader = csv.reader(lines(), delimiter=delimiter, skipinitialspace=True, strict=True)
    width = 0
    while True:
        begins_in = 0
        try:
            row = next(reader, None)
        except csv.Error as error:
            raise InvalidInput(
                f"its quotes are not those of CSV: {error}",
                'Close each quote, and write one within a value twice: "".',
                f"line {begins_in}",
            ) from error
        if row is None:
            return
        width = width or len(row)
        while len(row) > width and not row[-1].strip():
            row.pop()
        yield begins_in, row


def _delimiter(line: str) -> str:
    return max((",", ";", "\t"), key=line.count) if any(mark in line for mark in ",;\t") else " "


def is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def scale_of(table: Mapping[str, float], unit: str, what: str, others: str = "") -> float:
    """raises InvalidInput for a unit that the table does not have"""
    try:
        return table[unit]
    except KeyError:
        raise InvalidInput(f"{unit!r} is not a {what}", f"Use {', '.join(table)}{others}.") from None
