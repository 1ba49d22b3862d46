"""MQTT: positions and states of objects from any topics, and events as CloudEvents to one.

What comes is live. A format that says when its messages are from is subscribed to with QoS 1, and the
broker keeps them while the bridge is away; any other with QoS 0, since what comes late would be taken for
new. Events go out at least once, each with its id.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import Counter
from collections.abc import AsyncIterator, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from typing import Annotated

from pydantic import BeforeValidator, Field, model_validator
from semap_ingest.pipeline.registration import persons_source

from semap.store.motion.bridges import Position
from semap.timeline.stamp import to_us
from semap_bridge import adapter
from semap_bridge.adapter import Adapter, Batch, Happening, Sight, Sink, Source
from semap_bridge.broker import Broker, Link, Outgoing, identifier, payload_of
from semap_bridge.completeness import Completeness
from semap_bridge.context import Context
from semap_bridge.finds import open_tracks
from semap_bridge.messages.espresense import Espresense
from semap_bridge.messages.frigate import Frigate
from semap_bridge.messages.omlox import Omlox
from semap_bridge.messages.template import Template
from semap_bridge.messages.told import Message, Told, Unusable
from semap_bridge.placing import Placement, batch_of, placement_of
from semap_bridge.watching import Watching, read_camera_rig

log = logging.getLogger(__name__)

MOST_SIGHTS = 30


def _with_format(value: object) -> object:
    """A format need not be named where it is a template."""
    return {"format": "template", **value} if isinstance(value, dict) else value


Read = Annotated[
    Annotated[Template | Espresense | Frigate | Omlox, Field(discriminator="format")],
    BeforeValidator(_with_format),
]


class MqttSettings(adapter.Settings):
    """A broker, what is read from it, and where events go."""

    broker: Broker = Field(default=Broker(), description="host, port, login and tls.")
    read: list[Read] = Field(
        default_factory=list,
        description="What is read: format (template, espresense, frigate, omlox), topic.",
    )
    write: str | None = Field(
        default=None, pattern=r"^[^+#\x00]+$", description="Topic that events go to, such as semap/events."
    )
    settle_s: float = Field(
        default=0.003, ge=0, description="So long others of the newest stamp are waited for [s]."
    )
    keep_s: int = Field(
        default=3600,
        ge=0,
        le=2**31,
        description="So long the broker keeps stamped messages for a bridge that is away.",
    )

    @model_validator(mode="after")
    def _require_something(self) -> MqttSettings:
        if not self.read and self.write is None:
            raise ValueError("give read or write")
        if sum(isinstance(each, Frigate) and each.rig is not None for each in self.read) > 1:
            raise ValueError("one rig has the cameras of all: give it once")
        return self


class Mqtt(Adapter[MqttSettings], Source, Sink):
    Settings = MqttSettings

    def __init__(self, settings: MqttSettings, context: Context) -> None:
        super().__init__(settings, context)
        keeps = settings.read and not context.only_looks
        self._link = Link(settings.broker, identifier(context), keep_s=settings.keep_s if keeps else 0)
        self._placements: list[Placement] = []
        self._watching: Watching | None = None

    def source(self) -> Source | None:
        return self if self.settings.read else None

    def sink(self) -> Sink | None:
        return None if self.settings.write is None else self

    async def open(self) -> None:
        watched = [each for each in self.settings.read if isinstance(each, Frigate) and each.rig is not None]
        if watched and watched[0].rig is not None:
            rig = read_camera_rig(watched[0].rig)
            name, source = self.context.map_name, self.context.source
            self._watching = Watching(rig, watched[0].kept_s, name, source)
        self._placements = [await placement_of(self.context, each) for each in self.settings.read]
        await self._link.open()

    async def close(self) -> None:
        await self._link.close()

    async def batches(self, position: Position | None) -> AsyncIterator[Batch]:
        for each in self.settings.read:
            await self._link.subscribe(each.wanted, qos=1 if each.is_kept else 0)
        topics = ", ".join(each.wanted for each in self.settings.read)
        log.info("%s: reads %s at %s", self.context.name, topics, self.settings.broker.address)
        context = self.context
        if self._watching is not None and (
            left := await context.ask(lambda c: open_tracks(c, context.map_name, context.source))
        ):
            yield Batch(ended=left, source=persons_source(self.context.source))
        sources = self._sources()
        async for messages in self._link.messages(lambda: min(each.due_in_s() for each in sources.values())):
            for is_stamped, source in sources.items():
                said = [
                    Message(str(each.topic), payload_of(each), source.arrival_us(), bool(each.retain))
                    for each in messages
                ]
                source.gather(self._read(said, is_stamped))
            ready = {source: source.ready() for source in sources.values()}
            if any(each is not None for each in ready.values()):
                everything = [one for told in ready.values() for one, _ in told or []]
                for batch in self._watched(everything):
                    yield batch
                for source, told in ready.items():
                    if told is not None or source.follows_clock:  # so that none of them waits for another
                        yield source.take(await batch_of(self.context, told or []))
            elif not messages:
                for batch in self._watched([]):
                    yield batch

    def _watched(self, told: Sequence[Told]) -> Sequence[Batch]:
        """Persons in the pictures of cameras."""
        if self._watching is None:
            return ()
        now_us = to_us(datetime.now(UTC))
        # what the broker kept is from before: the clock is that of what is told
        come_us = min([now_us, *(report.stamp_us for each in told for report in each.reports)])
        boxes = [box for each in told for box in each.boxes]
        batches = self._watching.take(boxes, now_us) if boxes else self._watching.take([], come_us)
        for each in told:
            for camera, known_as in each.unseen:
                self._watching.forget(camera, known_as)
        return batches

    def _sources(self) -> dict[bool, Completeness[tuple[Told, Placement]]]:
        """Of what is stamped by its sender and what is not: two, so that neither makes the other late."""
        kinds = {each.is_stamped for each in self.settings.read}
        live = f"{self.context.source} live" if len(kinds) > 1 else None
        return {
            each: Completeness(None, self.settings.settle_s) if each else Completeness(live, None)
            for each in kinds
        }

    async def deliver(self, happenings: Sequence[Happening]) -> None:
        topic = str(self.settings.write)
        await self._link.publish([Outgoing(topic, each.cloud_event_json()) for each in happenings])

    async def look(self, seconds: float) -> Sequence[Sight]:
        """Which topics there are, by a connection beside, which takes nothing away from the bridge."""
        link = Link(self.settings.broker, identifier(self.context))
        topics: Counter[str] = Counter()
        read: set[str] = set()
        began_s = time.monotonic()
        await link.open()
        try:
            for wanted in {each.wanted for each in self.settings.read}:
                await link.subscribe(wanted, qos=0)
            with suppress(TimeoutError):
                async with asyncio.timeout(seconds):
                    async for messages in link.messages():
                        for each in messages:
                            topics[str(each.topic)] += 1
                            message = Message(str(each.topic), payload_of(each), to_us(datetime.now(UTC)))
                            if any(not told.unusable for told, _ in self._read([message])):
                                read.add(message.topic)
        finally:
            await link.close()
        looked_s = max(time.monotonic() - began_s, 0.001)
        sights = [Sight(self.settings.broker.address, "broker")]
        sights += [
            Sight(
                topic,
                "read" if topic in read else "topic",
                count / looked_s,
                "" if topic in read else "No message of it can be used.",
                "" if topic in read else "Correct the format, or narrow `topic`.",
            )
            for topic, count in sorted(topics.items())[:MOST_SIGHTS]
        ]
        if len(topics) > MOST_SIGHTS:
            sights.append(Sight(f"and {len(topics) - MOST_SIGHTS} more", "topic"))
        return sights

    def _read(
        self, messages: Sequence[Message], is_stamped: bool | None = None
    ) -> list[tuple[Told, Placement]]:
        """Each by the first format whose topic it has; only by formats that are stamped, or are not."""
        told: list[tuple[Told, Placement]] = []
        readings = list(zip(self.settings.read, self._placements, strict=True))
        for message in messages:
            reading, placement = next(
                (each for each in readings if each[0].is_about(message.topic)), (None, None)
            )
            if reading is None or placement is None or is_stamped not in (None, reading.is_stamped):
                continue
            try:
                told.append((reading.read(message), placement))
            except Unusable as error:
                told.append((Told(unusable=[error.of(message.topic)]), placement))
        return told
