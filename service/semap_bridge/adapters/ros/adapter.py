"""The adapters of robots: a node that hears sensors and tells of the map, people and events."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Sequence
from typing import ClassVar, TypeVar

from semap_ingest.recording.decoding import DECODERS

from semap_bridge import adapter
from semap_bridge.adapter import Adapter, Display, Sight, Sink, Source
from semap_bridge.adapters.ros.casting import CLOUD, CLOUD_REMEDY
from semap_bridge.adapters.ros.senses import Senses
from semap_bridge.adapters.ros.settings import Ros1Settings, Ros2Settings, RosSettings
from semap_bridge.adapters.ros.telling import Telling
from semap_bridge.context import Context
from semap_bridge.ros.graph import Graph

S = TypeVar("S", bound=RosSettings)


class Ros(Adapter[S]):
    """A node of a graph of either kind."""

    def __init__(self, settings: S, context: Context) -> None:
        super().__init__(settings, context)
        self._graph: Graph | None = None
        self._senses: Senses | None = None
        self._telling: Telling | None = None

    async def open(self) -> None:
        node = re.sub(r"\W", "_", f"semap_{self.settings.name}", flags=re.ASCII)
        graph = self._graph = await self.context.in_thread(lambda: self.settings.graph(node))
        if self.settings.sense:
            self._senses = Senses(self.settings, self.context, graph)
        if self.settings.tell:
            self._telling = await self.context.in_thread(lambda: Telling(self.settings, self.context, graph))

    async def close(self) -> None:
        if self._senses is not None:
            await self.context.in_thread(self._senses.stop)
        if self._graph is not None:
            await self.context.in_thread(self._graph.close)

    def source(self) -> Source | None:
        return self._senses

    def sink(self) -> Sink | None:
        return self._telling if "events" in self.settings.tell else None

    def display(self) -> Display | None:
        return self._telling if set(self.settings.tell) - {"events"} else None

    async def look(self, seconds: float) -> Sequence[Sight]:
        graph, senses = self._graph, self._senses
        if graph is None:
            return ()
        await asyncio.sleep(seconds)
        offers = await self.context.in_thread(graph.offers)
        if senses is None:
            return [Sight(each.topic, each.type) for each in offers]
        heard = {each.topic for each in senses.casting.wanted()}
        several = senses.casting.several(offers)
        sights = []
        for each in offers:
            rate = senses.rate_hz(each.topic) if each.topic in heard else None
            trouble, remedy = "", ""
            if each.topic in several:
                trouble, remedy = (
                    several[each.topic],
                    "Let one sensor publish it, or name another in `topics`.",
                )
            elif each.topic in heard and not senses.is_heard(each.topic):
                trouble, remedy = (
                    "Nothing came.",
                    "See that its publisher runs, and look longer: --seconds 30.",
                )
            elif each.type == CLOUD and not senses.casting.has_sensor():
                trouble, remedy = "It is not read.", CLOUD_REMEDY
            if each.topic in heard or each.type in DECODERS:
                sights.append(Sight(each.topic, each.type, rate, trouble, remedy))
        return [*sights, *self._why_nothing(senses)]

    def _why_nothing(self, senses: Senses) -> list[Sight]:
        """What keeps sensors from being understood."""
        found = []
        trouble = senses.casting.trouble
        if trouble is not None:
            found.append(Sight("sensors", trouble=str(trouble), remedy=trouble.remedy))
        perception = senses.perception
        if perception is not None:
            known = ", ".join(sorted(perception.frames)) or "none"
            remedy = f"Publish that transform, or correct `frame`; transforms name {known}."
            found += [
                Sight(f"transform of {source}", frame, trouble=why, remedy=remedy)
                for (source, frame, _), why in perception.reasons.items()
            ]
        return found


class Ros2(Ros[Ros2Settings]):
    """Reached by DDS; no ROS is needed on this machine."""

    Settings: ClassVar[type[adapter.Settings]] = Ros2Settings


class Ros1(Ros[Ros1Settings]):
    """Reached by rospy, in a process of its own."""

    Settings: ClassVar[type[adapter.Settings]] = Ros1Settings
