"""Finished tracks in a table: CSV (any usual delimiter) or Parquet.

One row is one state of one track. `read_tracks` gives them in the order of their stamps, in metres
and microseconds, and tells which rows it left out and why.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap.geometry.error_ellipse import Ellipses, ellipses_of, is_covariance
from semap.model.building import Finding
from semap.store.database.name import require_plain_name
from semap_ingest import table_file
from semap_ingest.left_out import NOTHING, LeftOut
from semap_ingest.stamp_column import read_stamps
from semap_ingest.table_file import STAMP_NAMES, Roles, Table, named_in_errors, read_table, scale_of

METRES_PER_UNIT = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}
USUAL_NAMES: Mapping[str, tuple[str, ...]] = {
    "track": ("track", "track_id", "id", "name"),
    "stamp": STAMP_NAMES,
    "x": ("x_m", "x"),
    "y": ("y_m", "y"),
    "z": ("z_m", "z"),
    "std": ("std_m", "std", "sigma"),
    "var-x": ("var_x_m2",),
    "cov-xy": ("cov_xy_m2",),
    "var-y": ("var_y_m2",),
}
COVARIANCE = ("var-x", "cov-xy", "var-y")
OPTIONAL = ("z", "std", *COVARIANCE)
REACH_M = 1e7
"""As far from the origin as semap holds places (`state_is_finite` in the schema)."""
WIDEST_M = 1e15
"""Of a standard deviation (`ellipse_is_one` there)."""


@dataclass(frozen=True)
class Layout:
    """How to read a file.

    columns     what is in which column, where it has not one of the usual names
    names       names of the columns of a file without a header
    track       name of the one track of a file without a column for it
    stamp_unit  iso, s, ms, us, ns, or frames at a rate: 25fps
    epoch_us    the time of stamp 0 [us since 1970]; not for iso
    timezone    of iso stamps that say none, as Europe/Berlin or +01:00; None: each has to say its own
    unit        of lengths: m, cm, mm, ft, in
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    track: str | None = None
    stamp_unit: str = "iso"
    epoch_us: int = 0
    timezone: str | None = None
    unit: str = "m"


@dataclass(frozen=True, eq=False)
class Tracks:
    """States in the order of their stamps; one entry of every array is one state.

    names     of the tracks; `track` holds indices of it, (n,) int64
    stamp_us  (n,) int64 [us since 1970], ascending
    x_m, y_m  (n,) float64 [m]
    z_m, std_m  (n,) float64 [m], NaN where a row has none
    std_across_m, std_yaw_rad  (n,) float64 of the error ellipse, whose longer axis is std_m; NaN: a circle
    left_out  rows of the file that are not among them
    """

    names: tuple[str, ...]
    track: NDArray[np.int64]
    stamp_us: NDArray[np.int64]
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    z_m: NDArray[np.float64]
    std_m: NDArray[np.float64]
    std_across_m: NDArray[np.float64]
    std_yaw_rad: NDArray[np.float64]
    findings: tuple[Finding, ...] = ()
    left_out: LeftOut = NOTHING

    def __len__(self) -> int:
        return len(self.stamp_us)


def fingerprint(path: Path, layout: Layout, *options: object) -> str:
    """Identity of a file read in a certain way: SHA-256 of its bytes, the layout and further options."""
    return table_file.fingerprint(path, layout, *options)


def read_tracks(path: Path, layout: Layout) -> Tracks:
    """Read a file of tracks; rows that cannot be used are left out, and told.

    raises InvalidInput where the file cannot be read so, or has no row that can be used
    """
    usual = {role: names for role, names in USUAL_NAMES.items() if role != "track" or layout.track is None}
    roles = Roles(
        usual=usual,
        optional=OPTIONAL,
        named=layout.columns,
        header=layout.names,
        or_else={"track": ", or --track NAME for a single track"},
    )
    with named_in_errors(path):
        return _assemble(read_table(path, roles), layout)


def _ellipses(table: Table, scale: float) -> Ellipses:
    """How exact each place is: by the covariances of the table, or by what it has as standard deviation.

    scale   metres per unit of length
    raises  InvalidInput for both at once, and for a covariance of which a part is missing
    """
    unknown = np.full(len(table), np.nan)
    present = [role for role in COVARIANCE if role in table.columns]
    if not present:
        std_m = table.numbers("std") * scale if "std" in table.columns else unknown
        table.flaws.add(
            (std_m < 0) | (std_m >= WIDEST_M),
            lambda row: f"std is {table.columns['std'][row]}, no standard deviation",
            "Mend it, or leave it empty where it is not known.",
        )
        return Ellipses(std_m, unknown, unknown)
    if "std" in table.columns:
        raise InvalidInput(
            "the file has a standard deviation and a covariance", "Leave one of them out.", ", ".join(present)
        )
    if len(present) < len(COVARIANCE):
        missing = ", ".join(role for role in COVARIANCE if role not in present)
        raise InvalidInput(
            f"of the covariance there is no {missing}",
            "Give the columns var_x_m2, cov_xy_m2 and var_y_m2, or name yours: --var-x-column NAME ...",
            ", ".join(present),
        )
    matrix = [table.numbers(role) * scale**2 for role in COVARIANCE]
    is_given = np.any([np.char.strip(table.columns[role]) != "" for role in COVARIANCE], axis=0)
    table.flaws.add(
        is_given & ~is_covariance(*matrix),
        lambda row: f"({_said(table, row)}) is no covariance",
        "Mend it, so that cov_xy^2 <= var_x var_y; leave all three empty where it is not known.",
    )
    return ellipses_of(*(np.where(is_covariance(*matrix), each, np.nan) for each in matrix))


