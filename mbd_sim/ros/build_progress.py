"""Says on the console and on `~/events` what the start of a node does, if that takes more than a second."""

from __future__ import annotations

import logging
import threading
import time
from types import TracebackType

from rclpy.node import Node
from std_msgs.msg import String

from mbd_sim.messages.topics import EVENTS
from mbd_sim.ros.topic_publisher import TopicPublisher

SOURCE = "mbd_sim"  # the logger whose messages are reported
PATIENCE, PERIOD = 1.0, 5.0  # s until the first report, and between those that follow


class BuildProgress(logging.Handler):
    """While it is entered, what is being done, and for how long so far, appears on the console and on `~/events`.

    The package's own logger says what is being done; its messages of the level INFO appear at once. They are not
    recorded: there is no run yet.
    """

    def __init__(self, node: Node, first: str) -> None:
        """`first` is what is done at first, such as "reading robot.urdf"."""
        super().__init__(logging.DEBUG)
        self._node, self._publisher = node, TopicPublisher(node, EVENTS).publisher
        self._logger = logging.getLogger(SOURCE)
        self._level = self._logger.level
        self._doing, self._ended = first, threading.Event()
        self._began = self._said = time.monotonic()
        self._thread = threading.Thread(target=self._report, daemon=True, name="progress")

    def emit(self, record: logging.LogRecord) -> None:
        """Note a message, and say it if it is important."""
        text = record.getMessage()
        if record.levelno >= logging.INFO:
            self._say(text)
        else:
            self._doing = text

    def _say(self, text: str) -> None:
        self._said = time.monotonic()
        self._node.get_logger().info(text)
        self._publisher.publish(String(data=text))

    def _report(self) -> None:
        wait = PATIENCE
        while not self._ended.wait(wait):
            now = time.monotonic()
            if now - self._said >= wait:
                self._say(f"{self._doing}: {now - self._began:.0f} s so far")
            wait = self._said + PERIOD - time.monotonic()

    def __enter__(self) -> BuildProgress:
        self._logger.addHandler(self)
        self._logger.setLevel(logging.DEBUG)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()
        self._logger.removeHandler(self)
        self._logger.setLevel(self._level)
        if kind is None and (elapsed := time.monotonic() - self._began) >= PATIENCE:
            self._say(f"done after {elapsed:.1f} s")
        self._node.destroy_publisher(self._publisher)
