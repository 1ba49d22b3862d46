import time
from threading import Event as Signal

import pytest
from semap_ingest.pipeline.pace import Pace


class Waited(Signal):
    """Notes for how long it was asked to wait, and does not."""

    def __init__(self):
        super().__init__()
        self.asked_s = []

    def wait(self, timeout=None):
        self.asked_s.append(timeout)
        return False


def test_records_are_due_as_they_were_sent():
    pace, stop = Pace(2.0), Waited()
    for sent_us in (10_000_000, 11_000_000, 14_000_000):
        pace.wait(sent_us, stop)
    assert stop.asked_s == [pytest.approx(0.5, abs=0.1), pytest.approx(2.0, abs=0.1)]
    assert pace.due_s(14_000_000) - pace.due_s(10_000_000) == pytest.approx(2.0)


def test_a_record_that_is_overdue_is_not_waited_for():
    pace, stop = Pace(1.0), Waited()
    pace.wait(10_000_000, stop)
    pace.wait(9_000_000, stop)
    assert stop.asked_s == []


def test_without_a_pace_everything_is_due_at_once():
    pace, stop = Pace(None), Waited()
    for sent_us in (0, 1_000_000_000):
        pace.wait(sent_us, stop)
        assert pace.due_s(sent_us) <= time.monotonic()
    assert stop.asked_s == []