def _said(table: Table, row: int) -> str:
    return ", ".join(str(table.columns[role][row]).strip() or "nothing" for role in COVARIANCE)


def _places(table: Table, scale: float) -> dict[str, NDArray[np.float64]]:
    """x, y and z [m], each (n,); z is NaN where a row has none."""
    places = {}
    for role in ("x", "y", "z"):
        if role not in table.columns:
            places[role] = np.full(len(table), np.nan)
            continue
        values = table.numbers(role) * scale
        if role != "z":
            is_empty = np.char.strip(table.columns[role]) == ""
            table.flaws.add(is_empty, lambda _, role=role: f"there is no {role}")  # type: ignore[misc]
        table.flaws.add(
            np.abs(values) > REACH_M,
            lambda row, role=role, values=values: (  # type: ignore[misc]
                f"{role} is {values[row]:g} m, and semap holds places up to {REACH_M:,.0f} m from the origin"
            ),
            "Check --unit, or move the origin nearer: --frame.",
        )
        places[role] = values
    return places


def _assemble(table: Table, layout: Layout) -> Tracks:
    scale = scale_of(METRES_PER_UNIT, layout.unit, "unit of length")
    stamp_us = read_stamps(table, layout.stamp_unit, layout.epoch_us, layout.timezone)
    places = _places(table, scale)
    ellipses = _ellipses(table, scale)
    if layout.track is not None:
        require_plain_name(layout.track, "--track")
    cells = table.name("track") if "track" in table.columns else np.full(len(table), layout.track)
    names, track = np.unique(cells, return_inverse=True)
    columns = (*places.values(), *ellipses)
    repeated = _leave_out_repeated(table, track, stamp_us, columns)
    findings = []
    if repeated:
        findings.append(Finding("note", f"{repeated} rows", "say again what another row says"))
    left_out = table.flaws.left_out()
    order = np.flatnonzero(table.flaws.is_usable)
    if np.any(np.diff(stamp_us[order]) < 0):
        findings.append(Finding("note", "the order of rows", "not that of the stamps; sorted"))
    order = order[np.lexsort((track[order], stamp_us[order]))]
    is_new = np.ones(len(order), dtype=np.bool_)
    is_new[1:] = (np.diff(stamp_us[order]) != 0) | (np.diff(track[order]) != 0)
    order = order[is_new]
    used, track = np.unique(track[order], return_inverse=True)
    return Tracks(
        tuple(str(name) for name in names[used]),
        track.astype(np.int64),
        stamp_us[order],
        places["x"][order],
        places["y"][order],
        places["z"][order],
        ellipses.std_m[order],
        ellipses.std_across_m[order],
        ellipses.std_yaw_rad[order],
        tuple(findings),
        left_out,
    )


def _leave_out_repeated(
    table: Table,
    track: NDArray[np.int64],
    stamp_us: NDArray[np.int64],
    columns: Sequence[NDArray[np.float64]],
) -> int:
    """Leave out rows that contradict an earlier one of their track and stamp; how many only repeat it."""
    rows = np.flatnonzero(table.flaws.is_usable)
    rows = rows[np.lexsort((rows, track[rows], stamp_us[rows]))]
    is_first = np.ones(len(rows), dtype=np.bool_)
    is_first[1:] = (np.diff(stamp_us[rows]) != 0) | (np.diff(track[rows]) != 0)
    first = rows[np.maximum.accumulate(np.where(is_first, np.arange(len(rows)), 0))] if len(rows) else rows
    is_same = np.ones(len(rows), dtype=np.bool_)
    for column in columns:
        is_same &= (column[rows] == column[first]) | (np.isnan(column[rows]) & np.isnan(column[first]))
    contradicts = np.zeros(len(table), dtype=np.bool_)
    contradicts[rows[~is_same]] = True
    of = np.zeros(len(table), dtype=np.int64)
    of[rows] = first
    table.flaws.add(
        contradicts,
        lambda row: f"its track has another place at the same stamp in {table.flaws.place(of[row])}",
        "Remove one of them.",
    )
    return int((is_same & ~is_first).sum())
