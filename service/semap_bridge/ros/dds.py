"""The graph of ROS 2 by DDS, without ROS.

Topics are found by DDS's own discovery, and subscribed to as weakly as their weakest publisher offers, as
rosbag2 does, so that every publisher is heard. The node is told of in `ros_discovery_info`, as ROS 2 since
Iron reads it.
"""

from __future__ import annotations

import threading
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from functools import cache
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import DDSException, InstanceState, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.internal import InvalidSample
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from semap.errors import ServiceUnreachable
from semap_bridge.ros.graph import Graph, Heard, Offer, Publisher
from semap_bridge.ros.idl_type import idl_type, ros_name
from semap_bridge.ros.message import MALFORMED, Messages, messages

DISCOVERY = "ros_discovery_info"
ENTITIES = "rmw_dds_common/msg/ParticipantEntitiesInfo"
RMW = {
    "rmw_dds_common/msg/Gid": "uint8[16] data",
    "rmw_dds_common/msg/NodeEntitiesInfo": (
        "string<=256 node_namespace\nstring<=256 node_name\nGid[] reader_gid_seq\nGid[] writer_gid_seq"
    ),
    ENTITIES: "Gid gid\nNodeEntitiesInfo[] node_entities_info_seq",
}
PREFIX = "rt/"
"""Of topics of ROS among those of DDS."""
MOST = 100_000
KEPT = 1000
"""Messages that a writer keeps for readers that are slow."""
ANY = SampleState.Any | ViewState.Any
RELIABLE = Policy.Reliability.Reliable(duration(milliseconds=100))
CDR = Policy.DataRepresentation(use_cdrv0_representation=True)


class Dds(Graph):
    """Mutable: readers, writers, and what is told of them."""

    is_ros1 = False

    def __init__(self, domain: int, node: str, network: str | None = None) -> None:
        """network: see `network_config`; raises ServiceUnreachable"""
        self._messages = messages(is_ros1=False)
        self._rmw = _entity_messages()
        self._node = node
        self._domain = _configured(domain, network)
        try:
            self._participant = DomainParticipant(domain, Qos(Policy.Userdata(b"enclave=/;")))
            self._publications = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
            self._is_there = ReadCondition(self._publications, ANY | InstanceState.Alive)
            latched = Qos(RELIABLE, Policy.Durability.TransientLocal, Policy.History.KeepLast(1), CDR)
            kept = Qos(RELIABLE, Policy.Durability.TransientLocal, Policy.History.KeepLast(MOST), CDR)
            self._entity_type = idl_type(self._rmw.store, ENTITIES)
            discovery = Topic(self._participant, DISCOVERY, self._entity_type)
            self._entities = DataReader(self._participant, discovery, kept)
            self._told = DataWriter(self._participant, discovery, latched)
        except DDSException as error:
            raise _unreachable(error) from error
        self._lock = threading.Lock()
        self._nodes: dict[bytes, str] = {}
        self._readers: dict[str, tuple[Offer, DataReader[Any]]] = {}
        self._conditions: list[ReadCondition] = []
        self._writers: list[DataWriter[Any]] = []
        self._wait = WaitSet(self._participant)
        self._tell()

    @property
    def guid(self) -> bytes:
        """By which others know it."""
        return bytes(self._participant.guid.bytes)

    def offers(self) -> Sequence[Offer]:
        own = self._participant.guid
        self._learn_nodes()
        found: dict[tuple[str, str], list[Any]] = {}
        for each in self._publications.read(MOST, condition=self._is_there):
            if each.participant_key != own and (each.topic_name or "").startswith(PREFIX):
                found.setdefault((each.topic_name, each.type_name), []).append(each)
        return [self._offer(*key, every) for key, every in sorted(found.items())]

    def hear(self, offers: Collection[Offer]) -> None:
        wanted = {each.topic: each for each in offers if self.knows(each.type)}
        now = {topic: _way(offer) for topic, (offer, _) in self._readers.items()}
        if now == {topic: _way(offer) for topic, offer in wanted.items()}:
            return
        wait = WaitSet(self._participant)
        readers, conditions = {}, []
        for topic, offer in wanted.items():
            kept = self._readers.get(topic)
            if kept is None or _way(kept[0]) != _way(offer):
                kept = offer, self._reader(offer)
            readers[topic] = kept
            conditions.append(ReadCondition(kept[1], ANY | InstanceState.Any))
            wait.attach(conditions[-1])
        self._readers, self._conditions, self._wait = readers, conditions, wait
        self._tell()

    def take(self, wait_s: float) -> Sequence[Heard]:
        with suppress(DDSException):  # a reader may just be gone
            self._wait.wait(duration(seconds=wait_s))
        heard = []
        for topic, (offer, reader) in self._readers.items():
            taken = reader.take(MOST)
            # what a weak publisher sent in vain; nothing is driven out here, as DDS would not count it
            self.lost += reader.get_sample_lost_status().total_count_change  # type: ignore[no-untyped-call]
            for each in taken:
                if not isinstance(each, InvalidSample):
                    sent_us = each.sample_info.source_timestamp // 1000
                    heard.append(Heard(topic, offer.type, "", each.raw, sent_us))
        return heard

    def knows(self, type_name: str) -> bool:
        return type_name in self._messages.store.fielddefs

    def publish(self, topic: str, type_name: str, *, is_latched: bool = False) -> Publisher:
        durability = Policy.Durability.TransientLocal if is_latched else Policy.Durability.Volatile
        qos = Qos(RELIABLE, durability, Policy.History.KeepLast(1 if is_latched else KEPT), CDR)
        writer = DataWriter(self._participant, self._topic(PREFIX + topic.lstrip("/"), type_name), qos)
        self._writers.append(writer)
        self._tell()
        return _Writer(writer)

    def close(self) -> None:
        """With the participant all that it has ends, whoever still knows of it."""
        self._participant.__del__()
        self._readers.clear()
        self._writers.clear()

    def _topic(self, name: str, type_name: str) -> Topic[Any]:
        return Topic(self._participant, name, idl_type(self._messages.store, type_name))

    def _reader(self, offer: Offer) -> DataReader[Any]:
        qos = Qos(
            RELIABLE if offer.is_reliable else Policy.Reliability.BestEffort,
            Policy.Durability.TransientLocal if offer.is_latched else Policy.Durability.Volatile,
            Policy.History.KeepAll,
        )
        return DataReader(self._participant, self._topic(PREFIX + offer.topic[1:], offer.type), qos)

    def _offer(self, topic: str, type_name: str, every: Sequence[Any]) -> Offer:
        known = (self._nodes.get(each.key.bytes) for each in every)
        return Offer(
            "/" + topic.removeprefix(PREFIX),
            ros_name(type_name),
            len(every),
            tuple(sorted({name for name in known if name})),
            is_reliable=all(
                isinstance(each.qos[Policy.Reliability], Policy.Reliability.Reliable) for each in every
            ),
            is_latched=all(each.qos[Policy.Durability] == Policy.Durability.TransientLocal for each in every),
        )

    def _learn_nodes(self) -> None:
        for each in self._entities.take(MOST):
            if isinstance(each, InvalidSample):
                continue
            with suppress(*MALFORMED):  # releases before Iron write it otherwise
                told = self._rmw.read(each.raw, ENTITIES)
                for node in told.node_entities_info_seq:
                    name = f"{node.node_namespace.rstrip('/')}/{node.node_name}"
                    self._nodes.update((gid.data.tobytes(), name) for gid in node.writer_gid_seq)

    def _tell(self) -> None:
        """Say to others of ROS which node has which readers and writers."""
        with self._lock:
            node = self._rmw.new(
                "rmw_dds_common/msg/NodeEntitiesInfo",
                node_namespace="/",
                node_name=self._node,
                reader_gid_seq=self._gids(reader for _, reader in self._readers.values()),
                writer_gid_seq=self._gids(self._writers),
            )
            participant, *_ = self._gids([self._participant])
            said = self._rmw.new(ENTITIES, gid=participant, node_entities_info_seq=[node])
            self._told.write(self._entity_type(self._rmw.write(said)))

    def _gids(self, entities: Iterable[Any]) -> list[Any]:
        return [
            self._rmw.new("rmw_dds_common/msg/Gid", data=np.frombuffer(each.guid.bytes, np.uint8))
            for each in entities
        ]


