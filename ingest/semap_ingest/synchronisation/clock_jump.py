"""A single stamp from far ahead must not make everything after it late.

A record is in step if it is at most `max_jump_us` ahead of all that came before, of either source. One
that is not is held until a second one agrees with it: then event time has really gone on (a pause of the
recording, a clock that was set). If its own source goes on in step instead, it was a stray and is
refused.
"""

from __future__ import annotations

from semap_ingest.synchronisation.matching import Record


class ClockJumps:
    """Mutable: how far event time has come, and at most one record that seems to have leapt ahead."""

    def __init__(self, max_jump_us: int) -> None:
        self._max_jump_us = max_jump_us
        self._latest_us: int | None = None
        self._held: Record | None = None

    def pass_on(self, record: Record) -> tuple[list[Record], list[Record]]:
        """Records that are in step, in the order of their arrival or of their release, and those astray."""
        held = self._held
        if self._is_in_step(record):
            self._go_on(record)
            if held is None:
                return [record], []
            if held.side == record.side:
                self._held = None
                return [record], [held]
            if self._is_in_step(held):
                self._held = None
                self._go_on(held)
                return [record, held], []
            return [record], []
        if held is not None and abs(record.stamp_us - held.stamp_us) <= self._max_jump_us:
            self._held = None
            self._go_on(held)
            self._go_on(record)
            return [held, record], []
        self._held = record
        return [], [] if held is None else [held]

    def give_up(self) -> list[Record]:
        """The record that nothing has agreed with."""
        held, self._held = self._held, None
        return [] if held is None else [held]

    def _is_in_step(self, record: Record) -> bool:
        return self._latest_us is None or record.stamp_us <= self._latest_us + self._max_jump_us

    def _go_on(self, record: Record) -> None:
        self._latest_us = (
            record.stamp_us if self._latest_us is None else max(self._latest_us, record.stamp_us)
        )
