"""When an event that was not taken is tried again, and when it is given up. No clock, no chance of its own.

An event is tried `attempts` times, ever less often, then set aside, and the next one has its turn. Until
the receiver takes one, each further event is tried once only: a receiver that is gone holds up what comes
after by the tries of one event, and not by those of each.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime


@dataclass(frozen=True)
class Retry:
    """How often, and how long to wait in between.

    first_s      before the second try, at most; doubled for each that follows
    longest_s    the most that is waited, whatever the receiver asks for
    """

    attempts: int = 10
    first_s: float = 1.0
    longest_s: float = 900.0

    def wait_s(self, tried: int, given_up_in_row: int, asked_s: float | None, chance: float) -> float | None:
        """How long to wait before the next try; None: give up.

        tried            how often, this time included
        given_up_in_row  events that were given up since the receiver took one
        asked_s          what the receiver asked for
        chance           in [0, 1): spreads the tries of many over the second half of each wait
        """
        if tried >= self.attempts or given_up_in_row > 0:
            return None
        most_s = min(self.first_s * 2.0 ** (tried - 1), self.longest_s)
        return min(max(most_s * (0.5 + chance / 2), asked_s or 0.0), self.longest_s)


def asked_wait_s(header: str | None, now: datetime) -> float | None:
    """What Retry-After asks for (RFC 9110, 10.2.3); None where it says nothing that can be read."""
    if header is None:
        return None
    text = header.strip()
    if text.isascii() and text.isdigit():
        return float(text[:9])
    try:
        due = parsedate_to_datetime(text)
    except (ValueError, OverflowError):
        return None
    due = due if due.tzinfo is not None else due.replace(tzinfo=UTC)
    return max((due - now).total_seconds(), 0.0)
