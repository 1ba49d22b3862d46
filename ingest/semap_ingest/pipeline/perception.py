"""From records of any number of sensors to persons on the map and lines in it.

`take` is given the records of all sensors in the order in which they were sent, and gives what follows from
each: a person's state as soon as no sensor can tell anything older, lines as soon as it is known where the
laser stood. It has no clock and does no I/O: the same records give the same results at any pace.

What a record goes through:
    its sensor's feeder     find boxes, legs, lines (`feeder`)
    transforms              wait until it is known where the sensor stood
    moments                 pair camera and laser, merge all by event time (`moments`)
    tracks                  correct them, sensor by sensor (`MapTracker`)
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from semap.errors import InvalidInput
from semap_ingest.frames.localisation import Localisation
from semap_ingest.frames.transform_buffer import Missing, TransformBuffer
from semap_ingest.frames.waiting import PATIENCE_US as TRANSFORM_PATIENCE_US
from semap_ingest.frames.waiting import GivenUp, Ready, WaitingRecords
from semap_ingest.laser.sweep import straightened
from semap_ingest.lines.segments import transform_lines
from semap_ingest.pipeline.calibrations import Calibrations
from semap_ingest.pipeline.feeder import Feeder, Looked, Placed, ScanFound
from semap_ingest.pipeline.found import Found, LinesAt, PersonsAt
from semap_ingest.pipeline.given import FARTHEST_M
from semap_ingest.pipeline.measuring import Measuring
from semap_ingest.pipeline.meter import Meter, no_meter
from semap_ingest.pipeline.moments import Look, Moments
from semap_ingest.pipeline.sensor import READS, Seen, Sensor, check
from semap_ingest.pipeline.stamp_order import MAX_JUMP_US, StampOrder
from semap_ingest.recording.reading import Received
from semap_ingest.sensing.detections import Detections, no_look
from semap_ingest.sensing.image import Camera
from semap_ingest.sensing.scan import Scan
from semap_ingest.sensing.track_states import TrackStates
from semap_ingest.sensing.transform import Transform
from semap_ingest.synchronisation.event_time_merge import EventTimeMerge, Moment, Pace
from semap_ingest.synchronisation.synchroniser import NEVER_US
from semap_ingest.tracking.map_tracker import MapTracker, MapTrackerSettings

PLACED_STD_M = 0.4
"""Of a person's position, along the worst axis, up to which its state is told."""


