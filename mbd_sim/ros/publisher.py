"""A topic that leaves the node: its publisher, and what a recording says about it."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.qos import QoSProfile

from mbd_sim.recording.topic import Topic
from mbd_sim.ros import qos


class Output:
    """A topic of some type; messages of a `vital` one are never dropped from a recording."""

    def __init__(self, node: Node, message_type: type, name: str, profile: QoSProfile, *, vital: bool = False) -> None:
        self.publisher = node.create_publisher(message_type, name, profile)
        package, _, _ = message_type.__module__.partition(".")
        kind = f"{package}/msg/{message_type.__name__}"
        self.topic = Topic(self.publisher.topic_name, kind, qos.offered_qos_profiles(profile), vital)
