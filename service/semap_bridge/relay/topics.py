"""The two topics of a prefix, and how they are reached."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from confluent_kafka import Consumer, KafkaError, KafkaException, Message, Producer, TopicPartition
from confluent_kafka.admin import NewTopic
from pydantic import ValidationError

from semap.errors import InvalidInput, ServiceUnreachable
from semap_bridge.adapters.kafka.connection import ANSWER_S, GROUP, Connection
from semap_bridge.adapters.kafka.settings import KafkaSettings

PARTITIONS = 12
"""Of a topic that is made here; never changed, since a map stays in the partition of its uid."""
WAIT_S = 0.2
AT_ONCE = 1_000
SEND_S = 30.0


class Topics:
    """Mutable: a connection to brokers."""

    def __init__(self, kafka: str, prefix: str) -> None:
        """kafka is addresses of brokers, or a file with `servers`, `login`, `tls`; raises InvalidInput."""
        self.due, self.events = f"{prefix}.due", f"{prefix}.events"
        self._connection = Connection(_settings(kafka, self.events))

    def make(self, partitions: int = PARTITIONS) -> None:
        """Make those that are missing; raises ServiceUnreachable."""
        there = self._connection.topics()
        missing = [NewTopic(name, partitions, -1) for name in (self.due, self.events) if name not in there]
        for name, made in self._connection.admin.create_topics(missing).items() if missing else ():
            try:
                made.result(ANSWER_S)
            except KafkaException as error:
                if error.args[0].code() != KafkaError.TOPIC_ALREADY_EXISTS:
                    raise self._connection.unreachable(error.args[0], f"The topic {name}") from error

    def partitions(self, topic: str) -> int:
        """How many a topic has; raises ServiceUnreachable where it is not there."""
        found = self._connection.topics().get(topic)
        if found is None:
            raise ServiceUnreachable(f"There is no topic {topic}.", "Run `semap publish` with this prefix.")
        return found

    def sender(self, topic: str) -> Sender:
        return Sender(self._connection, topic)

    def reader(self, topic: str, begin: Mapping[int, int]) -> Reader:
        """A reader of all partitions, each from its offset on, or else from what there is."""
        return Reader(self._connection, topic, begin, self.partitions(topic))


class Sender:
    """Mutable: a producer, which keeps the order of what has one key."""

    def __init__(self, connection: Connection, topic: str) -> None:
        self._connection, self._topic = connection, topic
        self._failed: KafkaError | None = None
        self._producer = Producer(
            connection.config(
                {"enable.idempotence": True, "linger.ms": 0, "compression.type": "lz4",
                 "message.timeout.ms": round(SEND_S * 1000),
                 "partitioner": "murmur2_random"}  # that of others, so that a map has one partition
            )
        )  # fmt: skip

    def send(self, records: Sequence[tuple[str, str]]) -> None:
        """Return once the brokers have these keys with their values; raises ServiceUnreachable."""
        self._failed = None
        for key, value in records:
            while True:
                try:
                    self._producer.produce(self._topic, value, key, on_delivery=self._hear)
                    break
                except BufferError:
                    self._producer.poll(WAIT_S)
        if self._producer.flush(2 * SEND_S) or self._failed is not None:
            told = self._failed or KafkaError(KafkaError._MSG_TIMED_OUT)
            raise self._connection.unreachable(told, f"The topic {self._topic}")

    def _hear(self, error: KafkaError | None, message: Message) -> None:
        if error is not None and self._failed is None:
            self._failed = error


class Reader:
    """Mutable: a consumer, and of each partition the offset of what comes next."""

    def __init__(self, connection: Connection, topic: str, begin: Mapping[int, int], partitions: int) -> None:
        self._connection, self._topic = connection, topic
        self._consumer = Consumer(
            connection.config(
                {"group.id": GROUP, "enable.auto.commit": False, "auto.offset.reset": "error",
                 "fetch.wait.max.ms": 50, "isolation.level": "read_committed"}
            )
        )  # fmt: skip
        self.next: dict[int, int] = {}
        for number in range(partitions):
            first, _ = self._ends(number)
            self.next[number] = begin.get(number, first)
        self._consumer.assign([TopicPartition(topic, *each) for each in self.next.items()])

    def read(self) -> list[Message]:
        """What has come, at most AT_ONCE; raises ServiceUnreachable."""
        first = self._consumer.poll(WAIT_S)
        found = [] if first is None else [first, *self._consumer.consume(AT_ONCE - 1, 0)]
        for message in found:
            if (error := message.error()) is not None:
                raise self._connection.unreachable(error, f"The topic {self._topic}")
            self.next[message.partition() or 0] = (message.offset() or 0) + 1
        if not found and self._connection.is_lost():
            self._connection.topics()
        return found

    def until_now(self) -> Iterator[Message]:
        """All that is there by now; raises ServiceUnreachable."""
        ends = {number: self._ends(number)[1] for number in self.next}
        deadline_s = time.monotonic() + SEND_S
        while any(self.next[number] < end for number, end in ends.items()):
            found = self.read()
            if found:
                deadline_s = time.monotonic() + SEND_S
            elif time.monotonic() > deadline_s:
                raise ServiceUnreachable(f"The topic {self._topic} could not be read to its end.")
            yield from found

    def close(self) -> None:
        self._consumer.close()

    def _ends(self, partition: int) -> tuple[int, int]:
        try:
            return self._consumer.get_watermark_offsets(TopicPartition(self._topic, partition), ANSWER_S)
        except KafkaException as error:
            raise self._connection.unreachable(error.args[0], f"The topic {self._topic}") from error


def _settings(kafka: str, topic: str) -> KafkaSettings:
    said: dict[str, Any] = {"servers": kafka}
    if Path(kafka).is_file():
        said = yaml.safe_load(Path(kafka).read_text())
    try:
        return KafkaSettings(name="relay", kind="kafka", events=topic, **said)
    except (TypeError, ValidationError) as error:
        raise InvalidInput(
            f"{kafka!r} says no brokers: {error}",
            "Give HOST:PORT, or a file with servers, login, tls.",
            "--kafka",
        ) from error
