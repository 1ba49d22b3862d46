"""Topics of ROS 2 and ROS 1, for all who connect robots.

A `graph` is how to reach topics: `dds` for ROS 2, without ROS; `master` for ROS 1, by a process of its own.
All else is the same for both: messages are bytes, which `message` reads and writes.
"""
