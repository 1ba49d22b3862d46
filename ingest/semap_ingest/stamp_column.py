"""Stamps in a table: ISO 8601 with or without a zone, numbers since an epoch, frames at a rate."""

from __future__ import annotations

from datetime import UTC, datetime, tzinfo
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap.timeline.stamp import EARLIEST, LATEST, NoOffset, parse_stamp, to_us
from semap_ingest.table_file import Table, is_number, scale_of

MICROSECONDS_PER_UNIT = {"s": 1e6, "ms": 1e3, "us": 1.0, "ns": 1e-3}
EARLIEST_US, LATEST_US = to_us(EARLIEST), to_us(LATEST)


def read_stamps(table: Table, unit: str, epoch_us: int, timezone: str | None) -> NDArray[np.int64]:
    """Stamps [us since 1970], (n,); rows whose stamp cannot be stored are flawed.

    unit      iso, s, ms, us, ns, or frames at a rate: 25fps
    epoch_us  the time of stamp 0 [us since 1970]; not for iso
    timezone  of iso stamps that say none; None: each has to say its own
    raises    InvalidInput for a unit or a zone that there is not
    """
    zone = None if timezone is None else _zone(timezone)
    if unit == "iso":
        return _iso(table, zone)
    if zone is not None:
        raise InvalidInput(
            f"stamps in {unit} have no zone",
            "Say when stamp 0 was: --epoch 2026-01-31T12:00:00+01:00.",
            "--timezone",
        )
    scale = _scale(unit)
    numbers = table.numbers("stamp")
    _require_given(table)
    stamp_us = np.nan_to_num(numbers * scale, posinf=0.0, neginf=0.0) + epoch_us
    is_usual = (stamp_us >= EARLIEST_US) & (stamp_us < LATEST_US)
    table.flaws.add(
        ~is_usual,
        lambda row: f"the stamp {table.columns['stamp'][row]} in {unit} is not within the years 1800 to 9998",
        "Mend it, or name its unit: --stamp-unit s, ms, us, ns.",
    )
    whole = np.zeros(len(numbers), dtype=np.int64)
    whole[is_usual] = np.round(np.nan_to_num(numbers)[is_usual] * scale).astype(np.int64) + epoch_us
    return whole


def _iso(table: Table, zone: tzinfo | None) -> NDArray[np.int64]:
    cells = table.columns["stamp"]
    stamp_us = np.zeros(len(cells), dtype=np.int64)
    wrong: dict[int, InvalidInput] = {}
    _require_given(table)
    for row, cell in enumerate(cells):
        try:
            stamp_us[row] = parse_stamp(str(cell), zone)
        except NoOffset as error:
            wrong[row] = NoOffset(str(error), f"{error.remedy} For all of the file: --timezone ZONE.")
        except InvalidInput as error:
            wrong[row] = error
    for remedy in {error.remedy for error in wrong.values()}:
        is_wrong = np.zeros(len(cells), dtype=np.bool_)
        is_wrong[[row for row, error in wrong.items() if error.remedy == remedy]] = True
        table.flaws.add(is_wrong, lambda row: str(wrong[row]), remedy)
    table.flaws.add(
        (stamp_us < EARLIEST_US) | (stamp_us >= LATEST_US),
        lambda row: f"the stamp {cells[row]} is not within the years 1800 to 9998",
    )
    return stamp_us


def _require_given(table: Table) -> None:
    table.flaws.add(np.char.strip(table.columns["stamp"]) == "", lambda _: "there is no stamp")


def _scale(unit: str) -> float:
    if unit.endswith("fps") and is_number(unit[:-3]) and 0 < float(unit[:-3]) < np.inf:
        return 1e6 / float(unit[:-3])
    return scale_of(MICROSECONDS_PER_UNIT, unit, "unit of stamps", ", iso or a rate such as 25fps")


def _zone(name: str) -> tzinfo:
    if name in ("UTC", "Z"):
        return UTC
    try:
        if name[:1] in ("+", "-"):
            return datetime.fromisoformat(f"2000-01-01T00:00:00{name}").tzinfo or UTC
        return ZoneInfo(name)
    except (ValueError, OSError, LookupError) as error:
        raise InvalidInput(
            f"there is no time zone {name!r}", "Give one as Europe/Berlin, +01:00 or UTC.", "--timezone"
        ) from error
