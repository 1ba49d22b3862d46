"""What every message says first: when, and in which frame."""

from __future__ import annotations

from typing import Any

from semap_ingest.recording.passed_over import Unusable, Why

NANOSECONDS_PER_S = 1_000_000_000


def stamp_us(stamp: Any, log_us: int) -> int:
    """Event time [us since 1970] of a builtin_interfaces/Time, rounded down; the log's where it is zero.

    raises  Unusable for one before 1970, or with nanoseconds of a second or more
    """
    seconds, nanoseconds = stamp.sec, stamp.nanosec
    if seconds == 0 and nanoseconds == 0:
        return log_us
    if seconds < 0 or not 0 <= nanoseconds < NANOSECONDS_PER_S:
        raise Unusable(f"the stamp {seconds} s {nanoseconds} ns", Why.BAD_STAMP)
    return int(seconds) * 1_000_000 + int(nanoseconds) // 1000


def logged_us(log_ns: int) -> int:
    """When the recorder wrote a message down [us since 1970], rounded down.

    raises  Unusable for one before 1970; in nanoseconds of 64 bits all others are before the year 2555
    """
    if log_ns < 0:
        raise Unusable(f"the time of the log {log_ns} ns", Why.BAD_STAMP)
    return log_ns // 1000


def frame_name(name: str) -> str:
    """tf's older versions wrote frames with a leading slash."""
    return name.lstrip("/")
