"""The publisher of an output topic."""

from __future__ import annotations

from rclpy.node import Node

from mbd_sim.messages.qos import offered_qos_profiles
from mbd_sim.messages.recorded_topic import Topic
from mbd_sim.messages.topics import OutputTopic, is_vital
from mbd_sim.ros import qos
from mbd_sim.ros.message_types import message_type


class TopicPublisher:
    """An output topic of a node: its publisher, and its description for a recorder."""

    def __init__(self, node: Node, topic: OutputTopic) -> None:
        """Create the publisher.

        :raises ImportError: the package of the message type is not installed.
        """
        self.topic = topic
        self.publisher = node.create_publisher(_installed_type(topic), topic.name, qos.profile(topic.qos))

    def recorded_topic(self) -> Topic:
        """The topic as a recording describes it."""
        topic = self.topic
        profiles = offered_qos_profiles(topic.qos)
        return Topic(self.publisher.topic_name, topic.message_type, profiles, is_vital(topic))


def _installed_type(topic: OutputTopic) -> type:
    try:
        return message_type(topic.message_type)
    except ImportError as error:
        package = topic.message_type.partition("/")[0]
        cause = f"parameter '{topic.parameter.name}'" if topic.parameter else f"topic '{topic.name}'"
        raise ImportError(f"{cause}: {package} is not installed. Install it, or omit the parameter.") from error
