"""Robots of ROS 2 and ROS 1: what their sensors say comes in, the map, people and events go out.

`adapter` puts it together, over the topics of `semap_bridge.ros`.
"""
