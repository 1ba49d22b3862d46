"""What a robot's sensors say, perceived as it comes.

One thread hears, so that nothing is lost while another one perceives; what perception makes of it goes to
the bridge's loop. The pipeline is that of recordings, so that a recording that is played gives what its file
gives. Where a robot's clock is set back, or a sensor comes that was not there, perception begins anew, with
new tracks.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from threading import Event as Signal
from threading import Thread
from typing import Any

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from semap_ingest.named_states import Refused
from semap_ingest.pipeline.ingest_recording import perception_of
from semap_ingest.pipeline.perception import Perception
from semap_ingest.pipeline.proposal import rig_of
from semap_ingest.pipeline.registration import persons_source
from semap_ingest.pipeline.rig_sensors import sensors_of, timed
from semap_ingest.pipeline.sensor import Seen
from semap_ingest.pipeline.survey import UNKNOWN, timing_of
from semap_ingest.recording.decoding import Value, pose_of_frame, reader_of
from semap_ingest.recording.definitions import deserialiser
from semap_ingest.recording.passed_over import Flaw, Unusable
from semap_ingest.recording.reading import Received
from semap_ingest.sensing.transform import Transform

from semap.errors import InvalidInput
from semap.store.motion.bridges import Position
from semap.timeline.stamp import to_us
from semap_bridge.adapter import Batch, Source
from semap_bridge.adapters.ros.backlog import Backlog
from semap_bridge.adapters.ros.casting import Casting
from semap_bridge.adapters.ros.robot import Robot
from semap_bridge.adapters.ros.settings import RosSettings
from semap_bridge.context import Context
from semap_bridge.finds import FindBatches, open_tracks
from semap_bridge.ros.graph import Graph, Heard

log = logging.getLogger(__name__)

LOOK_S = 0.5
"""So often topics are looked for."""
WAIT_S = 0.1
SETTLE_S = 1.0
"""So long no new topic comes before parts are given."""
SURVEY_S = 1.0
"""So long all of several sensors are listened to before it is taken for granted how often they speak."""
MOST_SURVEYED = 1000
SILENT_S = 5.0
BACK_US = 1_000_000
BACK_RECORDS = 5
"""A clock was set back where so many records in a row are so far behind the newest."""
SENSORS = "its sensors"
ROBOT = "the robot itself"
"""A frame of its own where not tf but a topic says where the robot is."""

Item = Sequence[Batch] | BaseException


class Senses(Source):
    """Mutable: what is heard, and what was made of it; a source for one connection."""

    def __init__(self, settings: RosSettings, context: Context, graph: Graph) -> None:
        self._settings, self._context, self._graph = settings, context, graph
        self.casting = Casting(
            settings.topics, settings.image_model is not None, settings.robot_pose, settings.robot
        )
        self._counts: Counter[str] = Counter()
        self._first_s: dict[str, float] = {}
        self._last_s: dict[str, float] = {}
        self.perception: Perception | None = None
        self._backlog = Backlog()
        self._told: set[str] = set()
        self._begin_anew = Signal()
        self._stop = Signal()
        self._threads: list[Thread] = []
        self._later: Callable[[Callable[[], object]], object] = lambda change: None

    def rate_hz(self, topic: str) -> float:
        """How often something came since the first time; 0 where nothing did."""
        span_s = self._last_s.get(topic, 0.0) - self._first_s.get(topic, 0.0)
        return (self._counts[topic] - 1) / span_s if span_s > 0 else 0.0

    def is_heard(self, topic: str) -> bool:
        return self._counts[topic] > 0

    def stop(self) -> None:
        """Leave the graph to others; returns when its threads are done."""
        self._stop.set()
        for each in self._threads:
            each.join()

    async def batches(self, position: Position | None) -> AsyncIterator[Batch]:
        came: asyncio.Queue[Item] = asyncio.Queue()
        loop = asyncio.get_running_loop()

        def give(item: Item) -> None:
            loop.call_soon_threadsafe(came.put_nowait, item)

        left = await self._context.ask(lambda c: open_tracks(c, self._context.map_name, self._context.source))
        if left:
            yield Batch(ended=left, source=persons_source(self._context.source))
        self._later = loop.call_soon_threadsafe  # figures are read by the loop
        self._threads = [
            Thread(target=self._guarded, args=(work, give), name=f"ros {work.__name__}")
            for work in (self._hear, self._perceive)
        ]
        for each in self._threads:
            each.start()
        try:
            while True:
                item = await came.get()
                if isinstance(item, BaseException):
                    raise item
                for batch in item:
                    yield batch
        finally:
            await asyncio.to_thread(self.stop)
            self._context.figures.troubles.pop(SENSORS, None)

    def _guarded(self, work: Callable[[Callable[[Item], None]], None], give: Callable[[Item], None]) -> None:
        try:
            work(give)
        except BaseException as error:
            give(error)

    def _hear(self, give: Callable[[Item], None]) -> None:
        look_at_s = settled_s = 0.0
        dropped = counted = 0
        topics: set[str] = set()
        while not self._stop.is_set():
            now_s = time.monotonic()
            if now_s >= look_at_s:
                look_at_s = now_s + LOOK_S
                offers = self._graph.offers()
                seen = {each.topic for each in offers}
                if not seen <= topics:
                    topics |= seen
                    settled_s = now_s + SETTLE_S
                if now_s >= settled_s and self.casting.look(offers):
                    self._say_parts()
                    self._begin_anew.set()
                self._graph.hear(self.casting.wanted())
                self._tell_several(self.casting.several(offers))
                self._tell_trouble(now_s)
            for heard in self._graph.take(WAIT_S):
                self._counts[heard.topic] += 1
                self._last_s[heard.topic] = time.monotonic()
                self._first_s.setdefault(heard.topic, self._last_s[heard.topic])
                dropped += self._backlog.put(heard)
            if (lost := dropped + self._graph.lost) > counted:
                self._later(partial(self._context.drop, lost - counted))
                counted = lost

    def _perceive(self, give: Callable[[Item], None]) -> None:
        mind: _Mind | None = None
        while not self._stop.is_set():
            if self._begin_anew.is_set():
                self._begin_anew.clear()
                before, mind = mind, _Mind(self._settings, self._context, self._graph.is_ros1, self.casting)
                if before is not None:
                    give([*before.end(), *mind.remember(before)])
            if mind is None:
                self._begin_anew.wait(WAIT_S)
                continue
            heard = self._backlog.take(WAIT_S)
            if heard is None:
                continue
            batches = mind.take(heard)
            self.perception = mind.perception
            if batches:
                give(batches)
            if mind.is_set_back:
                log.warning("%s: the robot's clock was set back: perception begins anew", self._context.name)
                self._begin_anew.set()

    def _tell_several(self, several: Mapping[str, str]) -> None:
        for topic in several.keys() - self._told:
            log.warning("%s: %s: %s", self._context.name, topic, several[topic])
        self._told |= several.keys()

    def _say_parts(self) -> None:
        parts = self.casting.parts
        played = {} if parts is None else {part: names for part, names in parts.topics.items() if names}
        said = ", ".join(f"{part} {' '.join(names)}" for part, names in played.items())
        log.info("%s: hears %s", self._context.name, said or "transforms only")

    def _tell_trouble(self, now_s: float) -> None:
        """What keeps its sensors from being understood, as the bridge says of itself."""
        troubles = self._context.figures.troubles
        said = ""
        if self.casting.trouble is not None:
            said = str(self.casting.trouble)
        silent = sorted(
            topic for topic, heard_s in self._last_s.items()
            if now_s - heard_s > SILENT_S and self.casting.parts is not None
            and any(topic in self.casting.parts.topics.get(part, ()) for part in ("scan", "image", "boxes"))
        )  # fmt: skip
        if silent:
            said = f"nothing comes on {', '.join(silent)}"
        if said and troubles.get(SENSORS) != said:
            log.warning("%s: %s", self._context.name, said)
            self._later(lambda: troubles.update({SENSORS: said}))
        elif not said and SENSORS in troubles:
            log.warning("%s: its sensors are heard", self._context.name)
            self._later(lambda: troubles.pop(SENSORS, None))


class _Mind:
    """Mutable: perception from when it begins until it begins anew."""

    def __init__(self, settings: RosSettings, context: Context, is_ros1: bool, casting: Casting) -> None:
        self._settings, self._is_ros1 = settings, is_ros1
        self._has_sensor = casting.has_sensor()
        self._readers: dict[tuple[str, str, str], Callable[[bytes, int], Sequence[Value | Flaw]]] = {}
        self.perception: Perception | None = None
        assert casting.parts is not None  # noqa: S101  (it is made when there are some)
        self._rig = rig_of(casting.parts, settings.wishes())
        # a model that cannot be used is told now, not when sensors have spoken
        self._sensors = sensors_of(self._rig, {})
        self._surveyed: list[Received] | None = []
        self._survey_ends_s = 0.0
        if len(self._sensors) <= 1:
            self._begin([])
        session = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%S.%f}"[:-3] + "Z"
        self._finds = FindBatches(context.map_name, context.source, session, settings.floor_z_m)
        self._robot: Robot | None = None
        if settings.robot is not None or settings.robot_pose is not None:
            frame = ROBOT if settings.robot_pose is not None else settings.robot or ROBOT
            source = f"{context.source}/robot"
            self._robot = Robot(settings.frame, frame, settings.robot_name or context.name, source)
        self._left_out: Counter[str] = Counter()
        self._flaws: Counter[tuple[str, str]] = Counter()
        self._told_s = 0.0
        self._newest_us: dict[str, int] = {}
        self._behind = 0
        self._fixed: dict[str, Heard] = {}
        self.is_set_back = False

    def remember(self, before: _Mind) -> list[Batch]:
        """What was said once and for all before."""
        return [batch for heard in before._fixed.values() for batch in self.take(heard)]

    def take(self, heard: Heard) -> list[Batch]:
        """What follows from a message."""
        batches: list[Batch] = []
        for value in self._values(heard):
            received = Received(heard.sent_us, heard.topic, value)
            if isinstance(value, Transform):
                if value.is_static:
                    self._fixed[value.child] = heard
                batches += self._moved(value)
            if heard.topic == self._settings.robot_pose:
                continue
            if self._is_out_of_time(value):
                continue
            self._note_stamp(heard.topic, value)
            if self._surveyed is None:
                batches += self._perceived([received])
            else:
                self._survey(self._surveyed, received)
        if self._surveyed is not None and 0 < self._survey_ends_s < time.monotonic():
            kept, self._surveyed = self._surveyed, None
            self._begin(kept)
            batches += self._perceived(kept)
        return [*batches, *self._refused()]

    def end(self) -> list[Batch]:
        """All tracks end."""
        if self.perception is None:
            return []
        return [*self._finds.batches(self.perception.flush()), *self._refused(is_over=True)]

    def _perceived(self, every: Sequence[Received]) -> list[Batch]:
        batches: list[Batch] = []
        if self.perception is None:
            return batches
        for received in every:
            found = self.perception.take(received)
            batches += self._finds.batches(found)
            mark_us = found.lines_watermark_us or found.persons_watermark_us
            if self._robot is not None and self._settings.robot_pose is None and mark_us is not None:
                batches += self._guarded(partial(self._robot.at, mark_us))
        return batches

    def _moved(self, transform: Transform) -> list[Batch]:
        robot = self._robot
        if robot is None:
            return []
        self._guarded(partial(robot.add, transform))
        is_moment = transform.child == ROBOT or not (
            self._settings.robot_pose or self._has_sensor or transform.is_static
        )
        return self._guarded(partial(robot.at, transform.stamp_us)) if is_moment else []

    def _guarded(self, ask: Callable[[], Any]) -> list[Batch]:
        try:
            return ask() or []
        except InvalidInput as error:
            self._flaws[str(error), ""] += 1
            return []

    def _values(self, heard: Heard) -> list[Value]:
        try:
            found = self._reader(heard)(heard.raw, heard.sent_us)
        except Unusable as error:
            found = [error.flaw]
        for each in found:
            if isinstance(each, Flaw):
                self._flaws[f"{heard.topic}: {each.why.value}", each.said] += 1
        return [each for each in found if not isinstance(each, Flaw)]

    def _reader(self, heard: Heard) -> Callable[[bytes, int], Sequence[Value | Flaw]]:
        key = heard.topic, heard.type, heard.definition
        if key not in self._readers:
            kind = MessageDefinitionFormat.MSG if heard.definition else MessageDefinitionFormat.NONE
            message_of = deserialiser(heard.type, MessageDefinition(kind, heard.definition), self._is_ros1)
            if heard.topic == self._settings.robot_pose:
                self._readers[key] = lambda raw, sent_us: [pose_of_frame(message_of(raw), sent_us, ROBOT)]
            else:
                classes = self._settings.person_classes
                self._readers[key] = reader_of(heard.topic, heard.type, message_of, classes)
        return self._readers[key]

    def _is_out_of_time(self, value: Value) -> bool:
        """Whether its stamp cannot be, by this machine's clock: what follows from it would be refused."""
        if not isinstance(value, Seen):
            return False
        ahead_s = (value.stamp_us - to_us(datetime.now(UTC))) / 1e6
        behind_s = self._settings.behind_s
        if ahead_s > self._settings.ahead_s:
            self._flaws["stamp in the future", f"{ahead_s:.1f} s ahead of this clock"] += 1
            return True
        if behind_s is not None and ahead_s < -behind_s:
            self._flaws["stamp too old", f"{-ahead_s:.1f} s behind this clock"] += 1
            return True
        return False

    def _note_stamp(self, topic: str, value: Value) -> None:
        if not isinstance(value, Seen):
            return
        newest_us = self._newest_us.get(topic, value.stamp_us)
        self._behind = self._behind + 1 if value.stamp_us < newest_us - BACK_US else 0
        self._newest_us[topic] = max(newest_us, value.stamp_us)
        self.is_set_back = self._behind >= BACK_RECORDS

    def _survey(self, surveyed: list[Received], received: Received) -> None:
        surveyed.append(received)
        heard = {each.topic for each in surveyed if isinstance(each.value, Seen)}
        if not self._survey_ends_s and heard >= {each.topic for each in self._sensors}:
            self._survey_ends_s = time.monotonic() + SURVEY_S
        if len(surveyed) > MOST_SURVEYED:  # one of them is silent
            self._survey_ends_s = time.monotonic()

    def _begin(self, surveyed: Sequence[Received]) -> None:
        self._surveyed = None
        timing = timing_of(surveyed)
        sensors = [timed(each, timing.get(each.topic, UNKNOWN)) for each in self._sensors]
        self.perception = perception_of(self._rig, sensors)

    def _refused(self, *, is_over: bool = False) -> list[Batch]:
        """What could not be used since the last time, each second."""
        now_s = time.monotonic()
        if now_s - self._told_s < 1.0 and not is_over:
            return []
        self._told_s = now_s
        left_out = Counter() if self.perception is None else Counter(self.perception.left_out)
        new = left_out - self._left_out
        self._left_out = left_out
        refused = [Refused(0, reason, "") for reason, count in new.items() for _ in range(count)]
        refused += [
            Refused(0, reason, detail)
            for (reason, detail), count in self._flaws.items() for _ in range(count)
        ]  # fmt: skip
        self._flaws.clear()
        return [Batch(refused=refused)] if refused else []
