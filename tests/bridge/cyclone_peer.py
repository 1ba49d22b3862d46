"""Another process of ROS 2: Cyclone's own codec and classes written by hand, nothing of semap and nothing of rosbags.

python cyclone_peer.py DOMAIN: publishes scans until somebody hears them and standard input says so, and prints the
names of nodes and the events that it hears, a JSON object a line.
"""

import json
import sys
from dataclasses import dataclass

from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, bounded_str, float32, int32, sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

CONFIG = """<CycloneDDS><Domain><General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>
<MaxAutoParticipantIndex>120</MaxAutoParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain>
</CycloneDDS>"""


@dataclass
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    stamp: Time
    frame_id: str


@dataclass
class LaserScan(IdlStruct, typename="sensor_msgs.msg.dds_.LaserScan_"):
    header: Header
    angle_min: float32
    angle_max: float32
    angle_increment: float32
    time_increment: float32
    scan_time: float32
    range_min: float32
    range_max: float32
    ranges: sequence[float32]
    intensities: sequence[float32]


@dataclass
class String(IdlStruct, typename="std_msgs.msg.dds_.String_"):
    data: str


@dataclass
class Gid(IdlStruct, typename="rmw_dds_common.msg.dds_.Gid_"):
    data: array[uint8, 16]


@dataclass
class NodeEntitiesInfo(IdlStruct, typename="rmw_dds_common.msg.dds_.NodeEntitiesInfo_"):
    node_namespace: bounded_str[256]
    node_name: bounded_str[256]
    reader_gid_seq: sequence[Gid]
    writer_gid_seq: sequence[Gid]


@dataclass
class ParticipantEntitiesInfo(IdlStruct, typename="rmw_dds_common.msg.dds_.ParticipantEntitiesInfo_"):
    gid: Gid
    node_entities_info_seq: sequence[NodeEntitiesInfo]


def main() -> None:
    number = int(sys.argv[1])
    domain = Domain(number, CONFIG)
    participant = DomainParticipant(number)
    reliable = Policy.Reliability.Reliable(duration(seconds=1))
    as_ros = Policy.DataRepresentation(use_cdrv0_representation=True)
    sensor = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(5), as_ros)
    latched = Qos(reliable, Policy.Durability.TransientLocal, Policy.History.KeepLast(100))
    scans = DataWriter(participant, Topic(participant, "rt/scan", LaserScan), sensor)
    nodes = DataReader(
        participant, Topic(participant, "ros_discovery_info", ParticipantEntitiesInfo), latched
    )
    told = DataReader(
        participant,
        Topic(participant, "rt/semap/room", String),
        Qos(reliable, Policy.Durability.TransientLocal),
    )
    ranges = [0.5 + i / 100 for i in range(7)]
    scan = LaserScan(
        Header(Time(1_700_000_000, 5), "laser"), -1.0, 1.0, 0.25, 0.0, 0.1, 0.05, 9.0, ranges, []
    )
    for asked in sys.stdin:
        if asked.strip() == "scan":
            scans.write(scan)
        heard = [each for each in nodes.take(100) if hasattr(each, "node_entities_info_seq")]
        names = [node.node_name for each in heard for node in each.node_entities_info_seq]
        gids = [bytes(each.gid.data).hex() for each in heard]
        said = {"nodes": names, "gids": gids, "rooms": [each.data for each in told.take(10)]}
        sys.stdout.write(json.dumps({**said, "listeners": len(scans.get_matched_subscriptions())}) + "\n")
        sys.stdout.flush()
    del domain


main()
