"""States of tracks that are known by their names, as they come from robots, trackers and brokers.

What cannot be stored is refused record by record, each with a reason of few words, by which it is counted,
and what exactly is wrong with it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semap.model.track_state import COORDINATES, MEASURES, TrackState
from semap.store.database.name import LONGEST_NAME
from semap.timeline.stamp import DAY_US, EARLIEST, LATEST, to_datetime, to_us
from semap_ingest.track_file import REACH_M, WIDEST_M

Floats = NDArray[np.float64]
Flaw = tuple[NDArray[np.bool_], str, Callable[[int], str]]
"""Which rows have it, its name, and what is wrong with one of them."""

VALUES = (*COORDINATES, *MEASURES)
EARLIEST_US, LATEST_US = to_us(EARLIEST), to_us(LATEST)
MOST_DAYS = 100
MOST_AHEAD_S = 10.0
"""So far may a stamp be ahead of this machine's clock, if nothing else is said."""


@dataclass(frozen=True)
class Refused:
    """A record that was not taken: its place among those that were given, why, and in detail."""

    index: int
    reason: str
    detail: str


@dataclass(frozen=True)
class NamedStates:
    """n states of tracks, in the map frame.

    names     of their tracks, (n,)
    stamp_us  [us since 1970], (n,)
    values    x_m and y_m, and what else is known of `VALUES`, (n,) each; NaN: not of this one
    is_last   after it the track was gone, (n,)
    index     the place of each among the records that it was given with, (n,)
    """

    names: Sequence[str]
    stamp_us: NDArray[np.int64]
    values: Mapping[str, Floats]
    is_last: NDArray[np.bool_]
    index: NDArray[np.int64] = field(repr=False)

    def __len__(self) -> int:
        return len(self.names)

    @classmethod
    def of_columns(
        cls,
        names: Sequence[str],
        stamp_us: ArrayLike,
        *,
        is_last: ArrayLike | None = None,
        index: ArrayLike | None = None,
        **values: ArrayLike,
    ) -> NamedStates:
        """Of columns, or of one value for all; `values` are named as in `VALUES`."""
        count = len(names)

        def column(given: ArrayLike, dtype: type) -> NDArray[np.generic]:
            return np.broadcast_to(np.asarray(given, dtype=dtype), (count,))

        return cls(
            names,
            column(stamp_us, np.int64),  # type: ignore[arg-type]
            {name: column(each, np.float64) for name, each in values.items()},  # type: ignore[misc]
            column(False if is_last is None else is_last, np.bool_),  # type: ignore[arg-type]
            column(np.arange(count) if index is None else index, np.int64),  # type: ignore[arg-type]
        )

    @classmethod
    def of(cls, states: Iterable[tuple[str, TrackState]]) -> NamedStates:
        """Of single states, each with the name of its track."""
        given = list(states)
        columns = {
            name: [np.nan if (value := getattr(each, name)) is None else value for _, each in given]
            for name in VALUES
        }
        return cls.of_columns(
            [name for name, _ in given],
            np.array([to_us(each.stamp) for _, each in given], dtype=np.int64),
            is_last=np.array([each.is_last for _, each in given], dtype=np.bool_),
            **{
                name: column
                for name, column in columns.items()
                if name in ("x_m", "y_m") or not np.isnan(column).all()
            },
        )

    @classmethod
    def joined(cls, parts: Sequence[NamedStates]) -> NamedStates:
        """One after the other."""
        if len(parts) == 1:
            return parts[0]
        known = {name for each in parts for name in each.values}
        return cls(
            [name for each in parts for name in each.names],
            np.concatenate([each.stamp_us for each in parts]),
            {
                name: np.concatenate([each.values.get(name, np.full(len(each), np.nan)) for each in parts])
                for name in VALUES
                if name in known
            },
            np.concatenate([each.is_last for each in parts]),
            np.concatenate([each.index for each in parts]),
        )

    def take(self, rows: NDArray[np.int64]) -> NamedStates:
        """Those at these places, in this order."""
        return NamedStates(
            [self.names[row] for row in rows],
            self.stamp_us[rows],
            {name: each[rows] for name, each in self.values.items()},
            self.is_last[rows],
            self.index[rows],
        )

    def value(self, name: str) -> Floats:
        """(n,); NaN throughout where nothing is known of it."""
        return self.values.get(name, np.full(len(self), np.nan))


NO_STATES = NamedStates.of_columns([], [], x_m=[], y_m=[])


def sifted(
    states: NamedStates, now_us: int, *, ahead_s: float = MOST_AHEAD_S, behind_s: float | None = None
) -> tuple[NamedStates, list[Refused]]:
    """Those that can be stored where none is repeated, and what is wrong with the others.

    ahead_s   so far may a stamp be ahead of `now_us`
    behind_s  so far may it be behind; None: as far as it likes
    """
    good, flawed = _without(states, _flaws(states, now_us, ahead_s, behind_s))
    return good, sorted(flawed, key=lambda each: each.index)


def without_repeats(states: NamedStates) -> tuple[NamedStates, list[Refused]]:
    """Only the first state of each track at a stamp, and which others there were."""
    return _without(states, [_repeated(states)])


