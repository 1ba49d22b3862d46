"""What Home Assistant's MQTT integration is told: devices to discover, and their states.

A device is one retained document at PREFIX/device/NODE/OBJECT/config, which names the topics of its states.
An empty one removes it. Ids are made of those of the map and its things, so that a renamed room stays the
same one; topics of states have names, percent-encoded, so that people can read them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from urllib.parse import quote
from uuid import UUID, uuid5

from semap.rules.declaration import Declaration
from semap.store.motion.live import ShownDoor, ShownTrack
from semap.timeline.stamp import rfc3339
from semap_bridge.adapter import Happening
from semap_bridge.home_assistant.house import Thing
from semap_bridge.messages.told import Unusable, read_name, read_topic

LONGEST_STATE = 255
NOBODY, NO_ROOM, AWAY = "nobody", "no room", "away"
ONLINE, OFFLINE = b"online", b"offline"
OCCUPANCY = "{{ 'ON' if value_json.count else 'OFF' }}"
COUNT = "{{ value_json.count }}"
WHO = f"{{{{ (value_json.who | join(', '))[:{LONGEST_STATE}] or '{NOBODY}' }}}}"
ATTRIBUTES_OF_WHO = "{{ {'who': value_json.who} | tojson }}"
STATE = "{{ value_json.state }}"
DOOR = "{{ {'open': 'ON', 'closed': 'OFF'}.get(value_json.state, 'None') }}"


@dataclass(frozen=True)
class Discovery:
    """How devices of one map are named.

    prefix  of Home Assistant's discovery; base: of the topics of states
    uid     of the map, hex
    """

    prefix: str
    base: str
    map_name: str
    uid: str

    @property
    def availability(self) -> str:
        return f"{self.base}/availability"

    @property
    def configs(self) -> str:
        """The topic filter of all its devices, also of those that it has no more."""
        return f"{self._node}/+/config"

    def state_topic(self, kind: str, name: str) -> str:
        return f"{self.base}/{kind}/{quote(name, safe=' ')}"

    def room(self, room: Thing) -> tuple[str, bytes]:
        """Topic and document of a room: whether somebody is in it, how many, and who."""
        topic = self.state_topic("room", room.name)
        key = f"room_{room.uid}"
        components = {
            "occupancy": {
                "platform": "binary_sensor",
                "name": "Occupancy",
                "device_class": "occupancy",
                "value_template": OCCUPANCY,
            },
            "count": {
                "platform": "sensor",
                "name": "Occupants",
                "state_class": "measurement",
                "icon": "mdi:account-group",
                "value_template": COUNT,
            },
            "who": {
                "platform": "sensor",
                "name": "Who",
                "icon": "mdi:account-question",
                "value_template": WHO,
                "json_attributes_topic": topic,
                "json_attributes_template": ATTRIBUTES_OF_WHO,
            },
        }
        device = {"name": room.label, "model": "room", "suggested_area": room.label}
        return self._config(key, device, components, topic)

    def person(self, name: str) -> tuple[str, bytes]:
        """Of a person: in which room they are."""
        topic = self.state_topic("person", name)
        components = {
            "room": {
                "platform": "sensor",
                "name": "Room",
                "icon": "mdi:map-marker-account",
                "value_template": STATE,
                "json_attributes_topic": topic,
            }
        }
        return self._config(self._key("person", name), {"name": name, "model": "person"}, components, topic)

    def door(self, door: Thing) -> tuple[str, bytes]:
        """Of a door: whether it is open."""
        components: dict[str, dict[str, object]] = {
            "door": {
                "platform": "binary_sensor",
                "name": None,
                "device_class": "door",
                "value_template": DOOR,
            }
        }
        device = {"name": door.label, "model": "door"}
        return self._config(f"door_{door.uid}", device, components, self.state_topic("door", door.name))

    def rule(self, rule: Declaration) -> tuple[str, bytes]:
        """Of a rule: its events, and why it made none last."""
        why = self.state_topic("why", rule.name)
        components: dict[str, dict[str, object]] = {
            "event": {
                "platform": "event",
                "name": rule.name,
                "event_types": sorted(set(rule.emit.values())),
                "state_topic": self.state_topic("rule", rule.name),
            },
            "why": {
                "platform": "sensor",
                "name": f"{rule.name}: why",
                "entity_category": "diagnostic",
                "icon": "mdi:comment-question-outline",
                "state_topic": why,
                "value_template": STATE,
                "json_attributes_topic": why,
            },
        }
        device = {"name": f"semap {self.map_name}", "model": "rules", "identifiers": [f"semap_{self.uid}"]}
        return self._config(self._key("rule", rule.name), device, components)

    def _key(self, kind: str, name: str) -> str:
        return f"{kind}_{uuid5(UUID(self.uid), f'{kind}/{name}').hex}"

    @property
    def _node(self) -> str:
        return f"{self.prefix}/device/semap_{self.uid}"

    def _config(
        self,
        key: str,
        device: Mapping[str, object],
        components: Mapping[str, Mapping[str, object]],
        state_topic: str | None = None,
    ) -> tuple[str, bytes]:
        unique = f"semap_{self.uid}_{key}"
        document = {
            "device": {"identifiers": [unique], "manufacturer": "semap", **device},
            "origin": {"name": "semap", "sw_version": version("semap")},
            "availability_topic": self.availability,
            "qos": 1,
            **({"state_topic": state_topic} if state_topic else {}),
            "components": {
                name: {**each, "unique_id": f"{unique}_{name}"} for name, each in components.items()
            },
        }
        return f"{self._node}/{key}/config", as_json(document)


def room_state(who: Sequence[str]) -> bytes:
    return as_json({"count": len(who), "who": list(who)})


def person_state(track: ShownTrack | None, room: Thing | None) -> bytes:
    """Of a person who is seen, in a room or in none; None: not seen any more."""
    if track is None:
        return as_json({"state": AWAY})
    label = NO_ROOM if room is None else room.label
    return as_json({"state": label[:LONGEST_STATE], "room": None if room is None else room.name})


def door_state(door: ShownDoor) -> bytes:
    return as_json({"state": door.state, "since": None if door.since is None else rfc3339(door.since)})


def event_message(happening: Happening) -> bytes:
    """What an event entity takes; `id` tells it from others, also where it comes twice."""
    event = happening.event
    said = {
        **event.measures,
        "event_type": event.type,
        "id": str(event.event_id),
        "rule": event.rule,
        "stamp": rfc3339(event.stamp),
        "since": rfc3339(event.since),
        "track": event.track_name,
        "instance": event.instance_name,
        "key": dict(event.key),
        "cause": event.cause,
        "confidence": event.confidence,
    }
    return as_json({name: value for name, value in said.items() if value is not None})


def states_named_in(config: bytes) -> list[str]:
    """The topics of states that a document names, which were retained with it."""
    try:
        document = json.loads(config)
        components = [*document["components"].values()]
        named = [document.get("state_topic"), *(each.get("state_topic") for each in components)]
        return [read_topic(each) for each in named if each]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, Unusable):
        return []


def person_named_in(config: bytes) -> str | None:
    """The name of the person whom a document is of."""
    try:
        device = json.loads(config)["device"]
        return read_name(device["name"], "name") if device["model"] == "person" else None
    except (ValueError, KeyError, TypeError, RecursionError, Unusable):
        return None


def as_json(value: object) -> bytes:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"), default=str).encode()
