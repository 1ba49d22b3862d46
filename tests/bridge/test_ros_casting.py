"""Which topics of a robot are which sensors, without a robot."""

from __future__ import annotations

from semap_bridge.adapters.ros.casting import Casting
from semap_bridge.adapters.ros.settings import Ros2Settings
from semap_bridge.ros.graph import Offer

SCAN = "sensor_msgs/msg/LaserScan"


def offers(*names: str) -> list[Offer]:
    return [Offer(name, SCAN, 1) for name in names]


def test_several_scans_are_a_question_that_says_what_to_write() -> None:
    casting = Casting({}, False)
    assert not casting.look(offers("/front", "/back"))
    assert casting.trouble is not None
    assert "several topics could be the scan: /back, /front" in str(casting.trouble)
    assert "topics: {scan: [/back, /front]}" in casting.trouble.remedy
    assert "--topic" not in casting.trouble.remedy


def test_a_list_of_topics_is_several_sensors_each_as_soon_as_it_is_there() -> None:
    settings = Ros2Settings(kind="ros2", name="robot", topics={"scan": ["/front", "/back"]})
    casting = Casting(settings.topics, False)
    assert casting.look(offers("/front"))
    assert casting.parts is not None
    assert casting.parts.topics["scan"] == ("/front",)
    assert "nobody publishes /back" in str(casting.trouble)
    assert casting.look(offers("/front", "/back"))
    assert casting.parts.topics["scan"] == ("/front", "/back")
    assert casting.trouble is None


def test_one_name_is_a_list_of_one() -> None:
    assert Ros2Settings(kind="ros2", name="robot", topics={"scan": "/front"}).topics == {"scan": ("/front",)}
