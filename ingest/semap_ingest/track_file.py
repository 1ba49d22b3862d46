"""Finished tracks in a table: CSV (any usual delimiter) or Parquet.

One row is one state of one track. `read_tracks` gives them in the order of their stamps, in metres
and microseconds, and tells which rows it left out and why.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap.geometry.error_ellipse import Ellipses, ellipses_of, is_covariance
from semap.model.building import Finding
from semap_ingest import table_file
from semap_ingest.table_file import STAMP_NAMES, Roles, Table, read_floats, read_stamps, read_table, scale_of

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
    std_across_m, std_yaw_rad  (n,) float64 of the error ellipse, whose longer axis is std_m; NaN: a circle
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

    def __len__(self) -> int:
        return len(self.stamp_us)


def fingerprint(path: Path, layout: Layout, *options: object) -> str:
    """Identity of a file read in a certain way: SHA-256 of its bytes, the layout and further options."""
    return table_file.fingerprint(path, layout, *options)


def read_tracks(path: Path, layout: Layout) -> Tracks:
    """Read a file of tracks.

    raises InvalidInput where the file cannot be read so, naming the line where there is one
    """
    usual = {role: names for role, names in USUAL_NAMES.items() if role != "track" or layout.track is None}
    roles = Roles(
        usual=usual,
        optional=OPTIONAL,
        named=layout.columns,
        header=layout.names,
        or_else={"track": ", or --track NAME for a single track"},
    )
    return _assemble(read_table(path, roles), layout)


def _ellipses(table: Table, scale: float, std_m: NDArray[np.float64]) -> Ellipses:
    """How exact each place is: by the covariances of the table, or by what it has as standard deviation.

    scale   metres per unit of length
    raises  InvalidInput for both at once, a covariance of which a part is missing, and one that is none
    """
    present = [role for role in COVARIANCE if role in table.columns]
    if not present:
        return Ellipses(std_m, np.full(len(table), np.nan), np.full(len(table), np.nan))
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
    matrix = [read_floats(table.columns[role], role) * scale**2 for role in COVARIANCE]
    is_given = np.any([np.char.strip(table.columns[role]) != "" for role in COVARIANCE], axis=0)
    is_wrong = is_given & ~is_covariance(*matrix)
    if is_wrong.any():
        row = int(np.argmax(is_wrong))
        said = ", ".join(str(table.columns[role][row]).strip() or "nothing" for role in COVARIANCE)
        raise InvalidInput(
            f"({said}) is no covariance",
            "Mend it, so that cov_xy^2 <= var_x var_y; leave all three empty where it is not known.",
            f"near line {table.first_line + row}",
        )
    return ellipses_of(*matrix)


def _assemble(table: Table, layout: Layout) -> Tracks:
    columns, count = table.columns, len(table)
    scale = scale_of(METRES_PER_UNIT, layout.unit, "unit of length")
    values = {
        role: read_floats(columns[role], role) * scale if role in columns else np.full(count, np.nan)
        for role in ("x", "y", "z", "std")
    }
    ellipses = _ellipses(table, scale, values["std"])
    stamp_us, has_stamp = read_stamps(columns["stamp"], layout.stamp_unit, layout.epoch_us)
    if "track" in columns:
        names, track = np.unique(columns["track"], return_inverse=True)
    else:
        names, track = np.array([layout.track]), np.zeros(count, dtype=np.int64)

    finite = has_stamp & (np.abs(values["x"]) <= REACH_M) & (np.abs(values["y"]) <= REACH_M)
    finite &= np.isnan(values["z"]) | (np.abs(values["z"]) <= REACH_M)
    findings = []
    if not finite.all():
        where = table.first_line + int(np.argmin(finite))
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
        ellipses.std_m[order],
        ellipses.std_across_m[order],
        ellipses.std_yaw_rad[order],
        tuple(findings),
    )
