"""Topics of a broker for tests: made anew for each, written to, and read as their readers would."""

from __future__ import annotations

import json
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import yaml
from bridging import config
from confluent_kafka import Consumer, KafkaError, KafkaException, Message, Producer, TopicPartition
from confluent_kafka.admin import AdminClient, NewTopic
from semap_bridge.config import Entry, read_config

from bench.kafka.broker import Broker

ANSWER_S = 60.0
QUIET = {"log_level": 0}


def entry(folder: Path, broker: Broker, map_name: str = "world", **settings: object) -> Entry:
    """The one bridge of a config, `lines`."""
    said = {"name": "lines", "kind": "kafka", "servers": broker.address, **settings}
    return read_config(config(folder, yaml.safe_dump([said]), map_name)).bridges[0]


@dataclass
class Topics:
    """Topics whose names begin with a word of their own, which YAML does not take for a number."""

    broker: Broker
    word: str = field(default_factory=lambda: f"t{secrets.token_hex(4)}")

    def __post_init__(self) -> None:
        self.admin = AdminClient({"bootstrap.servers": self.broker.address, **QUIET})

    def name(self, of: str) -> str:
        return f"{self.word}.{of}"

    def make(self, of: str, partitions: int = 1, **settings: str) -> str:
        """A topic that keeps records of the past, too: a broker deletes by their stamps."""
        name = self.name(of)
        settings = {"retention.ms": "-1", **settings}
        self.admin.create_topics([NewTopic(name, partitions, 1, config=settings)])[name].result(ANSWER_S)
        return name

    def producer(self, settings: Mapping[str, str] | None = None) -> Producer:
        """Which keeps the order of records, also of those that it has to send again."""
        reached = {"bootstrap.servers": self.broker.address, "enable.idempotence": True}
        return Producer({**reached, **QUIET, **(settings or {})})

    def write(self, topic: str, records: Sequence[tuple[str | None, bytes | None, int]]) -> None:
        """Records as (key, value, partition); a partition of -1 is that of the key."""
        producer = self.producer()
        for key, value, partition in records:
            producer.produce(topic, value, key, partition=partition)
        assert producer.flush(ANSWER_S) == 0
        producer.close()

    def read(self, topic: str, *, is_committed: bool = True) -> list[Message]:
        """All that committed readers see of it, partition by partition."""
        partitions = self.admin.list_topics(topic, ANSWER_S).topics[topic].partitions
        consumer = Consumer(
            {
                "bootstrap.servers": self.broker.address, "group.id": "test", "enable.auto.commit": False,
                "enable.partition.eof": True, "auto.offset.reset": "earliest", **QUIET,
                "isolation.level": "read_committed" if is_committed else "read_uncommitted",
            }
        )  # fmt: skip
        found: list[Message] = []
        try:
            for number in partitions:
                consumer.assign([TopicPartition(topic, number, 0)])
                while True:
                    message = consumer.poll(ANSWER_S)
                    assert message is not None
                    if message.error() is None:
                        found.append(message)
                        continue
                    assert message.error().code() == KafkaError._PARTITION_EOF, message.error()
                    break
        finally:
            consumer.close()
        return found

    def end(self, topic: str) -> int:
        """The offset after the last record of its first partition; 0 while nobody answers."""
        consumer = Consumer({"bootstrap.servers": self.broker.address, "group.id": "test", **QUIET})
        try:
            return consumer.get_watermark_offsets(TopicPartition(topic, 0), timeout=5)[1]
        except KafkaException:
            return 0
        finally:
            consumer.close()

    def events(self, topic: str) -> list[dict]:
        return [json.loads(each.value()) for each in self.read(topic)]

    def count(self, topic: str) -> int:
        """How many committed records it has; 0 where it is not there yet."""
        there = self.admin.list_topics(timeout=ANSWER_S).topics
        return len(self.read(topic)) if topic in there else 0
