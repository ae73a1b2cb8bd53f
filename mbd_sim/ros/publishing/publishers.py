"""The publishers of output topics, with their quality of service.

Quality of service is that of the topics as rclpy has it, and that of recorded topics.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy

from mbd_sim.recordings.messages import definitions
from mbd_sim.recordings.messages.definitions import OfferedQos, Topic, offered_qos_profiles
from mbd_sim.recordings.messages.topics import OutputTopic, is_vital
from mbd_sim.ros.publishing.message_types import message_type


def profile(offered: OfferedQos) -> QoSProfile:
    """A publisher's profile as rclpy has it."""
    return QoSProfile(
        depth=offered.depth,
        history=QoSHistoryPolicy.KEEP_ALL if offered.keep_all else QoSHistoryPolicy.KEEP_LAST,
        reliability=QoSReliabilityPolicy.RELIABLE if offered.reliable else QoSReliabilityPolicy.BEST_EFFORT,
        durability=QoSDurabilityPolicy.TRANSIENT_LOCAL if offered.latched else QoSDurabilityPolicy.VOLATILE,
    )


FOLLOWED_CLOCK = QoSProfile(depth=1, reliability=QoSReliabilityPolicy.BEST_EFFORT)  # fits every publisher
STATE, CLOCK, COMMAND = profile(definitions.STATE), profile(definitions.CLOCK), profile(definitions.COMMAND)
COMMAND_BEST_EFFORT = QoSProfile(depth=COMMAND.depth, reliability=QoSReliabilityPolicy.BEST_EFFORT)


def profile_of(text: str) -> QoSProfile:
    """The profile to offer for a recorded topic, from the profiles of its publishers in rosbag2's YAML.

    Values may be words or numbers. Of several publishers the strongest offer counts, which suits every subscription.
    Unknown values, such as the history over DDS, become: ten messages, reliable, volatile.
    """
    offers = [offer for offer in _load_offers(text) if isinstance(offer, Mapping)]
    first: Mapping[str, Any] = offers[0] if offers else {}
    best_effort = bool(offers) and all(offer.get("reliability") in ("best_effort", 2) for offer in offers)
    latched = any(offer.get("durability") in ("transient_local", 1) for offer in offers)
    depths = [depth for offer in offers if isinstance(depth := offer.get("depth"), int) and depth > 0]
    profile = QoSProfile(
        depth=max(depths, default=STATE.depth),
        history=QoSHistoryPolicy.KEEP_ALL if first.get("history") in ("keep_all", 2) else QoSHistoryPolicy.KEEP_LAST,
        reliability=QoSReliabilityPolicy.BEST_EFFORT if best_effort else QoSReliabilityPolicy.RELIABLE,
        durability=QoSDurabilityPolicy.TRANSIENT_LOCAL if latched else QoSDurabilityPolicy.VOLATILE,
    )
    for name in ("deadline", "lifespan"):
        if (duration := _duration(first.get(name))) is not None:
            setattr(profile, name, duration)
    return profile


def _load_offers(text: str) -> list[Any]:
    try:
        found = yaml.safe_load(text)
    except yaml.YAMLError:
        return []
    return found if isinstance(found, list) else []


def _duration(value: Any) -> Duration | None:
    """A finite, positive duration; None for zero, infinity and anything else."""
    if not isinstance(value, Mapping):
        return None
    seconds, nanoseconds = value.get("sec", 0), value.get("nsec", 0)
    if (
        not (isinstance(seconds, int) and isinstance(nanoseconds, int))
        or seconds >= 1 << 31
        or seconds + nanoseconds <= 0
    ):
        return None
    return Duration(seconds=seconds, nanoseconds=nanoseconds)


class TopicPublisher:
    """An output topic of a node: its publisher, and its description for a recorder."""

    def __init__(self, node: Node, topic: OutputTopic) -> None:
        """Create the publisher.

        :raises ImportError: the package of the message type is not installed.
        """
        self.topic = topic
        self.publisher = node.create_publisher(_installed_type(topic), topic.name, profile(topic.qos))

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
