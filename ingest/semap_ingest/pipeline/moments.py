"""Which records are of one moment: a camera and its laser paired, and all sensors in one order of event time.

A camera that has a laser for a partner is paired with it (`Synchroniser`), since boxes and legs of one moment
are better fused together than one after the other. Each pair, and each sensor by itself, is a source of
looks; the looks of all sources are merged behind a watermark for each (`EventTimeMerge`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from semap_ingest.pipeline.feeder import Placed
from semap_ingest.pipeline.sensor import TOLERANCE_US, Sensor
from semap_ingest.synchronisation.event_time_merge import EventTimeMerge, Moment, Pace
from semap_ingest.synchronisation.synchroniser import (
    NEVER_US,
    AloneA,
    AloneB,
    Matched,
    Output,
    SourceTiming,
    Synchroniser,
)


@dataclass(frozen=True, eq=False)
class Look:
    """What one sensor saw, or a camera and its laser together; the other is None.

    eye  a camera or a finder
    """

    stamp_us: int
    eye: Placed | None
    laser: Placed | None

    @property
    def sent_us(self) -> int:
        return max(each.looked.sent_us for each in (self.eye, self.laser) if each is not None)


class _Pair:
    """Mutable: a camera and its laser."""

    def __init__(self, camera: Sensor, laser: Sensor) -> None:
        self.name = laser.name
        self.patience_us = max(camera.patience_us, laser.patience_us)
        self.synchroniser = Synchroniser[Placed, Placed](
            # no period matters that is longer than the other source's patience
            SourceTiming(min(camera.period_us, self.patience_us)),
            SourceTiming(min(laser.period_us, self.patience_us)),
            TOLERANCE_US,
            self.patience_us,
            max(10_000_000, 2 * self.patience_us),
        )
        self._scanned_us = NEVER_US

    def add(self, placed: Placed) -> list[Look]:
        stamp_us = placed.looked.stamp_us
        if placed.looked.sensor.kind == "camera":
            return self._looks(self.synchroniser.add_a(stamp_us, placed))
        self._scanned_us = max(self._scanned_us, stamp_us)
        return self._looks(self.synchroniser.add_b(stamp_us, placed))

    def pass_to(self, stamp_us: int) -> list[Look]:
        """What is final now that neither sends anything before this stamp any more."""
        return self._looks(self.synchroniser.pass_to(stamp_us))

    def flush(self) -> list[Look]:
        return self._looks(self.synchroniser.flush())

    def _looks(self, final: Iterable[Output[Placed, Placed]]) -> list[Look]:
        """At the scan's moment where there is one.

        An image without a scan tells of the map only while the laser is silent: else its moment is between
        two that both sensors saw.
        """
        looks = []
        for each in final:
            match each:
                case Matched():
                    looks.append(Look(each.b_us, each.a, each.b))
                case AloneB():
                    looks.append(Look(each.stamp_us, None, each.item))
                case AloneA() if each.stamp_us >= self._scanned_us + 2 * TOLERANCE_US:
                    looks.append(Look(each.stamp_us, each.item, None))
        return looks


class Moments:
    """Mutable: what waits for its partner, or for older records of other sensors.

    newest_us  the newest stamp that was added
    """

    def __init__(self, sensors: Sequence[Sensor]) -> None:
        self.newest_us = NEVER_US
        named = {each.name: each for each in sensors}
        self._pair_of: dict[str, _Pair] = {}
        for each in sensors:
            if each.partner is not None:
                pair = _Pair(each, named[each.partner])
                self._pair_of[each.name] = self._pair_of[each.partner] = pair
        self._pairs = list(dict.fromkeys(self._pair_of.values()))
        self._merge = EventTimeMerge[Look](
            {
                each.name: Pace(each.period_us, each.patience_us)
                for each in sensors
                if each.tells_persons and each.name not in self._pair_of
            }
            | {pair.name: Pace(0, pair.patience_us) for pair in self._pairs}
        )

    @property
    def watermark_us(self) -> int:
        """No moment at or before it comes any more."""
        return self._merge.watermark_us

    @property
    def refused(self) -> Mapping[str, int]:
        """How many records came too late, by sensor and reason."""
        late = {f"{name}: it came too late": count for name, count in self._merge.refused.items()}
        for pair in self._pairs:
            for reason, count in pair.synchroniser.refused.items():
                key = f"{pair.name} and its camera: {reason} for synchronisation"
                late[key] = late.get(key, 0) + count
        return late

    def add(self, placed: Placed, held_us: int | None = None) -> list[Moment[Look]]:
        """The moments that are complete now.

        held_us  the stamp of the oldest record that waits for a transform to come: it is not late
        """
        sensor, stamp_us = placed.looked.sensor, placed.looked.stamp_us
        pair = self._pair_of.get(sensor.name)
        if pair is not None:
            self._put(pair.name, pair.add(placed))
        elif sensor.kind == "laser":
            self._put(sensor.name, [Look(stamp_us, None, placed)])
        else:
            self._put(sensor.name, [Look(stamp_us, placed, None)])
        self.newest_us = max(self.newest_us, stamp_us)
        come_us = self.newest_us if held_us is None else min(self.newest_us, held_us)
        for each in self._pairs:
            self._put(each.name, each.pass_to(come_us - each.patience_us))
            self._merge.reach(each.name, each.synchroniser.watermark_us + 1)
        self._merge.come_to(come_us)
        return self._merge.take()

    def come_to(self, stamp_us: int) -> list[Moment[Look]]:
        """The moments that are complete when the clock has come to this stamp, though nothing came."""
        self._merge.come_to(stamp_us)
        return self._merge.take()

    def flush(self) -> list[Moment[Look]]:
        """All that waits."""
        for pair in self._pairs:
            self._put(pair.name, pair.flush())
        return self._merge.flush()

    def _put(self, source: str, looks: Iterable[Look]) -> None:
        for look in looks:
            self._merge.add(source, look.stamp_us, look)
