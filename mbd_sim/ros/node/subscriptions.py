"""The node's subscriptions: efforts, commands and wrenches, each message accepted or rejected as a whole."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped, WrenchStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from mbd_sim.base.errors import CommandError, require_each_once
from mbd_sim.mechanism.elements.actuators import Base
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.recordings.messages.definitions import topic_names
from mbd_sim.recordings.messages.events import RunClock
from mbd_sim.ros.commands.command_buffer import CommandBuffer
from mbd_sim.ros.commands.trajectory_player import Trajectory, TrajectoryPoint
from mbd_sim.ros.commands.wrenches import WrenchBuffer, WrenchTargets
from mbd_sim.ros.publishing.publishers import COMMAND, COMMAND_BEST_EFFORT
from mbd_sim.simulation.run.changes import StateValues

SET_STATE, ACTUATORS, TRAJECTORY = "~/set_state", "~/actuator_commands", "joint_trajectory"
JOINT_COMMANDS = "joint_commands"
CMD_VEL = "cmd_vel"
LAB = "the lab's page"
SUBSCRIBED = (
    ("~/commands", "std_msgs/msg/Float64MultiArray: an effort for each coordinate, in the order of joint_states"),
    (JOINT_COMMANDS, "sensor_msgs/msg/JointState: efforts, positions and velocities by joint name"),
    (ACTUATORS, "std_msgs/msg/Float64MultiArray: a command for each channel of the actuators, in their order"),
    (TRAJECTORY, "trajectory_msgs/msg/JointTrajectory: motions of joints whose actuators take positions"),
    ("[<base>/]cmd_vel", "geometry_msgs/msg/Twist, or TwistStamped with stamped_cmd_vel: velocity of a base on wheels"),
    (SET_STATE, "sensor_msgs/msg/JointState: positions and velocities by joint name"),
    ("~/wrench/<part>[/<point>]", "geometry_msgs/msg/WrenchStamped: force and torque on a part"),
)
MAX_LENGTH = 400  # characters of a reason: names in messages may be of any length
WARNING_PERIOD = 1.0  # s between warnings of rejected messages on a topic


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
        on_state: Callable[[StateValues], str],
        warn: Callable[[str], None],
        clock: RunClock,
        stamped_cmd_vel: bool = False,
    ) -> None:
        """Subscribe; `on_efforts` is called after commands have been accepted. `clock` is that of stamps.

        With `stamped_cmd_vel`, velocities of bases come with a header, which has no effect.

        `on_state` sets positions and speeds and returns the problem, or ""; `warn` reports one as an event.

        A wrench on `~/wrench/<part>` acts at the part's mass center, one on `~/wrench/<part>/<point>` at that point.
        """
        self.commands, self.wrenches, self._on_efforts = commands, wrenches, on_efforts
        self._on_state, self._warn = on_state, warn
        self.states_accepted = self.states_rejected = 0
        self.last_rejection: tuple[str, CommandError] | None = None
        self._log = node.get_logger()
        self._last_warnings: dict[str, float] = {}  # by topic, s of the steady clock
        self._node, self._subscriptions = node, dict[str, Subscription]()
        for message_type, name, take in (
            (Float64MultiArray, "~/commands", lambda message: commands.by_order(message.data)),
            (
                JointState,
                JOINT_COMMANDS,
                lambda message: commands.by_name(message.name, message.effort, message.position, message.velocity),
            ),
            (Float64MultiArray, ACTUATORS, lambda message: commands.actuators_by_order(message.data)),
            (
                JointTrajectory,
                TRAJECTORY,
                lambda message: commands.follow(trajectory_of(message), clock.ns, clock.zero_ns),
            ),
        ):
            self._subscribe(message_type, name, partial(self._take_command, name, take))
        self._subscribe(JointState, SET_STATE, self._take_state)
        tokens = topic_names(base.name for base in mechanism.bases)
        for base in mechanism.bases:
            topic = CMD_VEL if len(mechanism.bases) == 1 else f"{tokens[base.name]}/{CMD_VEL}"
            take = partial(self._take_command, topic, partial(self._move, base))
            self._subscribe(TwistStamped if stamped_cmd_vel else Twist, topic, take)
        tokens = topic_names(mechanism.parts)
        for part, point in wrench_targets:
            topic = f"~/wrench/{tokens[part]}"
            if point is not None:
                topic += f"/{topic_names(mechanism.parts[part].points)[point]}"
            take = partial(self._take_wrench, topic, part, point)
            self._subscribe(WrenchStamped, topic, take)

    def fit_reliability(self) -> None:
        """Subscribe as best effort to topics with a best-effort publisher, which reliable subscriptions cannot receive.

        All other topics are reliable, so that no command is lost. To be called now and then.
        """
        for topic, subscription in list(self._subscriptions.items()):
            publishers = self._node.get_publishers_info_by_topic(subscription.topic_name)
            best_effort = any(
                publisher.qos_profile.reliability == QoSReliabilityPolicy.BEST_EFFORT for publisher in publishers
            )
            profile = COMMAND_BEST_EFFORT if best_effort else COMMAND
            if publishers and profile.reliability != subscription.qos_profile.reliability:
                self._node.destroy_subscription(subscription)
                self._subscribe(subscription.msg_type, topic, subscription.callback, profile)

    def _subscribe(
        self, message_type: type, topic: str, take: Callable[..., None], profile: QoSProfile = COMMAND
    ) -> None:
        self._subscriptions[topic] = self._node.create_subscription(message_type, topic, take, profile)

    @property
    def accepted(self) -> int:
        """How many messages have been accepted."""
        return self.commands.accepted + self.wrenches.accepted + self.states_accepted

    @property
    def rejected(self) -> int:
        """How many messages have been rejected."""
        return self.commands.rejected + self.wrenches.rejected + self.states_rejected

    @property
    def expired(self) -> int:
        """How often commands stopped arriving."""
        return self.commands.expired + self.wrenches.expired

    def _take_command(self, topic: str, take: Callable[[Any], object], message: Any) -> None:
        """Pass a message to the buffer of commands; `take` accepts or refuses it as a whole."""
        try:
            take(message)
        except CommandError as error:
            self.reject(topic, error)
        else:
            self._on_efforts()

    def _move(self, base: Base, message: Twist | TwistStamped) -> None:
        twist = message.twist if isinstance(message, TwistStamped) else message
        self.commands.move(base, *((vector.x, vector.y, vector.z) for vector in (twist.linear, twist.angular)))

    def _take_wrench(self, topic: str, part: str, point: str | None, message: WrenchStamped) -> None:
        force, torque = message.wrench.force, message.wrench.torque
        vectors = (force.x, force.y, force.z), (torque.x, torque.y, torque.z)
        try:
            self.wrenches.take(part, point, message.header.frame_id, *vectors)
        except CommandError as error:
            self.reject(topic, error)

    def _take_state(self, message: JointState) -> None:
        try:
            if problem := self._on_state(_state_values(message)):
                raise CommandError(problem)
        except CommandError as error:
            self.states_rejected += 1
            self.reject(SET_STATE, error)
        else:
            self.states_accepted += 1

    def reject(self, topic: str, error: CommandError) -> None:
        """Report a message that has been rejected, at a bounded rate."""
        self.last_rejection = topic, error
        now = time.monotonic()
        # The logger's own throttle inspects the stack at each call.
        if now - self._last_warnings.get(topic, -WARNING_PERIOD) >= WARNING_PERIOD:
            self._last_warnings[topic] = now
            text = f"{topic}: message rejected ({self.rejected} so far): {printable(str(error))}"
            if topic == SET_STATE:  # the event is logged as well
                self._warn(text)
            else:
                self._log.warning(text)


def _state_values(message: JointState) -> StateValues:
    """The positions and speeds of a message; either may be empty.

    :raises CommandError: the lengths differ, a joint is named twice, or efforts are given.
    """
    if message.effort:
        raise CommandError("it contains efforts, which are not part of the state", "Send them to joint_commands.")
    require_each_once(message.name, "Give one value for each joint.")
    for key, values in (("position", message.position), ("velocity", message.velocity)):
        if len(values) not in (0, len(message.name)):
            lengths = f"{len(message.name)} and {len(values)}"
            raise CommandError(f"'name' and '{key}' differ in length: {lengths}", "Give one for each name, or none.")
    positions, speeds = (
        dict(zip(message.name, values, strict=True)) if values else {}
        for values in (message.position, message.velocity)
    )
    return StateValues(positions, speeds)


def trajectory_of(message: JointTrajectory) -> Trajectory:
    """The trajectory of a message."""
    points = [
        TrajectoryPoint(
            nanoseconds(point.time_from_start), point.positions, point.velocities, point.accelerations, point.effort
        )
        for point in message.points
    ]
    return Trajectory(message.joint_names, points, nanoseconds(message.header.stamp))


def nanoseconds(stamp: Any) -> int:
    """A stamp or a duration in ns."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def printable(reason: str) -> str:
    """A reason on one line, without control characters that a message may contain, and not longer than `MAX_LENGTH`."""
    text = reason if len(reason) <= MAX_LENGTH else f"{reason[: MAX_LENGTH // 2]} … {reason[-MAX_LENGTH // 2 :]}"
    return "".join(character if character.isprintable() else repr(character)[1:-1] for character in text)
