"""Released rows and timers of one map, given to its rules in the order of event time.

A moment is a stamp. In each, rule by rule in the order of the plan: first the rows that stand at it, in their
order, then the timers that are due at it. An event becomes at once a row for the rules that read it, at the
moment at which it was known. So what rules find, and in which order, depends on the rows alone, and not on
where a watermark cuts them.
"""

from __future__ import annotations

from collections.abc import Iterable
from heapq import heappop
from operator import attrgetter

from semap.model.event import Event
from semap.rules.engine.partition import Key
from semap.rules.engine.plan import Plan, plan_of
from semap.rules.engine.rule_run import Found, RuleRun, Timers
from semap.rules.engine.step import NEVER_US
from semap.rules.engine.waiting import order_of
from semap.rules.row import Row

stamp_and_id = attrgetter("stamp", "event_id")


class Flow:
    """Mutable; between two calls no row is left over, only timers.

    failed  rules that an unforeseen error has ended, with it; the others go on
    """

    def __init__(self) -> None:
        self.follow(plan_of((), {}))
        self.timers = Timers()
        self._queues: dict[int, list[Row]] = {}
        self._events: list[Event] = []
        self.failed: list[tuple[RuleRun, Exception]] = []

    def follow(self, plan: Plan[RuleRun]) -> None:
        """Give rows by this plan from now on."""
        self.plan = plan
        for place, run in enumerate(plan.runs):
            run.place = place

    def take(self, rows: Iterable[Row], until_us: int) -> list[Event]:
        """Take these rows, which are in order, and all that time brings up to `until_us`.

        Rows that stand after it are taken as well, but no time passes for them.
        """
        timers, queues, in_order = self.timers.heap, self._queues, self.plan.in_order
        in_moment = {source: found for source, found in self.plan.in_moment.items() if found}
        moment_us = NEVER_US
        for row in rows:
            stamp_us = row.stamp_us
            if stamp_us != moment_us:
                if queues or (timers and timers[0][0] < stamp_us):
                    self._end_moments(moment_us, stamp_us - 1)
                moment_us = stamp_us
            source, name = row.source, row.values["input"]
            for run in in_order[source].get(name, ()):  # type: ignore[call-overload]
                try:
                    found = run.take(row)
                    if found:
                        self._make(run, found, stamp_us)
                except Exception as error:  # whatever it is, it is this rule's alone
                    self._fail(run, error)
            if source in in_moment:
                for run in in_moment[source].get(name, ()):  # type: ignore[call-overload]
                    queues.setdefault(run.place, []).append(row)
        self._end_moments(moment_us, until_us)
        events, self._events = self._events, []
        return events

    def _fail(self, run: RuleRun, error: Exception) -> None:
        run.end()
        self.failed.append((run, error))

    def _make(self, run: RuleRun, found: Iterable[Found], known_us: int) -> None:
        """The events of what was found, for whom they concern."""
        readers = self.plan.of_events.get(run.rule.name, ())
        for key, match in found:
            event = run.maker.event(key, match)
            self._events.append(event)
            if readers:
                row = run.maker.row(event, match, known_us)
                for reader in readers:
                    self._queues.setdefault(reader.place, []).append(row)

    def _end_moments(self, moment_us: int, until_us: int) -> None:
        """End the moment that has rows, then all in which timers are due, up to `until_us`."""
        if self._queues:
            self._end_moment(moment_us, until_us)
        heap = self.timers.heap
        while heap and heap[0][0] <= until_us:
            timer_us, _, run, key = heap[0]
            if run.is_due(key, timer_us, timer_us):
                self._end_moment(max(timer_us, moment_us), until_us)
            else:
                heappop(heap)

    def _end_moment(self, moment_us: int, until_us: int) -> None:
        timers_us = min(moment_us, until_us)
        heap, queues = self.timers.heap, self._queues
        runs = self.plan.runs
        due: dict[int, list[tuple[Key, int]]] = {}
        while True:
            while heap and heap[0][0] <= timers_us:
                timer_us, _, run, key = heappop(heap)
                is_at_work = run.place < len(runs) and runs[run.place] is run
                # most timers have been overtaken, and ordering them by key costs more than looking
                if is_at_work and run.is_due(key, timer_us, moment_us):
                    due.setdefault(run.place, []).append((key, timer_us))
            if not queues and not due:
                return
            place = min((*queues, *due))
            run = runs[place]
            timers = due.pop(place, [])
            try:
                for row in sorted(queues.pop(place, ()), key=order_of):
                    self._make(run, run.take(row), moment_us)
                made = len(self._events)
                for key, timer_us in timers:
                    self._make(run, run.fire(key, timer_us, moment_us), moment_us)
                # timers come off the heap in the order in which they were set
                self._events[made:] = sorted(self._events[made:], key=stamp_and_id)
            except Exception as error:
                self._fail(run, error)
