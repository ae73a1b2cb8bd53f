"""Publishes the topics of a recording: with their types and QoS, and their bytes as recorded."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSDurabilityPolicy, QoSReliabilityPolicy
from rosgraph_msgs.msg import Clock

from mbd_sim.recordings.messages.cdr import Message, RecordedTopic
from mbd_sim.recordings.run.reader import Recording
from mbd_sim.ros.publishing import publishers
from mbd_sim.ros.publishing.message_types import STAMP, MessageTemplate, message_type

CLOCK = "/clock"
UNPUBLISHABLE = (ImportError, AttributeError, ValueError, LookupError, InvalidTopicNameException)
ACKNOWLEDGMENT_TIMEOUT = Duration(seconds=2)  # for the last messages to reach their subscribers


class ReplayPublishers:
    """Publishes recorded messages unchanged.

    Topic names are relative to the node's namespace and can be remapped. `/clock` is computed from the recorded
    times, unless it has been recorded. `skipped` holds the topics that are not published, with the reasons.
    """

    def __init__(
        self, node: Node, recording: Recording, on_warning: Callable[[str], None], on_end: Callable[[], None]
    ) -> None:
        self.skipped: dict[str, str] = {}
        self.latched: list[str] = []
        self.publishers: dict[str, Publisher] = {}
        self.warn, self.end = on_warning, on_end
        self._log = node.get_logger()
        self._handles = ExitStack()
        self._publish: dict[str, Callable[[bytes], None]] = {}
        for name, topic in recording.topics.items():
            try:
                self._add(node, topic)
            except UNPUBLISHABLE as error:
                self.skipped[name] = f"{topic.type or 'its type'} cannot be published here ({error})"
        self.clock_recorded = CLOCK in self.publishers
        self._publish_clock: Callable[[bytes], None] | None = None
        if not self.clock_recorded:
            self._publish_clock = self._raw_publish(node.create_publisher(Clock, CLOCK, publishers.CLOCK))
        self._clock_message = MessageTemplate(Clock(clock=STAMP))

    def inform(self, text: str) -> None:
        """Log something that is no problem."""
        self._log.info(text)

    def clock(self, time_ns: int) -> None:
        """Publish a time in ns on /clock."""
        if self._publish_clock is not None:
            self._clock_message.stamp(time_ns)
            self._publish_clock(self._clock_message.payload())

    def publish(self, message: Message) -> None:
        """Publish a recorded message."""
        publish = self._publish.get(message.topic)
        if publish is not None:
            publish(message.payload)

    def close(self) -> None:
        """Wait until the subscribers have received everything, and release the publishers."""
        for publisher in self.publishers.values():
            reliable = publisher.qos_profile.reliability == QoSReliabilityPolicy.RELIABLE
            if reliable and publisher.get_subscription_count():
                publisher.wait_for_all_acked(ACKNOWLEDGMENT_TIMEOUT)
        self._publish.clear()
        self._publish_clock = None
        self._handles.close()

    def _add(self, node: Node, topic: RecordedTopic) -> None:
        if topic.encoding != "cdr":
            raise ValueError(f"encoded as '{topic.encoding}'")
        profile = publishers.profile_of(topic.qos)
        name = topic.name if topic.name == CLOCK else topic.name.lstrip("/")
        publisher = node.create_publisher(message_type(topic.type), name, profile)
        self.publishers[topic.name] = publisher
        self._publish[topic.name] = self._raw_publish(publisher)
        if profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL:
            self.latched.append(topic.name)

    def _raw_publish(self, publisher: Publisher) -> Callable[[bytes], None]:
        """A publisher's function for serialized messages.

        `Publisher.publish` enters the publisher's handle for each message; entering it once halves the cost.
        """
        self._handles.enter_context(publisher.handle)
        publish: Callable[[bytes], None] = publisher.handle.publish_raw
        return publish
