"""When an event is tried again, by a clock and a chance that are given."""

from datetime import UTC, datetime
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from semap_service.webhooks.retry import Retry, asked_wait_s

RETRY = Retry(attempts=6, first_s=1, longest_s=10)
NOW = datetime(2026, 1, 31, 12, tzinfo=UTC)


def test_waits_double_up_to_the_longest() -> None:
    assert [RETRY.wait_s(tried, 0, None, 1) for tried in range(1, 7)] == [1, 2, 4, 8, 10, None]
    assert [RETRY.wait_s(tried, 0, None, 0) for tried in range(1, 7)] == [0.5, 1, 2, 4, 5, None]


@given(st.floats(0, 1, exclude_max=True), st.integers(1, 1000), st.none() | st.floats(0, 1e9))
def test_waits_are_within_their_bounds(chance: float, attempts: int, asked_s: float | None) -> None:
    retry = Retry(attempts=attempts, first_s=0.5, longest_s=60)
    waits = [retry.wait_s(tried, 0, asked_s, chance) for tried in range(1, attempts)]
    assert all(wait is not None and 0.25 <= wait <= 60 for wait in waits)
    assert all(a <= b for a, b in pairwise(waits))
    assert all(wait >= min(asked_s or 0, 60) for wait in waits)
    assert retry.wait_s(attempts, 0, asked_s, chance) is None


def test_what_comes_after_an_event_that_was_given_up_is_tried_once() -> None:
    assert RETRY.wait_s(1, 1, None, 0.5) is None
    assert RETRY.wait_s(1, 7, 5, 0.5) is None


@pytest.mark.parametrize(
    ("header", "wait_s"),
    [
        (None, None),
        ("120", 120),
        (" 7 ", 7),
        ("Sat, 31 Jan 2026 12:00:30 GMT", 30),
        ("Sat, 31 Jan 2026 11:00:00 GMT", 0),
        ("soon", None),
        ("-5", None),
        ("", None),
        ("9" * 5000, 999_999_999),
        ("Sat, 31 Jan 2026 12:00:30", 30),
        ("٣", None),
        ("Sat, 31 Jan 99999999999999999999 12:00:30 GMT", None),
        ("Sat, 31 Jan 2026 12:00:30 +99999999999999999", None),
    ],
)
def test_what_a_receiver_asks_for(header: str | None, wait_s: float | None) -> None:
    assert asked_wait_s(header, NOW) == wait_s