class Perception:
    """Mutable: transforms, what waits, and the tracks.

    taken     records that were given to it
    placed    those of sensors of which it became known where they were seen from
    frames    that transforms have named
    map_frame the one that is the map's
    feeders   one for each sensor, by its topic
    reasons   why it did not become known where sensors stood
    """

    def __init__(
        self,
        sensors: Sequence[Sensor],
        map_frame: str = "map",
        floor_z_m: float = 0.0,
        *,
        fixed: Iterable[Transform] = (),
        localised_by: str | None = None,
        transform_patience_us: int | None = TRANSFORM_PATIENCE_US,
        tracking: MapTrackerSettings | None = None,
        meter: Meter = no_meter,
    ) -> None:
        """fixed: transforms that hold whatever records say of those frames.

        localised_by  topic of transforms that say where the robot is in the map (`Localisation`)
        transform_patience_us  how long records wait for their transform; None: for a file (`WaitingRecords`)
        raises  InvalidInput for sensors that cannot be told apart, and for transforms that are none
        """
        check(sensors)
        self.taken = self.placed = 0
        self.reasons: dict[tuple[str, str, Missing], str] = {}
        self.map_frame, self._meter = map_frame, meter
        self._calibrations = Calibrations()
        partners = {each.partner for each in sensors}
        self.feeders = {
            each.topic: Feeder(each, number, self._calibrations, meter, is_alone=each.name not in partners)
            for number, each in enumerate(sensors)
        }
        self._order = StampOrder(max([MAX_JUMP_US, *(3 * each.period_us for each in sensors)]))
        self._transforms = TransformBuffer()
        self._localisation, self._localised_by = Localisation(self._transforms, map_frame), localised_by
        self._fixed = {each.child for each in fixed}
        self.frames: set[str] = set()
        for each in fixed:
            self._place(each)
        self._waiting: WaitingRecords[Looked] = WaitingRecords(
            self._transforms, map_frame, transform_patience_us
        )
        self._moments = Moments(sensors)
        self._feeder_of = {each.sensor.name: each for each in self.feeders.values()}
        self._measuring = Measuring(
            self._feeder_of,
            self._calibrations,
            map_frame,
            floor_z_m,
        )
        self._lines = EventTimeMerge[LinesAt](
            {s.name: Pace(s.period_us, s.patience_us) for s in sensors if s.kind == "laser"}
        )
        self._has_laser = any(each.kind == "laser" for each in sensors)
        self._tells_persons = any(each.tells_persons for each in sensors)
        self._map_tracker = MapTracker(tracking, max(1, len(sensors)))
        self._told: set[int] = set()
        self._newest_us = NEVER_US
        self._left_out: Counter[str] = Counter()

    @property
    def left_out(self) -> Mapping[str, int]:
        """Records, or parts of them, that could not be used: why, and how many."""
        by_sensor = {
            f"{feeder.sensor.name}: {why}": count
            for feeder in self.feeders.values()
            for why, count in feeder.left_out.items()
        }
        late = {f"{name}: its lines came too late": count for name, count in self._lines.refused.items()}
        return {**self._left_out, **by_sensor, **self._order.refused, **self._moments.refused, **late}

    @property
    def given_up(self) -> int:
        """Records of which it did not become known where they were seen from."""
        return sum(self._waiting.given_up.values())

    def take(self, received: Received) -> Found:
        """What follows from this record."""
        self.taken += 1
        value, feeder = received.value, self.feeders.get(received.topic)
        if isinstance(value, Transform):
            with self._forgiving(received.topic), self._meter("transforms"):
                if received.topic == self._localised_by:
                    self._localisation.tell(value)
                else:
                    self.learn(value)
        elif isinstance(value, Camera):
            self._calibrations.learn(received.topic, value)
        elif feeder is not None and isinstance(value, Seen) and isinstance(value, READS[feeder.sensor.kind]):
            feeder.given += 1
            for each, seen in self._order.pass_on(received, _at_home(value, feeder.sensor)):
                self._look_at(self.feeders[each.topic], seen, each.sent_us)
        with self._meter("transforms"):
            self._learn_all(self._localisation.take())
            placed = self._waiting.take()
        return self._go_on(placed)

    def come_to(self, stamp_us: int) -> Found:
        """What follows from the clock having come so far, for cameras that speak now and then only.

        Nothing is waited for any more that is older by more than the patience of its sensor; tracks of whom
        nothing was told for long end.
        """
        persons = self._persons_at(self._moments.come_to(stamp_us))
        mark_us = self._moments.watermark_us
        with self._meter("track on map"):
            states = self._map_tracker.step(no_look(mark_us, self.map_frame))
        if states.ended or states.amendments:
            persons.append(PersonsAt(self._told_only(states), stamp_us))
        self._newest_us = max(self._newest_us, mark_us)
        return Found(tuple(persons), (), _known(mark_us), _known(mark_us))

    def flush(self) -> Found:
        """What follows from there being no more records: all that waits, and every track ends."""
        self._order.give_up()
        self._learn_all(self._localisation.finish(self._waiting.newest_us))
        found = self._go_on(self._waiting.flush())
        if self._newest_us == NEVER_US:
            return Found()
        persons = [*found.persons, *self._persons_at(self._moments.flush())]
        lines = [*found.lines, *_items(self._lines.flush())]
        # after all that was told to be past, so that it is not past itself
        over_us = 1 + max(self._newest_us, self._moments.watermark_us, self._lines.watermark_us)
        sent_us = persons[-1].sent_us if persons else over_us
        last = replace(self._told_only(self._map_tracker.finish()), stamp_us=over_us)
        return Found((*persons, PersonsAt(last, sent_us)), tuple(lines), over_us, over_us)

    def learn(self, transform: Transform) -> None:
        """Where a frame is, if nothing fixed says it.

        raises  InvalidInput for a transform that is none
        """
        if transform.child not in self._fixed:
            self._place(transform)

    def _learn_all(self, transforms: Iterable[Transform]) -> None:
        for each in transforms:
            with self._forgiving(self._localised_by or ""):
                self.learn(each)

    def _place(self, transform: Transform) -> None:
        self._transforms.add(transform)
        self.frames |= {transform.parent, transform.child}

    @contextmanager
    def _forgiving(self, source: str) -> Iterator[None]:
        """What a role cannot use is left out and counted."""
        try:
            yield
        except InvalidInput as error:
            self._left_out[f"{source}: {str(error).removeprefix(f'{error.where}: ')}"] += 1

    def _look_at(self, feeder: Feeder, seen: Seen, sent_us: int) -> None:
        with self._forgiving(feeder.sensor.name):
            looked = feeder.look(seen, sent_us)
            if looked is not None:
                self._waiting.put(feeder.sensor.name, looked)

    def _go_on(self, placed: Sequence[Ready[Looked] | GivenUp[Looked]]) -> Found:
        """What follows from knowing where sensors stood."""
        persons: list[PersonsAt] = []
        lines: list[LinesAt] = []
        for each in placed:
            if isinstance(each, GivenUp):
                self._left_out[f"{each.source}: {self._why_given_up(each)}"] += 1
                continue
            self.placed += 1
            if np.abs(each.target_T_frame[:3, 3]).max() > FARTHEST_M:
                self._left_out[f"{each.source}: seen from outside of any map"] += 1
                continue
            self._newest_us = max(self._newest_us, each.record.stamp_us)
            with self._forgiving(each.source):
                seen = self._straightened(each)
                lines += self._lines_from(seen)
                if seen.record.sensor.tells_persons:
                    with self._meter("synchronise"):
                        moments = self._moments.add(
                            Placed(seen.record, seen.target_T_frame), self._waiting.held_us
                        )
                    persons += self._persons_at(moments)
        persons_us, lines_us = self._moments.watermark_us, self._lines.watermark_us
        return Found(
            tuple(persons),
            tuple(lines),
            _known(persons_us if self._tells_persons else lines_us),
            _known(lines_us if self._has_laser else persons_us),
        )

    def _why_given_up(self, each: GivenUp[Any]) -> str:
        """As it was the first time."""
        record = each.record
        known = (each.source, record.frame, each.why)
        if known not in self.reasons:
            self.reasons[known] = self._transforms.why_missing(self.map_frame, record.frame, record.stamp_us)
        return f"where it was seen from is not known: {self.reasons[known]}"

    def _straightened(self, each: Ready[Looked]) -> Ready[Looked]:
        """With what is in a sweep, if it was not looked for before it was known how the laser moved."""
        scan, last = each.record.found, each.target_T_last
        if not isinstance(scan, Scan):
            return each
        if last is not None:
            scan = straightened(scan, np.linalg.inv(each.target_T_frame) @ last)
        found = self._feeder_of[each.source].found_in_scan(scan)
        return replace(each, record=replace(each.record, found=found))

    def _lines_from(self, each: Ready[Looked]) -> list[LinesAt]:
        """Those of all lasers that are in order now."""
        looked, found = each.record, each.record.found
        if isinstance(found, ScanFound):
            in_map = transform_lines(found.lines, each.target_T_frame, self.map_frame)
            at = LinesAt(in_map, float(each.target_T_frame[2, 3]), looked.sent_us)
            self._lines.add(each.source, looked.stamp_us, at)
            held_us = self._waiting.held_us
            self._lines.come_to(looked.stamp_us if held_us is None else min(looked.stamp_us, held_us))
        return _items(self._lines.take())

    def _persons_at(self, moments: Iterable[Moment[Look]]) -> list[PersonsAt]:
        """The states of persons at each moment, corrected by one look after the other."""
        told = []
        for moment in moments:
            looks: list[Detections | None] = []
            for look in moment.items:
                with self._forgiving("fusion"), self._meter("fuse"):
                    looks.append(self._measuring.detections(look, self._map_tracker.believed_m))
            told_of = [each for each in looks if each is not None]
            if told_of:
                with self._meter("track on map"):
                    states = self._map_tracker.step(*told_of)
                sent_us = max(look.sent_us for look in moment.items)
                told.append(PersonsAt(self._told_only(placed_well(states)), sent_us))
        return told

    def _told_only(self, states: TrackStates) -> TrackStates:
        """Without the ends of tracks that nobody was told of."""
        self._told.update(states.track.tolist())
        self._told.update(track for one in states.amendments for track in (one.track, one.other))
        ended = tuple(one for one in states.ended if one[0] in self._told)
        self._told.difference_update(track for track, _ in ended)
        return states if ended == states.ended else replace(states, ended=ended)


def _at_home(seen: Seen, sensor: Sensor) -> Seen:
    """The record with the sensor's own frame and clock."""
    if sensor.frame is None and not sensor.offset_us:
        return seen
    return replace(seen, frame=sensor.frame or seen.frame, stamp_us=seen.stamp_us + sensor.offset_us)


def _items(moments: Iterable[Moment[LinesAt]]) -> list[LinesAt]:
    return [item for moment in moments for item in moment.items]


def _known(mark_us: int) -> int | None:
    return None if mark_us <= NEVER_US else mark_us


def placed_well(states: TrackStates) -> TrackStates:
    """Those whose place is known well enough to say in which room they are."""
    std_m = np.sqrt(np.linalg.eigvalsh(states.covariance_m2)[:, -1]) if len(states) else np.zeros(0)
    kept = np.flatnonzero(std_m <= PLACED_STD_M)
    return replace(
        states,
        track=states.track[kept],
        position_m=states.position_m[kept],
        velocity_mps=states.velocity_mps[kept],
        covariance_m2=states.covariance_m2[kept],
        extent_m=states.extent_m[kept],
        heading_rad=states.heading_rad[kept],
    )
