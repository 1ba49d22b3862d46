"""Event time: aware UTC at the surface, whole microseconds since 1970 inside.

A microsecond is what PostgreSQL keeps, so that a stamp survives the way through the database.
"""

from __future__ import annotations

from datetime import UTC, date, datetime, timedelta, tzinfo

from semap.errors import InvalidInput

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
EARLIEST = datetime(1800, 1, 1, tzinfo=UTC)
LATEST = datetime(9999, 1, 1, tzinfo=UTC)
"""Between these lies what is stored."""
DAY_US = 86_400_000_000
MICROSECOND = timedelta(microseconds=1)


class NoOffset(InvalidInput):
    """A stamp that does not say its zone."""


def parse_stamp(text: str, zone: tzinfo | None = None) -> int:
    """Microseconds since 1970 of an ISO 8601 stamp.

    zone    of a stamp without an offset; None: it must have one
    raises  NoOffset; InvalidInput for anything else, and for a stamp that the zone skips or has twice
    """
    try:
        stamp = datetime.fromisoformat(text.strip())
    except ValueError as error:
        raise InvalidInput(
            f"{text!r} is not an ISO 8601 stamp",
            "Write stamps as 2026-01-31T12:00:00Z, or name the unit of a number: --stamp-unit s, ms, us, ns.",
        ) from error
    if stamp.tzinfo is None and zone is not None:
        stamp = stamp.replace(tzinfo=zone)
        if stamp.utcoffset() != stamp.replace(fold=1).utcoffset():
            raise InvalidInput(
                f"{text!r} is not one moment in {zone}, where clocks change then", "Write it with its offset."
            )
    if stamp.tzinfo is None:
        raise NoOffset(
            f"the stamp {text!r} has no offset from UTC", "Append Z, or the offset such as +01:00."
        )
    return to_us(stamp)


def require_usual(stamp: datetime, where: str) -> datetime:
    """raises InvalidInput for a stamp that cannot be stored"""
    if not EARLIEST <= stamp <= LATEST:
        raise InvalidInput(f"the stamp {stamp.isoformat()}", "Give one from 1800 to 9998.", where)
    return stamp


def to_us(stamp: datetime) -> int:
    """Microseconds since 1970 of an aware stamp."""
    return (stamp - EPOCH) // MICROSECOND


def to_datetime(stamp_us: int) -> datetime:
    """Aware UTC."""
    return EPOCH + timedelta(0, 0, stamp_us)  # by place: twice as fast as by name


def rfc3339(stamp: datetime) -> str:
    """An aware stamp in UTC with microseconds."""
    return stamp.astimezone(UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")


def day_of(stamp_us: int) -> date:
    """The day in UTC."""
    return to_datetime(stamp_us).date()
