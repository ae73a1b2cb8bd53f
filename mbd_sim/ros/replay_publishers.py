"""The topics of a recording as publishers: their types, their QoS, their bytes as they were recorded."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from contextlib import ExitStack

from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSDurabilityPolicy, QoSReliabilityPolicy
from rosgraph_msgs.msg import Clock

from mbd_sim.recording.reader import Recording
from mbd_sim.recording.recorded_file import Message, RecordedTopic
from mbd_sim.ros import qos
from mbd_sim.ros.message_template import STAMP, Template

CLOCK = "/clock"
UNPUBLISHABLE = (ImportError, AttributeError, ValueError, LookupError, InvalidTopicNameException)
ARRIVAL = Duration(seconds=2)  # that the last messages get to reach those who listen


class ReplayTopics:
    """Publishes recorded messages as they are.

    Names are taken relative to the node's namespace, and can be remapped. `/clock` is told from the recorded times, or
    is the recorded one where there is one. `skipped` says which topics are left out, and why.
    """

    def __init__(self, node: Node, recording: Recording, tell: Callable[[str], None], end: Callable[[], None]) -> None:
        self.skipped: dict[str, str] = {}
        self.latched: list[str] = []
        self.publishers: dict[str, Publisher] = {}
        self.tell, self.end = tell, end
        self._open = ExitStack()
        self._publish: dict[str, Callable[[bytes], None]] = {}
        for name, topic in recording.topics.items():
            try:
                self._add(node, topic)
            except UNPUBLISHABLE as error:
                self.skipped[name] = f"{topic.type or 'its type'} cannot be published here ({error})"
        self.clock_recorded = CLOCK in self.publishers
        self._clock: Callable[[bytes], None] | None = None
        if not self.clock_recorded:
            self._clock = self._raw(node.create_publisher(Clock, CLOCK, qos.CLOCK))
        self._clock_message = Template(Clock(clock=STAMP))

    def clock(self, time_ns: int) -> None:
        """Publish a time in ns on /clock."""
        if self._clock is not None:
            self._clock_message.stamp(time_ns)
            self._clock(self._clock_message.payload())

    def show(self, message: Message) -> None:
        """Publish a message."""
        publish = self._publish.get(message.topic)
        if publish is not None:
            publish(message.payload)

    def close(self) -> None:
        """Wait until those who listen have what was published, and let go of the publishers."""
        for publisher in self.publishers.values():
            if (
                publisher.get_subscription_count()
                and publisher.qos_profile.reliability == QoSReliabilityPolicy.RELIABLE
            ):
                publisher.wait_for_all_acked(ARRIVAL)
        self._publish.clear()
        self._clock = None
        self._open.close()

    def _add(self, node: Node, topic: RecordedTopic) -> None:
        if topic.encoding != "cdr":
            raise ValueError(f"encoded as '{topic.encoding}'")
        profile = qos.profile_of(topic.qos)
        name = topic.name if topic.name == CLOCK else topic.name.lstrip("/")
        publisher = node.create_publisher(message_type(topic.type), name, profile)
        self.publishers[topic.name] = publisher
        self._publish[topic.name] = self._raw(publisher)
        if profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL:
            self.latched.append(topic.name)

    def _raw(self, publisher: Publisher) -> Callable[[bytes], None]:
        """Entered once, what `Publisher.publish` enters for each message: that halves the time that one takes."""
        self._open.enter_context(publisher.handle)
        publish: Callable[[bytes], None] = publisher.handle.publish_raw
        return publish


def message_type(name: str) -> type:
    """The class of a type such as `std_msgs/msg/String`.

    :raises ImportError, AttributeError, ValueError: it is not installed, or no name of a type.
    """
    package, _, kind = name.partition("/")
    kind = kind.rpartition("/")[2]
    if not package or not kind:
        raise ValueError(f"'{name}' is no name of a type")
    found: type = getattr(importlib.import_module(f"{package}.msg"), kind)
    return found
