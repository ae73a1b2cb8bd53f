"""Reports the derivation and compilation of a large mechanism on the console and on `~/events`."""

from __future__ import annotations

import logging
from types import TracebackType

from rclpy.node import Node
from std_msgs.msg import String

from mbd_sim.messages.topics import EVENTS
from mbd_sim.ros.topic_publisher import TopicPublisher

SOURCE = "mbd_sim"  # the logger whose messages are reported


class BuildProgress(logging.Handler):
    """While it is entered, the messages of the package's own logger appear on the console and on `~/events`.

    They are not recorded: there is no run yet.
    """

    def __init__(self, node: Node) -> None:
        super().__init__(logging.INFO)
        self._node, self._publisher = node, TopicPublisher(node, EVENTS).publisher
        self._logger = logging.getLogger(SOURCE)
        self._level = self._logger.level

    def emit(self, record: logging.LogRecord) -> None:
        """Report one message."""
        text = record.getMessage()
        self._node.get_logger().info(text)
        self._publisher.publish(String(data=text))

    def __enter__(self) -> BuildProgress:
        self._logger.addHandler(self)
        self._logger.setLevel(logging.INFO)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._logger.removeHandler(self)
        self._logger.setLevel(self._level)
        self._node.destroy_publisher(self._publisher)