def _without(states: NamedStates, flaws: Sequence[Flaw]) -> tuple[NamedStates, list[Refused]]:
    is_good = np.ones(len(states), dtype=np.bool_)
    refused: list[Refused] = []
    for is_bad, reason, detail in flaws:
        for row in np.flatnonzero(is_bad & is_good):
            refused.append(Refused(int(states.index[row]), reason, detail(int(row))))
        is_good &= ~is_bad
    return (states if is_good.all() else states.take(np.flatnonzero(is_good))), refused


def _flaws(states: NamedStates, now_us: int, ahead_s: float, behind_s: float | None) -> list[Flaw]:
    """What the schema's constraints would refuse, and stamps that cannot be, as the rows that have it."""
    stamps = states.stamp_us
    flaws: list[Flaw] = [
        (
            _rows_of(states, {name for name in set(states.names) if not _is_name(name)}),
            "no name of a track",
            lambda row: f"{states.names[row]!r} is none: 1 to {LONGEST_NAME} characters",
        ),
        (
            (stamps < EARLIEST_US) | (stamps >= LATEST_US),
            "stamp out of range",
            lambda row: f"{int(stamps[row])} us since 1970 is not within the years 1800 to 9998",
        ),
        (
            stamps > now_us + int(ahead_s * 1e6),
            "stamp in the future",
            lambda row: f"{_said(stamps[row])} is {(stamps[row] - now_us) / 1e6:.1f} s ahead of this clock",
        ),
    ]
    if behind_s is not None:
        flaws.append(
            (
                stamps < now_us - int(behind_s * 1e6),
                "stamp too old",
                lambda row: f"{_said(stamps[row])} is {(now_us - stamps[row]) / 1e6:.1f} s behind this clock",
            )
        )
    with np.errstate(invalid="ignore"):
        flaws += [
            _outside(states, name, *bounds)
            for name, bounds in BOUNDS.items()
            if name in states.values or bounds[2]
        ]
        if not states.values.keys().isdisjoint(("std_across_m", "std_yaw_rad")):
            flaws.append(_no_ellipse(states))
    flaws.append(_days(states))
    return flaws


def _rows_of(states: NamedStates, names: Set[str]) -> NDArray[np.bool_]:
    if not names:
        return np.zeros(len(states), dtype=np.bool_)
    return np.array([name in names for name in states.names], dtype=np.bool_)


BOUNDS: Mapping[str, tuple[float, float, bool]] = {
    "x_m": (-REACH_M, REACH_M, True),
    "y_m": (-REACH_M, REACH_M, True),
    "z_m": (-REACH_M, REACH_M, False),
    "std_m": (0.0, WIDEST_M, False),
    "heading_rad": (-7.0, 7.0, False),
    "speed_mps": (0.0, 1e4, False),
    "length_m": (1e-6, 1e4, False),
    "width_m": (1e-6, 1e4, False),
    "std_across_m": (0.0, WIDEST_M, False),
    "std_yaw_rad": (-7.0, 7.0, False),
}
"""The least and the most of each value, and whether each state needs it (`track_state` in the schema)."""


def _outside(states: NamedStates, name: str, least: float, most: float, is_needed: bool) -> Flaw:
    values = states.value(name)
    is_bad = (values < least) | (values > most)
    if is_needed:
        is_bad |= np.isnan(values)
    return is_bad, f"{name} out of range", lambda row: f"{name} {values[row]:g}"


def _no_ellipse(states: NamedStates) -> Flaw:
    std, across, yaw = (states.value(name) for name in ("std_m", "std_across_m", "std_yaw_rad"))
    is_round = np.isnan(across)
    is_one = np.where(
        is_round, np.isnan(yaw), (across.astype(np.float32) <= std.astype(np.float32)) & ~np.isnan(yaw)
    )
    return (
        ~is_one,
        "no error ellipse",
        lambda row: (
            f"std_m {std[row]:g}, std_across_m {across[row]:g}, std_yaw_rad {yaw[row]:g}: give all"
            " three, the second not above the first, or only std_m"
        ),
    )


def _days(states: NamedStates) -> Flaw:
    """Each day has tables of its own."""
    day = states.stamp_us // DAY_US
    days, first = np.unique(day, return_index=True)
    beyond = days[np.argsort(first)][MOST_DAYS:]
    return (
        np.isin(day, beyond),
        "too many days at once",
        lambda row: f"{_said(states.stamp_us[row])}: states of {MOST_DAYS} days are taken at a time",
    )


def _repeated(states: NamedStates) -> Flaw:
    """All but the first of a track at a stamp."""
    keys = list(zip(states.names, states.stamp_us.tolist(), strict=True))
    seen = set(keys)
    is_again = np.zeros(len(states), dtype=np.bool_)
    if len(seen) < len(keys):
        for row, key in enumerate(keys):
            is_again[row] = key not in seen
            seen.discard(key)
    return (
        is_again,
        REPEATED,
        lambda row: f"{states.names[row]} has another state at {_said(states.stamp_us[row])}",
    )


REPEATED = "repeated"


def _is_name(name: object) -> bool:
    if not isinstance(name, str) or not 0 < len(name) <= LONGEST_NAME or "\0" in name or not name.strip():
        return False
    try:
        name.encode()
    except UnicodeError:
        return False
    return True


def _said(stamp_us: np.int64) -> str:
    try:
        return to_datetime(int(stamp_us)).isoformat()
    except OverflowError:
        return f"{int(stamp_us)} us since 1970"
