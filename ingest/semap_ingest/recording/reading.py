"""A recording played as values: ROS 1 bags, ROS 2 folders, single MCAP and sqlite3 files.

It promises the order of the log, stamps from the messages' headers (the log's where a header has none), and
frames without leading slashes. A message that cannot be used is counted in `passed_over` and the next one
follows; a damaged file raises.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from semap.errors import InvalidInput
from semap_ingest.recording.decoding import DECODERS, Read, Value, pose_of_frame, reader_of
from semap_ingest.recording.header import logged_us
from semap_ingest.recording.passed_over import Flaw, PassedOver, Tally, Unusable

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

    from semap_ingest.recording.rosbag_file import RosbagFile

LOOKED_AT = 20
"""So many messages tell whether those of a topic can be used."""

PERSON_CLASSES = ("person", "pedestrian", "human", "people")


@dataclass(frozen=True)
class Topic:
    """What a recording holds under one name.

    type     as ROS 2 writes it, also in a recording of ROS 1
    is_read  whether semap makes values of this type
    """

    name: str
    type: str
    count: int
    is_read: bool = True


@dataclass(frozen=True)
class Received:
    """A value, and when the recorder wrote it down [us since 1970], which is the pace of playing."""

    sent_us: int
    topic: str
    value: Value


class Recording:
    """An open recording; a context manager.

    topics            in the order of their names
    start_us, end_us  the log's first and last message [us since 1970]
    count             of all messages, also of those that are not read
    """

    def __init__(self, path: Path | str, *, person_classes: Collection[str] = PERSON_CLASSES) -> None:
        """person_classes: which detections in 3D are persons, by any case of letters.

        frame_at  topics of poses that say where a frame is, and which; may be set later
        raises  InvalidInput for what is no recording, is damaged, holds no messages, or without rosbags
        """
        self._file = _opened(Path(path))
        self._person_classes = person_classes
        self.frame_at: Mapping[str, str] = {}
        self._tally = Tally()
        self.topics = _topics(self._file.connections)
        self.start_us, self.end_us = self._file.first_ns // 1000, self._file.last_ns // 1000
        self.count = self._file.count

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._file.close()

    @property
    def passed_over(self) -> tuple[PassedOver, ...]:
        """What could not be used since `records` was called last."""
        return self._tally.rows()

    def records(self, topics: Collection[str] | None = None) -> Iterator[Received]:
        """The values of these topics, or of all that semap reads, in the order of the log.

        A message of tf gives one value for each of its transforms; odometry is one, too.

        topics  with or without a leading slash
        raises  InvalidInput at once for a topic that is not there or is of a type that semap does not read;
                later where the file turns out to be damaged
        """
        wanted = self._wanted(topics)
        self._tally = Tally()
        return self._play(wanted, self._tally)

    def frame_of(self, topic: str) -> str:
        """The frame of the first message of a topic; empty where none of the first can be used."""
        return str(getattr(self.first_of(topic), "frame", ""))

    def first_of(self, topic: str) -> Value | None:
        """The first value of a topic; None where none of its first messages can be used."""
        first = next(self._play(self._wanted([topic]), Tally(), LOOKED_AT), None)
        return None if first is None else first.value

    def flaw_of(self, topic: str) -> str:
        """What is wrong with the first messages of a topic; empty where one of them can be used."""
        tally = Tally()
        first = islice(self._play(self._wanted([topic]), tally, LOOKED_AT), 1)
        used = next(first, None)
        rows = () if used is not None else tally.rows()
        return rows[0].example if rows else ""

    def _wanted(self, topics: Collection[str] | None) -> list[Connection]:
        readable = [each for each in self._file.connections if each.msgtype in DECODERS]
        if topics is None:
            return readable
        names = {name.lstrip("/") for name in topics}
        missing = sorted(names - {each.topic.lstrip("/") for each in readable})
        if missing:
            raise self._not_there(missing[0])
        return [each for each in readable if each.topic.lstrip("/") in names]

    def _not_there(self, name: str) -> InvalidInput:
        there = ", ".join(topic.name for topic in self.topics if topic.is_read)
        for topic in self.topics:
            if topic.name.lstrip("/") == name:
                return InvalidInput(
                    f"the topic {topic.name} is of the type {topic.type}, which semap does not read",
                    f"It reads {', '.join(DECODERS)}; here: {there}.",
                )
        return InvalidInput(f"the recording has no topic /{name}", f"It has: {there}.")

    def _reader_of(self, connection: Connection) -> Read:
        deserialise = self._file.deserialiser(connection)
        frame = self.frame_at.get(connection.topic)
        if frame is not None:
            return lambda raw, log_us: [pose_of_frame(deserialise(raw), log_us, frame)]
        return reader_of(connection.topic, connection.msgtype, deserialise, self._person_classes)

    def _play(self, wanted: list[Connection], tally: Tally, most: int | None = None) -> Iterator[Received]:
        """most: look at no more messages"""
        decoders = {each.id: (each.topic, self._reader_of(each)) for each in wanted}
        for connection_id, log_ns, raw in islice(self._file.messages(wanted), most):
            topic, decode = decoders[connection_id]
            try:
                log_us = logged_us(log_ns)
                values = decode(raw, log_us)
            except Unusable as error:
                tally.add(topic, error.flaw)
                continue
            for value in values:
                if isinstance(value, Flaw):
                    tally.add(topic, value)
                else:
                    yield Received(log_us, topic, value)


def _opened(path: Path) -> RosbagFile:
    try:
        from semap_ingest.recording.rosbag_file import RosbagFile  # noqa: PLC0415
    except ImportError as error:
        raise InvalidInput(
            "reading recordings needs rosbags", "pip install 'semap[perception]'", path.name
        ) from error
    return RosbagFile(path)


def _topics(connections: Collection[Connection]) -> tuple[Topic, ...]:
    """Several publishers of one topic are one; two types under one name are two."""
    counts: dict[tuple[str, str], int] = {}
    for each in connections:
        counts[each.topic, each.msgtype] = counts.get((each.topic, each.msgtype), 0) + each.msgcount
    return tuple(Topic(name, kind, count, kind in DECODERS) for (name, kind), count in sorted(counts.items()))