class _Writer(Publisher):
    def __init__(self, writer: DataWriter[Any]) -> None:
        self._writer = writer

    def send(self, raw: bytes, sent_us: int | None = None) -> None:
        try:
            self._writer.write(self._writer.data_type(raw), None if sent_us is None else sent_us * 1000)
        except DDSException as error:
            raise _unreachable(error) from error

    def listeners(self) -> int:
        return len(self._writer.get_matched_subscriptions())


def network_config(interface: str | None, peers: Sequence[str]) -> str | None:
    """Cyclone's configuration where not the environment's is meant (CYCLONEDDS_URI).

    interface  address or name of the network that is used
    peers      machines, where multicast does not reach them
    """
    if interface is None and not peers:
        return None
    kind = "address" if interface is not None and interface[0].isdigit() else "name"
    chosen = "" if interface is None else (
        f"<Interfaces><NetworkInterface {kind}={quoteattr(interface)}/></Interfaces>"
    )  # fmt: skip
    if interface == "127.0.0.1":
        peers = [*peers, interface]
    named = "".join(f"<Peer address={quoteattr(each)}/>" for each in peers)
    found = (
        f"<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>120"
        f"</MaxAutoParticipantIndex><Peers>{named}</Peers></Discovery>"
        if peers
        else ""
    )
    multicast = "<AllowMulticast>false</AllowMulticast>" if interface == "127.0.0.1" else ""
    return f"<CycloneDDS><Domain><General>{chosen}{multicast}</General>{found}</Domain></CycloneDDS>"


@cache
def _entity_messages() -> Messages:
    """By which nodes know each other, as ROS 2 Iron and later define them."""
    store = get_typestore(Stores.EMPTY)
    for name, text in RMW.items():
        store.register(get_types_from_msg(text, name))
    return Messages(store, is_ros1=False)


def _configured(domain: int, config: str | None) -> Domain | None:
    """The domain of this process, where the settings say how it reaches others; else the environment does."""
    if config is None:
        return None
    try:
        return Domain(domain, config)
    except DDSException as error:
        if error.code == DDSException.DDS_RETCODE_PRECONDITION_NOT_MET:
            return None  # this process has one already
        raise _unreachable(error) from error


def _way(offer: Offer) -> tuple[str, bool, bool]:
    """How a topic is subscribed to."""
    return offer.type, offer.is_reliable, offer.is_latched


def _unreachable(error: DDSException) -> ServiceUnreachable:
    return ServiceUnreachable(
        f"DDS cannot be used: {error.msg or error}",
        "See that `interface` is one of this machine, and what CYCLONEDDS_URI says.",
    )
