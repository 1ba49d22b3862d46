"""What those who connect to the server want, and what they publish for the others.

Where it is allowed, programs publish topics of their own: this is how scans, images and boxes in them come to
the app, from whoever has them, such as a node of a robot or Foxglove's own bridge.
"""

from __future__ import annotations

from threading import Lock

from foxglove import Channel, Context, Schema
from foxglove.websocket import ChannelView, Client, ClientChannel, ServerListener

from semap_bridge import context as bridge
from semap_bridge.adapters.foxglove.channels import OWN_TOPICS

MOST_TOPICS = 200
LONGEST_TOPIC = 200
"""Of what programs publish."""

Published = tuple[int, int]
"""A client, and its number for a topic."""


class Listening(ServerListener):
    """Mutable: topics newly asked for, and what is published. The server's threads call it."""

    def __init__(self, scene: Context, told: bridge.Context, *, relay: bool) -> None:
        self._scene = scene
        self._told = told
        self._relay = relay
        self._lock = Lock()
        self._wanted: set[str] = set()
        self._published: dict[Published, Channel] = {}
        self._by_topic: dict[str, Published] = {}

    def newly_wanted(self) -> set[str]:
        """Topics that somebody subscribed to since this was asked last."""
        with self._lock:
            wanted, self._wanted = self._wanted, set()
        return wanted

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        with self._lock:
            self._wanted.add(channel.topic)

    def on_client_advertise(self, client: Client, channel: ClientChannel) -> None:
        key = (client.id, channel.id)
        with self._lock:
            reason = self._wrong(key, channel.topic)
            if not reason:
                try:
                    self._published[key] = self._channel(channel)
                    self._by_topic[channel.topic] = key
                except (RuntimeError, TypeError, ValueError) as error:
                    reason = f"a topic that cannot be passed on: {error}"
        if reason:
            self._told.refuse(reason, channel.topic[:LONGEST_TOPIC])

    def on_client_unadvertise(self, client: Client, client_channel_id: int) -> None:
        key = (client.id, client_channel_id)
        with self._lock:
            channel = self._published.pop(key, None)
            if channel is not None:
                self._by_topic.pop(channel.topic(), None)
        if channel is not None:
            channel.close()

    def on_message_data(self, client: Client, client_channel_id: int, data: bytes) -> None:
        channel = self._published.get((client.id, client_channel_id))
        if channel is not None:
            channel.log(data)

    def _channel(self, channel: ClientChannel) -> Channel:
        schema = Schema(
            name=channel.schema_name, encoding=channel.schema_encoding or "", data=channel.schema or b""
        )
        return Channel(channel.topic, schema=schema, message_encoding=channel.encoding, context=self._scene)

    def _wrong(self, key: Published, topic: str) -> str:
        """Why a topic is not passed on; empty: it is."""
        if not self._relay:
            return "a topic published without relay: true"
        if topic in OWN_TOPICS or not 0 < len(topic) <= LONGEST_TOPIC:
            return "a topic of semap's own, or without a usable name"
        if topic in self._by_topic or key in self._published:
            return "a topic that is published already"
        return "" if len(self._published) < MOST_TOPICS else f"more than {MOST_TOPICS} topics"
