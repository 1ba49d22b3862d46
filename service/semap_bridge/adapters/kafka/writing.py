"""Happenings to a topic, and the cursor to another, in one transaction.

A transactional id belongs to one producer: who begins to write under it takes it over, and fences the one
before. So what a killed bridge left open is undone before its cursor is read, and a bridge that was thought
dead writes nothing more.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable, Sequence
from threading import Lock
from typing import ClassVar, Literal

from confluent_kafka import (
    OFFSET_BEGINNING,
    Consumer,
    IsolationLevel,
    KafkaError,
    KafkaException,
    Message,
    Producer,
    TopicPartition,
)
from confluent_kafka.admin import ConfigResource, NewTopic, OffsetSpec, ResourceType
from sqlalchemy import Connection as Database

from semap.errors import Conflict, SemapError, ServiceUnreachable
from semap.store.event.cloud_event import STRUCTURED
from semap.store.relation.changes import StoredChange
from semap_bridge.adapter import Happening, Sink
from semap_bridge.adapters.kafka.connection import ANSWER_S, GROUP, Connection
from semap_bridge.context import Context
from semap_bridge.messages.cursor import number_in

TRANSACTION_S = 60.0
"""Then a broker undoes a transaction of its own accord."""
COMMIT_S = 15.0
HEADERS: list[tuple[str, str | bytes | None]] = [("content-type", f"{STRUCTURED}; charset=UTF-8")]
COMPACTED = {"cleanup.policy": "compact", "segment.bytes": "16777216", "min.cleanable.dirty.ratio": "0.1"}
FENCED = (KafkaError._FENCED, KafkaError.INVALID_PRODUCER_EPOCH, KafkaError.PRODUCER_FENCED)


class Writing(Sink):
    """Mutable: a producer of a transactional id, once the cursor was asked for.

    newest  the number of the newest in the database, which no cursor is beyond; None: that is not known
    """

    cursor_at: ClassVar[Literal["database", "broker"]] = "broker"

    def __init__(
        self,
        connection: Connection,
        context: Context,
        topic: str,
        cursors: str,
        transactional_id: str,
        newest: Callable[[Database], int] | None = None,
    ) -> None:
        self._connection = connection
        self._context = context
        self._topic, self._cursors = topic, cursors
        self._id = transactional_id
        self._newest = newest
        self._producer: Producer | None = None
        self._failed: KafkaError | None = None
        self._lock = Lock()

    async def cursor(self) -> int | None:
        cursor = await asyncio.to_thread(self._take_over)
        if cursor is not None and self._newest is not None:
            newest = await self._context.ask(self._newest)
            if cursor > newest:
                raise Conflict(
                    f"The topic {self._topic} has events up to number {cursor} under the transactional id"
                    f" {self._id}, and this database up to {newest}: they are of another one.",
                    "Give this bridge a `transactional_id` of its own, and best other topics.",
                )
        return cursor

    async def deliver(self, happenings: Sequence[Happening]) -> None:
        await asyncio.to_thread(self._deliver, happenings)

    def close(self) -> None:
        """Waits for what is being delivered."""
        with self._lock:
            if self._producer is not None:
                self._producer.purge()
            # its own `close` would undo a transaction, which the next producer of the id does if need be
            self._producer = None

    def _take_over(self) -> int | None:
        """Become the only one who writes under the transactional id, and read how far it came."""
        with self._lock:
            try:
                self._make_topics()
                if self._producer is None:
                    self._producer = Producer(
                        self._connection.config(
                            {
                                "transactional.id": self._id,
                                "transaction.timeout.ms": round(TRANSACTION_S * 1e3),
                                "linger.ms": 0,
                            }
                        )
                    )
                    self._producer.init_transactions(COMMIT_S)
                return self._read_cursor()
            except KafkaException as error:
                raise self._trouble(error.args[0]) from error

    def _deliver(self, happenings: Sequence[Happening]) -> None:
        with self._lock:
            if self._producer is None:
                raise ServiceUnreachable("The connection to Kafka was closed.")
            began_s = time.monotonic()
            try:
                self._producer.begin_transaction()
                for each in happenings:
                    self._producer.produce(
                        self._topic,
                        each.cloud_event_json(),
                        _key(each),
                        headers=HEADERS,
                        on_delivery=self._hear,
                    )
                cursor = json.dumps({"event": happenings[-1].number})
                self._producer.produce(self._cursors, cursor, self._id, partition=0, on_delivery=self._hear)
                self._producer.commit_transaction(COMMIT_S)
            except KafkaException as error:
                raise self._trouble(error.args[0], time.monotonic() - began_s) from error

    def _hear(self, error: KafkaError | None, message: Message) -> None:
        if error is not None and self._failed is None and error.code() != KafkaError._PURGE_QUEUE:
            self._failed = error

    def _trouble(self, error: KafkaError, lasted_s: float = 0.0) -> SemapError:
        """What to raise; a broker fences, too, who was longer than a transaction may be."""
        if error.code() in FENCED and lasted_s < TRANSACTION_S:
            return Conflict(
                f"Another bridge took over the transactional id {self._id} from this one.",
                "Run one bridge for each transactional id: stop one of them, or set `transactional_id`.",
            )
        return self._connection.unreachable(self._failed or error, f"The topic {self._topic}")

    def _make_topics(self) -> None:
        """Those that are missing; of cursors, the last one of each bridge has to be kept."""
        there = self._connection.topics()
        wanted = [NewTopic(self._topic, -1, -1), NewTopic(self._cursors, 1, -1, config=COMPACTED)]
        missing = [each for each in wanted if each.topic not in there]
        if missing:
            made = self._connection.admin.create_topics(missing, request_timeout=ANSWER_S)
            for name, each in made.items():
                try:
                    each.result()
                except KafkaException as error:
                    if error.args[0].code() != KafkaError.TOPIC_ALREADY_EXISTS:
                        raise self._connection.unreachable(error.args[0], f"The topic {name}") from error
        if self._cursors in there:
            self._require_compacted()

    def _require_compacted(self) -> None:
        asked = ConfigResource(ResourceType.TOPIC, self._cursors)
        found = self._connection.admin.describe_configs([asked], request_timeout=ANSWER_S)[asked].result()
        if "compact" not in found["cleanup.policy"].value:
            raise ServiceUnreachable(
                f"The topic {self._cursors} is not compacted, so that cursors in it would be deleted.",
                f"kafka-configs.sh --alter --topic {self._cursors} --add-config cleanup.policy=compact",
            )

    def _read_cursor(self) -> int | None:
        """The last one that was committed, of all that is there now: others may have transactions open."""
        place = TopicPartition(self._cursors, 0, OFFSET_BEGINNING)
        ends = self._connection.admin.list_offsets(
            {place: OffsetSpec.latest()},  # type: ignore[no-untyped-call]
            isolation_level=IsolationLevel.READ_UNCOMMITTED,
            request_timeout=ANSWER_S,
        )
        (end,) = [each.result().offset for each in ends.values()]
        consumer = Consumer(
            self._connection.config(
                {
                    "group.id": GROUP,
                    "enable.auto.commit": False,
                    "isolation.level": "read_committed",
                    "enable.partition.eof": True,
                }
            )
        )
        try:
            consumer.assign([place])
            found: int | None = None
            deadline_s = time.monotonic() + TRANSACTION_S + ANSWER_S
            while time.monotonic() < deadline_s:
                message = consumer.poll(1.0)
                if message is None:
                    continue
                error = message.error()
                if error is None:
                    if message.key() == self._id.encode():
                        found = self._cursor_of(message.value() or b"")
                elif error.code() != KafkaError._PARTITION_EOF:
                    raise KafkaException(error)
                elif (message.offset() or 0) >= end:
                    return found
        finally:
            consumer.close()
        raise ServiceUnreachable(f"The topic {self._cursors} could not be read to its end.")

    def _cursor_of(self, value: bytes) -> int:
        try:
            return number_in(value, "event")
        except ValueError as error:
            raise ServiceUnreachable(
                f"The topic {self._cursors} has a cursor that is none: {error}.",
                "Name a topic in `cursors` that semap alone writes to.",
            ) from error


def _key(happening: Happening) -> str:
    """Who it is about, so that what happens to one is in order."""
    made = happening.made
    if isinstance(made, StoredChange):
        return made.subject
    return made.track_name or made.instance_name or made.type
