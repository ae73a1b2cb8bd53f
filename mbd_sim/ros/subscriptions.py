"""The node's subscriptions: efforts and wrenches, each message accepted or rejected as a whole."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from mbd_sim.errors import CommandError
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.messages.topic_names import topic_names
from mbd_sim.ros import qos
from mbd_sim.ros.command_buffer import CommandBuffer
from mbd_sim.ros.wrench_buffer import WrenchBuffer, WrenchTargets

SUBSCRIBED = (
    ("~/commands", "std_msgs/msg/Float64MultiArray: an effort for each coordinate, in the order of joint_states"),
    ("joint_commands", "sensor_msgs/msg/JointState: efforts by joint name"),
    ("~/wrench/<part>[/<point>]", "geometry_msgs/msg/WrenchStamped: force and torque on a part"),
)
MAX_LENGTH = 400  # characters of a reason: names in messages may be of any length
WARNING_PERIOD = 1.0  # s between warnings of rejected messages


class Subscriptions:
    """Passes commands to the buffers, and warns of rejected messages."""

    def __init__(
        self,
        node: Node,
        mechanism: Mechanism,
        commands: CommandBuffer,
        wrenches: WrenchBuffer,
        wrench_targets: WrenchTargets,
        on_efforts: Callable[[], None],
    ) -> None:
        """Subscribe; `on_efforts` is called after efforts have been accepted.

        A wrench on `~/wrench/<part>` acts at the part's mass center, one on `~/wrench/<part>/<point>` at that point.
        """
        self.commands, self.wrenches, self._on_efforts = commands, wrenches, on_efforts
        self.last_rejection: tuple[str, CommandError] | None = None
        self._log = node.get_logger()
        self._last_warning = 0.0
        node.create_subscription(Float64MultiArray, "~/commands", self._take_by_order, qos.COMMAND)
        node.create_subscription(JointState, "joint_commands", self._take_by_name, qos.COMMAND)
        tokens = topic_names(mechanism.parts)
        for part, point in wrench_targets:
            topic = f"~/wrench/{tokens[part]}"
            if point is not None:
                topic += f"/{topic_names(mechanism.parts[part].points)[point]}"
            take = partial(self._take_wrench, topic, part, point)
            node.create_subscription(WrenchStamped, topic, take, qos.COMMAND)

    @property
    def accepted(self) -> int:
        """How many messages have been accepted."""
        return self.commands.accepted + self.wrenches.accepted

    @property
    def rejected(self) -> int:
        """How many messages have been rejected."""
        return self.commands.rejected + self.wrenches.rejected

    @property
    def expired(self) -> int:
        """How often commands stopped arriving."""
        return self.commands.expired + self.wrenches.expired

    def _take_by_order(self, message: Float64MultiArray) -> None:
        try:
            self.commands.by_order(message.data)
        except CommandError as error:
            self._reject("~/commands", error)
        else:
            self._on_efforts()

    def _take_by_name(self, message: JointState) -> None:
        try:
            self.commands.by_name(message.name, message.effort)
        except CommandError as error:
            self._reject("joint_commands", error)
        else:
            self._on_efforts()

    def _take_wrench(self, topic: str, part: str, point: str | None, message: WrenchStamped) -> None:
        force, torque = message.wrench.force, message.wrench.torque
        vectors = (force.x, force.y, force.z), (torque.x, torque.y, torque.z)
        try:
            self.wrenches.take(part, point, message.header.frame_id, *vectors)
        except CommandError as error:
            self._reject(topic, error)

    def _reject(self, topic: str, error: CommandError) -> None:
        self.last_rejection = topic, error
        now = time.monotonic()
        if now - self._last_warning >= WARNING_PERIOD:  # the logger's own throttle inspects the stack at each call
            self._last_warning = now
            self._log.warning(f"{topic}: message rejected ({self.rejected} so far): {printable(str(error))}")


def printable(reason: str) -> str:
    """A reason on one line, without control characters that a message may contain, and not longer than `MAX_LENGTH`."""
    text = reason if len(reason) <= MAX_LENGTH else f"{reason[: MAX_LENGTH // 2]} … {reason[-MAX_LENGTH // 2 :]}"
    return "".join(character if character.isprintable() else repr(character)[1:-1] for character in text)
