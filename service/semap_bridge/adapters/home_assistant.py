"""Home Assistant, by MQTT: rooms, people, doors and rules of a map appear there by themselves, and go again.

What stands is retained and said when it changes, and all of it again when Home Assistant starts. Events are
not retained, since Home Assistant ignores those that are; one that is older than `late_s` is left out, so
that no lamp goes on for what happened yesterday. While the bridge is away, its last will says so.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from functools import partial

import psycopg
from pydantic import Field
from sqlalchemy import Connection

from semap.errors import SemapError, ServiceUnreachable
from semap.rules.declaration import Declaration
from semap.rules.explanation.explanation import Explanation
from semap.store.motion.live import LiveMap
from semap.timeline.stamp import rfc3339, to_datetime
from semap.worker.why import explain_newest
from semap_bridge import adapter
from semap_bridge.adapter import Adapter, Display, Happening, Sight, Sink
from semap_bridge.broker import Broker, Link, Outgoing, identifier, payload_of
from semap_bridge.context import Context
from semap_bridge.home_assistant.discovery import (
    OFFLINE,
    ONLINE,
    Discovery,
    as_json,
    door_state,
    event_message,
    person_named_in,
    person_state,
    room_state,
    states_named_in,
)
from semap_bridge.home_assistant.house import House, map_uid, people_of, read_house, still_there

HOUSE_S = 2.0
"""So often it is looked which rooms, doors and rules there are."""
MOST_ROWS = 20_000
MOST_LINES = 40
"""Home Assistant keeps no attributes beyond 16 kB."""


class HomeAssistantSettings(adapter.Settings):
    broker: Broker = Field(default=Broker(), description="host, port, login and tls.")
    discovery: str = Field(
        default="homeassistant", pattern=r"^[^+#\x00]+$", description="Prefix of its discovery topics."
    )
    topic: str | None = Field(
        default=None, pattern=r"^[^+#\x00]+$", description="Where states go. [default: semap/MAP]"
    )
    people: list[str] = Field(
        default=["*"], description="Which tracks are people: names, where * stands for anything."
    )
    most_people: int = Field(default=100, ge=0, description="More people than that are left out.")
    late_s: float = Field(default=60.0, gt=0, description="Events that are older are left out [s].")
    why_s: float = Field(default=10.0, gt=0, description="So often it is told why rules made no event [s].")


class HomeAssistant(Adapter[HomeAssistantSettings], Sink, Display):
    """Mutable: what was published, by topic, and which devices the broker keeps."""

    Settings = HomeAssistantSettings
    every_s = 0.25

    def __init__(self, settings: HomeAssistantSettings, context: Context) -> None:
        super().__init__(settings, context)
        self._link: Link | None = None
        self._discovery = Discovery("", "", "", "")
        self._house = House({}, {}, ())
        self._read_at_s = -HOUSE_S
        self._said: dict[str, bytes] = {}
        self._kept: dict[str, bytes] = {}
        self._people: set[str] = set()
        self._left_out: set[str] = set()
        self._is_shown = asyncio.Event()
        self._beside: list[asyncio.Task[None]] = []

    async def open(self) -> None:
        uid = await self.context.ask(partial(map_uid, map_name=self.context.map_name))
        if uid is None:
            raise ServiceUnreachable(f"The map {self.context.map_name} is gone.", "Import it again.")
        name = self.context.map_name
        base = self.settings.topic or f"semap/{name.replace('+', '%2B').replace('#', '%23')}"
        self._discovery = Discovery(self.settings.discovery, base, name, uid)
        will = Outgoing(self._discovery.availability, OFFLINE, is_retained=True)
        only_looks = self.context.only_looks
        self._link = Link(self.settings.broker, identifier(self.context), will=None if only_looks else will)
        await self._link.open()
        if only_looks:
            return
        for topic in (f"{self.settings.discovery}/status", self._discovery.configs):
            await self._link.subscribe(topic, qos=1)
        await self._link.publish([Outgoing(self._discovery.availability, ONLINE, is_retained=True)])
        self._beside = [asyncio.create_task(each) for each in (self._hear(), self._tell_why())]

    async def close(self) -> None:
        for each in self._beside:
            each.cancel()
        await asyncio.gather(*self._beside, return_exceptions=True)
        if self._link is not None:
            if self._beside:
                with suppress(ServiceUnreachable):
                    await self._publish({self._discovery.availability: OFFLINE})
            await self._link.close()

    async def deliver(self, happenings: Sequence[Happening]) -> None:
        await self._is_shown.wait()
        oldest = datetime.now(UTC) - timedelta(seconds=self.settings.late_s)
        messages = []
        for each in happenings:
            if each.event.created_at < oldest:
                self.context.refuse("event too late", f"{each.event.type} at {rfc3339(each.event.stamp)}")
            else:
                topic = self._discovery.state_topic("rule", each.event.rule)
                messages.append(Outgoing(topic, event_message(each)))
        await self._opened.publish(messages)

    async def show(self, present: LiveMap) -> None:
        for each in self._beside:
            if each.done():
                each.result()
        if time.monotonic() - self._read_at_s > HOUSE_S:
            await self._look_at_house()
        states = self._states(present)
        configs = self._configs()
        gone = self._kept.keys() - configs.keys()
        empty = [topic for each in gone for topic in (each, *states_named_in(self._kept[each]))]
        await self._publish({topic: b"" for topic in empty if topic not in states})
        for topic in gone:
            del self._kept[topic]
        await self._publish(self._news(configs))
        self._kept.update(configs)
        await self._publish(self._news(states))
        self._is_shown.set()

    async def look(self, seconds: float) -> Sequence[Sight]:
        house = await self.context.ask(partial(read_house, map_name=self.context.map_name))
        without = "" if house.rooms else "The map has no rooms."
        remedy = "" if house.rooms else "Import a building: semap map import."
        return [
            Sight(self.settings.broker.address, "broker"),
            Sight(f"{len(house.rooms)} rooms", "told of", trouble=without, remedy=remedy),
            Sight(f"{len(house.doors)} doors", "told of"),
            Sight(f"{len(house.rules)} rules", "told of"),
        ]

    async def _look_at_house(self) -> None:
        """Which rooms, doors and rules there are, and who of those that are known has a track still."""
        name = self.context.map_name
        known = {person for each in self._kept.values() if (person := person_named_in(each)) is not None}
        wanted = self._people | known
        self._house = await self.context.ask(partial(read_house, map_name=name))
        self._people = set(await self.context.ask(partial(still_there, map_name=name, names=wanted)))
        self._read_at_s = time.monotonic()

    def _states(self, present: LiveMap) -> dict[str, bytes]:
        """What stands now, by topic."""
        house, topic = self._house, self._discovery.state_topic
        people = people_of(present, self.settings.people)
        self._take_people(people.keys())
        who = house.who_is_in(present, people)
        states = {topic("room", room.name): room_state(who[each]) for each, room in house.rooms.items()}
        for name in self._people:
            track = people.get(name)
            room = None if track is None else house.room_of(track)
            states[topic("person", name)] = person_state(track, room)
        for door in present.doors.values():
            if door.instance_id in house.doors:
                states[topic("door", door.name)] = door_state(door)
        return states

    def _take_people(self, names: Iterable[str]) -> None:
        for name in names:
            if name in self._people or name in self._left_out:
                continue
            if len(self._people) < self.settings.most_people:
                self._people.add(name)
            else:
                self._left_out.add(name)
                self.context.refuse("too many people", f"{name}: say in `people` who is one")

    def _configs(self) -> dict[str, bytes]:
        told, house = self._discovery, self._house
        return dict(
            [
                *map(told.room, house.rooms.values()),
                *map(told.door, house.doors.values()),
                *map(told.rule, house.rules),
                *map(told.person, sorted(self._people)),
            ]
        )

    def _news(self, wanted: Mapping[str, bytes]) -> dict[str, bytes]:
        return {topic: payload for topic, payload in wanted.items() if self._said.get(topic) != payload}

    async def _publish(self, payloads: Mapping[str, bytes]) -> None:
        """Retained; what is empty removes what was."""
        self._said.update(payloads)  # first: who asks for all meanwhile gets it again
        await self._opened.publish([Outgoing(*each, is_retained=True) for each in payloads.items()])

    async def _hear(self) -> None:
        """What the broker keeps of devices, and when Home Assistant starts."""
        async for messages in self._opened.messages():
            for each in messages:
                topic, payload = str(each.topic), payload_of(each)
                if topic != f"{self.settings.discovery}/status":
                    if payload:
                        self._kept.setdefault(topic, payload)
                elif payload == ONLINE:
                    self._said.clear()
                    self._read_at_s = -HOUSE_S

    async def _tell_why(self) -> None:
        """Of each rule, what it made of the newest row that it read, or why it made nothing of it."""
        after_us: dict[str, int] = {}
        await self._is_shown.wait()
        while True:
            for rule in self._house.rules:
                topic = self._discovery.state_topic("why", rule.name)
                try:
                    ask = partial(_newest, self.context.map_name, rule, after_us.get(rule.name))
                    found = await self.context.ask(ask)
                except SemapError as error:
                    await self._publish(self._news({topic: as_json({"state": "unknown", "why": str(error)})}))
                    continue
                if found is not None:
                    is_open = found.near_miss is not None and found.near_miss.is_open
                    after_us[rule.name] = found.at_us - is_open
                    await self._publish(self._news({topic: why_message(found)}))
                elif topic not in self._said:
                    await self._publish({topic: as_json({"state": "nothing read"})})
            await asyncio.sleep(self.settings.why_s)

    @property
    def _opened(self) -> Link:
        if self._link is None:
            raise ServiceUnreachable("The broker is not connected.", "semap goes on by itself.")
        return self._link


def why_message(found: Explanation) -> bytes:
    """The state of a diagnostic entity, with the explanation as its attributes."""
    lines = found.as_text().splitlines()
    return as_json(
        {
            "state": "fired" if found.match is not None else "not fired",
            "at": rfc3339(to_datetime(found.at_us)),
            "key": dict(found.key),
            "why": lines[:MOST_LINES] + (["..."] if len(lines) > MOST_LINES else []),
        }
    )


def _newest(
    map_name: str, rule: Declaration, after_us: int | None, connection: Connection
) -> Explanation | None:
    driver = connection.connection.driver_connection
    assert isinstance(driver, psycopg.Connection)  # noqa: S101  (as open_engine makes it)
    return explain_newest(driver, map_name, rule, after_us, most_rows=MOST_ROWS)
