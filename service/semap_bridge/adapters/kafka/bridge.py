"""Kafka as an adapter."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

from sqlalchemy import Connection as Database

from semap.store.database.event_number import newest_event
from semap_bridge.adapter import Adapter, Sight, Sink, Source
from semap_bridge.adapters.kafka.connection import Connection
from semap_bridge.adapters.kafka.reading import Reading
from semap_bridge.adapters.kafka.settings import KafkaSettings
from semap_bridge.adapters.kafka.writing import Writing


class Kafka(Adapter[KafkaSettings]):
    Settings = KafkaSettings

    _connection: Connection
    _opened: tuple[Reading | Writing, ...] = ()

    async def open(self) -> None:
        self._connection = await asyncio.to_thread(Connection, self.settings)
        await asyncio.to_thread(self._connection.topics)

    async def close(self) -> None:
        for each in self._opened:
            await asyncio.to_thread(each.close)

    def source(self) -> Source | None:
        if self.settings.states is None:
            return None
        reading = Reading(self._connection, self.settings, self.settings.states, self.context)
        self._opened += (reading,)
        return reading

    def sink(self) -> Sink | None:
        return self._writing(self.settings.events, "events", newest_event)

    def changes(self) -> Sink | None:
        return self._writing(self.settings.changes, "changes")

    async def look(self, seconds: float) -> Sequence[Sight]:
        topics = await asyncio.to_thread(self._connection.topics)
        sights = []
        for what in ("states", "events", "changes"):
            name = getattr(self.settings, what)
            if name in topics:
                sights.append(Sight(name, f"topic of {what}, {topics[name]} partitions"))
            elif name is not None and what != "states":
                sights.append(Sight(name, f"topic of {what}, which will be made"))
        return sights

    def _writing(
        self, topic: str | None, what: str, newest: Callable[[Database], int] | None = None
    ) -> Sink | None:
        if topic is None:
            return None
        of_bridge = self.settings.transactional_id or f"semap.{self.context.map_name}.{self.settings.name}"
        cursors = self.settings.cursors or f"{topic}.cursor"
        writing = Writing(self._connection, self.context, topic, cursors, f"{of_bridge}.{what}", newest)
        self._opened += (writing,)
        return writing
