"""Durations: `6 s`, `500 ms`, `1.5 h`, or a bare number of seconds; whole microseconds inside."""

from __future__ import annotations

import re
from collections.abc import Mapping
from decimal import Decimal

from semap.errors import InvalidInput

UNITS_US: Mapping[str, int] = {
    "us": 1,
    "ms": 1_000,
    "s": 1_000_000,
    "min": 60_000_000,
    "h": 3_600_000_000,
    "d": 86_400_000_000,
}
TEXT = re.compile(r"\s*(?P<number>[0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*(?P<unit>[a-z]*)\s*\Z")
LONGEST_US = 36_525 * UNITS_US["d"]
"""A hundred years."""

LONGEST_TEXT = 40
REMEDY = f"Write a number and a unit ({', '.join(UNITS_US)}), such as 6 s, or a number of seconds."


def read_duration(value: object, where: str, least_us: int = 1) -> int:
    """Microseconds of a text such as `6 s`, or of a number of seconds.

    raises  InvalidInput with the place, also for one shorter than `least_us` or of parts of a microsecond
    """
    source = str(value) if isinstance(value, int | float | str) and not isinstance(value, bool) else ""
    exponent = isinstance(value, float) and "e" in source
    match = (
        TEXT.match(f"{Decimal(source):f}" if exponent else source) if len(source) <= LONGEST_TEXT else None
    )
    if match is None or (match["unit"] or "s") not in UNITS_US:
        raise InvalidInput(f"{str(value)[:LONGEST_TEXT]!r} is no duration", REMEDY, where)
    exact_us = Decimal(match["number"]) * UNITS_US[match["unit"] or "s"]
    if exact_us != exact_us.to_integral_value():
        raise InvalidInput("parts of a microsecond", "Stamps are whole microseconds; round it.", where)
    if not least_us <= exact_us <= LONGEST_US:
        raise InvalidInput(
            f"{source.strip()} is {'too short' if exact_us < least_us else 'more than a hundred years'}",
            "Give a duration above zero." if exact_us < least_us else "Leave it out for no bound.",
            where,
        )
    return int(exact_us)


def write_duration(duration_us: int) -> str:
    """The shortest text that `read_duration` takes for this."""
    unit = max(
        (name for name, unit_us in UNITS_US.items() if duration_us % unit_us == 0 and duration_us),
        key=UNITS_US.__getitem__,
        default="s",
    )
    return f"{duration_us // UNITS_US[unit]} {unit}"
