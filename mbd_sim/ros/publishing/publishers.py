"""The publishers of output topics, with their quality of service, and the classes of their messages.

Quality of service is that of the topics as rclpy has it, and that of recorded topics. Messages of constant size come
from rclpy's own message; after the first serialization only their numbers are written.
"""

from __future__ import annotations

import importlib
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
import yaml
from builtin_interfaces.msg import Time
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.serialization import serialize_message

from mbd_sim.base.geometry.pose import Array
from mbd_sim.recordings.messages import definitions
from mbd_sim.recordings.messages.cdr import FieldPlace, SerializedMessage
from mbd_sim.recordings.messages.definitions import OfferedQos, Topic, offered_qos_profiles
from mbd_sim.recordings.messages.topics import OutputTopic, is_vital


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


def message_type(name: str) -> type:
    """The class of a type such as `std_msgs/msg/String`.

    :raises ImportError, AttributeError: it is not installed.
    :raises ValueError: the name is not that of a type.
    """
    package, _, kind = name.partition("/")
    kind = kind.rpartition("/")[2]
    if not package or not kind:
        raise ValueError(f"'{name}' is not the name of a message type.")
    found: type = getattr(importlib.import_module(f"{package}.msg"), kind)
    return found


STAMP = Time(sec=0x5A3C96E1, nanosec=0x2D87F14B)  # a placeholder for the time of each message


def slot(number: int) -> float:
    """A placeholder for the first double of a slot, unique for each slot number."""
    return -1.5e300 * (1.0 + number * 2.0**-40)


class MessageTemplate(SerializedMessage):
    """A serialized message of rclpy, with views into the bytes that change."""

    def __init__(self, message: Any) -> None:
        """Serialize a message in which `STAMP` and `slot` values mark the values that are written later."""
        data = bytearray(serialize_message(message))
        words = np.frombuffer(data, dtype=np.uint32, count=len(data) // 4)
        stamps = 4 * np.flatnonzero((words[:-1] == STAMP.sec) & (words[1:] == STAMP.nanosec))
        super().__init__(data, stamps.tolist())

    def doubles(self, number: int, count: int) -> Array:
        """A writable view (count,) of the message's doubles from `slot(number)` on."""
        offset = self._data.find(struct.pack("=d", slot(number))) if count else 0
        return self.view(FieldPlace(offset, count))
