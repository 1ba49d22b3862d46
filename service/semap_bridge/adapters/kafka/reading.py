"""States from a topic. A position is the topic, its id, and the next offset of each of its partitions.

What waits in several partitions is taken in the order of its records' timestamps, else a bridge that catches
up would say hours of one partition after hours of another, and rules would find all of it late.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import deque
from collections.abc import AsyncIterator, Mapping
from dataclasses import replace
from heapq import merge
from math import inf
from operator import itemgetter
from threading import Lock

from confluent_kafka import (
    Consumer,
    KafkaError,
    KafkaException,
    Message,
    TopicCollection,
    TopicPartition,
)
from confluent_kafka.admin import TopicDescription

from semap.store.motion.bridges import Position
from semap_bridge.adapter import Batch, Source
from semap_bridge.adapters.kafka.connection import ANSWER_S, GROUP, Connection
from semap_bridge.adapters.kafka.decoding import batch_of_records
from semap_bridge.adapters.kafka.moments import Moments
from semap_bridge.adapters.kafka.settings import KafkaSettings
from semap_bridge.context import Context

log = logging.getLogger(__name__)

RECORDS = 10_000
"""So many records of each partition wait for the others."""
TOGETHER_BYTES = 200_000
"""So much is read together: a transaction of many moments takes longer than as many of one moment each."""
AT_ONCE = 1_000
LOOK_S = 0.5
PARTITIONS_S = 10.0
"""So often it is seen whether there are new partitions."""


class Partition:
    """Mutable: what of a partition waits, and how far it was read.

    waiting  records, each with a time [ms] that does not fall, as those of records may
    emitted  the offset after the last record that was given on
    read     the offset after the last one that was read
    end      the offset after the last one that the broker has
    is_over  nothing more of it can be read for now
    """

    def __init__(self, begin: int, end: int) -> None:
        self.waiting: deque[tuple[int, Message]] = deque()
        self.emitted = self.read = begin
        self.end = end
        self.is_over = False
        self._newest_ms = 0

    def put(self, message: Message) -> None:
        self._newest_ms = max(self._newest_ms, message.timestamp()[1])
        self.waiting.append((self._newest_ms, message))
        self.read = (message.offset() or 0) + 1
        self.is_over = False

    def is_behind(self) -> bool:
        """There is more, and none of it is here yet."""
        return not self.waiting and self.has_more()

    def until_ms(self) -> float:
        """Nothing from before it is to come."""
        return self._newest_ms if self.has_more() else inf

    def take(self, until_ms: float) -> list[tuple[int, Message]]:
        taken = []
        while self.waiting and self.waiting[0][0] <= until_ms:
            taken.append(self.waiting.popleft())
        if taken:
            self.emitted = (taken[-1][1].offset() or 0) + 1
        return taken

    def has_more(self) -> bool:
        """There is more than was read."""
        return not self.is_over and self.read < self.end


class Reading(Source):
    """Mutable: a consumer, and what it holds of each partition."""

    def __init__(self, connection: Connection, settings: KafkaSettings, topic: str, context: Context) -> None:
        self._connection = connection
        self._begins_newest = settings.begin == "newest"
        self._topic = topic
        self._context = context
        self._topic_id = ""
        self._partitions: dict[int, Partition] = {}
        self._moments = Moments()
        self._held_back: set[int] = set()
        self._looked_s = time.monotonic()
        self._lock = Lock()
        self._consumer = Consumer(
            connection.config(
                {
                    "group.id": GROUP,
                    "enable.auto.commit": False,
                    "enable.auto.offset.store": False,
                    "auto.offset.reset": "error",
                    "isolation.level": "read_committed",
                    "enable.partition.eof": True,
                    "max.poll.interval.ms": 86_400_000,
                    "fetch.wait.max.ms": 100,
                    "queued.max.messages.kbytes": 16_384,
                }
            )
        )

    async def batches(self, position: Position | None) -> AsyncIterator[Batch]:
        await asyncio.to_thread(self._begin, position)
        if position is None:
            yield Batch(position=self._position())
        while True:
            batch = await asyncio.to_thread(self._take)
            if batch is not None:
                yield batch

    def close(self) -> None:
        with self._lock:
            self._consumer.close()

    def _begin(self, position: Position | None) -> None:
        with self._lock:
            try:
                known = self._known(position)
                for number in range(len(self._described().partitions)):
                    self._add(number, known.get(str(number)), is_first=position is None)
            except KafkaException as error:
                raise self._connection.unreachable(error.args[0], f"The topic {self._topic}") from error

    def _described(self) -> TopicDescription:
        asked = self._connection.admin.describe_topics(
            TopicCollection([self._topic]), request_timeout=ANSWER_S
        )
        described: TopicDescription = asked[self._topic].result()
        return described

    def _known(self, position: Position | None) -> Mapping[str, int]:
        """The offsets of a position, if it is of this topic."""
        self._topic_id = str(self._described().topic_id)
        if position is None or position.get("topic") != self._topic:
            return {}
        if position.get("id") != self._topic_id:
            log.warning(
                "%s: the topic %s was made anew; it is read from its beginning",
                self._context.name,
                self._topic,
            )
            return {}
        return position["offsets"]  # type: ignore[return-value]

    def _add(self, number: int, known: int | None, *, is_first: bool) -> None:
        """Read a partition from a known offset, or from where it begins."""
        place = TopicPartition(self._topic, number)
        low, high = self._consumer.get_watermark_offsets(place, timeout=ANSWER_S)
        begin = (high if is_first and self._begins_newest else low) if known is None else known
        if known is None and low == begin > 0:
            log.info(
                "%s: %s begins with record %d: the broker deleted older ones", self._context.name, place, low
            )
        if begin < low:
            log.warning(
                "%s: %d records of %s were deleted before they were read",
                self._context.name,
                low - begin,
                place,
            )
            self._context.figures.dropped += low - begin
        begin = min(max(begin, low), high)
        self._partitions[number] = Partition(begin, high)
        self._assign(number, begin)

    def _take(self) -> Batch | None:
        """What came, if all that is before it is here, too."""
        with self._lock:
            try:
                first = self._consumer.poll(LOOK_S)
                if self._connection.is_lost():
                    self._connection.topics()
                if first is not None:
                    self._hear_all(first)
                self._look_for_partitions()
                ready = self._ready()
                self._hold_back()
            except KafkaException as error:
                raise self._connection.unreachable(error.args[0]) from error
            is_more = first is not None and any(each.has_more() for each in self._partitions.values())
        batch = self._moments.take(ready, batch_of_records(ready), is_more=is_more)
        return replace(batch, position=self._position()) if batch.records else None

    def _hear_all(self, first: Message) -> None:
        """A record, and what is here with it."""
        messages, count, size = [first], 0, 0
        while messages and size < TOGETHER_BYTES:
            for each in messages:
                self._hear(each)
                size += len(each)
            count += len(messages)
            left = (TOGETHER_BYTES - size) * count // max(size, 1)
            messages = self._consumer.consume(min(max(left, 1), AT_ONCE), 0)
        for each in messages:
            self._hear(each)

    def _hear(self, message: Message) -> None:
        """raises KafkaException"""
        partition = self._partitions[message.partition() or 0]
        error = message.error()
        if error is None:
            if (message.offset() or 0) >= partition.read:
                partition.put(message)
        elif error.code() == KafkaError._PARTITION_EOF:
            # of one that is held back it may be older than what was thrown away of it
            partition.is_over = message.partition() not in self._held_back
        else:
            raise KafkaException(error)

    def _ready(self) -> list[Message]:
        """Those before which nothing can come from another partition, in the order of time."""
        for number, each in self._partitions.items():
            place = TopicPartition(self._topic, number)
            each.end = max(each.end, self._consumer.get_watermark_offsets(place, cached=True)[1])
        partitions = self._partitions.values()
        if any(each.is_behind() for each in partitions):
            return []
        until_ms = min(each.until_ms() for each in partitions)
        runs = [each.take(until_ms) for each in partitions]
        return [message for _, message in merge(*runs, key=itemgetter(0))]

    def _hold_back(self) -> None:
        """Read no more of a partition that is far ahead of the others."""
        full = {number for number, each in self._partitions.items() if len(each.waiting) >= RECORDS}
        for number in full - self._held_back:
            self._consumer.incremental_unassign([TopicPartition(self._topic, number)])
        for number in self._held_back - full:
            self._assign(number, self._partitions[number].read)
        self._held_back = full

    def _assign(self, number: int, begin: int) -> None:
        self._consumer.incremental_assign([TopicPartition(self._topic, number, begin)])

    def _look_for_partitions(self) -> None:
        if time.monotonic() - self._looked_s < PARTITIONS_S:
            return
        self._looked_s = time.monotonic()
        there = self._connection.topics().get(self._topic, 0)
        for number in range(len(self._partitions), there):
            log.info("%s: the topic %s has a new partition %d", self._context.name, self._topic, number)
            self._add(number, 0, is_first=False)

    def _position(self) -> Position:
        begins = self._moments.begins()
        offsets = {str(number): begins.get(number, each.emitted) for number, each in self._partitions.items()}
        return {"topic": self._topic, "id": self._topic_id, "offsets": offsets}
