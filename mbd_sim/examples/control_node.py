"""The common part of the controllers: joint states in, efforts or other commands by joint name out."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Sequence

import numpy as np
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from mbd_sim.base.geometry.pose import Array
from mbd_sim.files.load import load_mechanism
from mbd_sim.ros.node.parameters import ParameterSpec, Rows, program_help
from mbd_sim.ros.node.program import ProgramNode, run_node

CONTROL_TOPICS = (
    ("joint_states", "sensor_msgs/msg/JointState, subscribed: the state; each message is answered with efforts"),
    ("joint_commands", "sensor_msgs/msg/JointState, published: efforts by joint name"),
)
NEWEST = QoSProfile(depth=1)  # a controller that is late answers the newest state, not an old one


class Answered:
    """Which states of a simulator to answer: each once, and again when it has been repeated twice.

    A paused simulator repeats its state every half second. In lockstep each answer takes steps, so that a second answer
    to a state, given because the machine was busy for longer than that, would leave the controller one period late
    from then on. After two repetitions the first answer did not arrive.
    """

    def __init__(self) -> None:
        self._last: JointState | None = None
        self._repetitions = 0

    def accepts(self, state: JointState) -> bool:
        """Whether to answer this state, which is the next one received."""
        self._repetitions = self._repetitions + 1 if state == self._last else 0
        self._last = state
        return self._repetitions % 2 == 0


class ControlNode(Node):  # type: ignore[misc]  # rclpy carries no types
    """Answers each joint state with efforts, so that it runs at the simulator's `publish_rate`.

    The first answer waits until there is a simulator that receives it. The controller's model comes from its parameter
    `mechanism`, not from the simulator.
    """

    PARAMETERS: tuple[ParameterSpec, ...]  # with the default of `mechanism`

    def __init__(self, name: str) -> None:
        super().__init__(name)
        declare(self, self.PARAMETERS)
        self.mechanism = load_mechanism(self.get_parameter("mechanism").value)
        self.names = list(self.mechanism.coordinate_names)
        self._commands = self.create_publisher(JointState, "joint_commands", 10)
        self._answered = Answered()

    def start(self) -> None:
        """Subscribe to the joint states."""
        self.create_subscription(JointState, "joint_states", self._on_state, NEWEST)
        self.get_logger().info(f"controlling '{self.mechanism.name}'")

    def stop(self) -> None:
        """Nothing to release; the simulator's watchdog sets the efforts to zero."""

    def control(self, time: float, q: Array, u: Array) -> Array:
        """The efforts (nv,) in N and N·m at a time in s, for coordinates and speeds (nv,) in the order of `names`."""
        raise NotImplementedError

    def _on_state(self, state: JointState) -> None:
        indices = {name: index for index, name in enumerate(state.name)}
        if missing := [name for name in self.names if name not in indices]:
            self.get_logger().warning(
                f"joint_states lacks {', '.join(missing)}: does the simulator run '{self.mechanism.name}'?",
                throttle_duration_sec=2.0,
            )
            return
        if not (self._commands.get_subscription_count() and self._answered.accepts(state)):
            return
        order = [indices[name] for name in self.names]
        time = state.header.stamp.sec + 1e-9 * state.header.stamp.nanosec
        self.publish_answer(time, np.array(state.position)[order], np.array(state.velocity)[order])

    def publish_answer(self, time: float, q: Array, u: Array) -> None:
        """Publish the answer to a state, with arguments as those of `control`: by default the message of `command`."""
        self._commands.publish(self.command(time, q, u))

    def command(self, time: float, q: Array, u: Array) -> JointState:
        """The message that answers a state: by default the efforts of `control`."""
        efforts = self.control(time, q, u)
        return JointState(name=self.names, effort=np.asarray(efforts, dtype=float).tolist())


class TargetNode(ControlNode):
    """The parameter `targets`, which are taken in turn for `period` s each, may be changed during the run."""

    LOWEST, HIGHEST = -np.inf, np.inf  # target

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.add_on_set_parameters_callback(self._check_targets)
        self.period = float(self.get_parameter("period").value)

    def target(self, number: int) -> float:
        """The target of a period by its number from 0 on."""
        targets = self.get_parameter("targets").value
        return float(targets[number % len(targets)])

    def _check_targets(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            values = np.array(parameter.value if parameter.name == "targets" else [max(self.LOWEST, 0.0)])
            allowed = np.isfinite(values) & (values >= self.LOWEST) & (values <= self.HIGHEST)
            if not (values.size and np.all(allowed)):
                reason = f"give at least one target, each finite and from {self.LOWEST:g} to {self.HIGHEST:g}"
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)


def declare(node: Node, parameters: Sequence[ParameterSpec]) -> None:
    """Declare the parameters of an example; those that are not `live` cannot be set while it runs."""
    for spec in parameters:
        descriptor = ParameterDescriptor(description=spec.description, read_only=not spec.live)
        node.declare_parameter(spec.name, spec.default, descriptor)


def mechanism_parameter(name: str) -> ParameterSpec:
    """The parameter that names the controller's model."""
    return ParameterSpec("mechanism", name, "the controller's model: a mechanism file, or a shipped mechanism")


def end_program() -> None:
    """End this program as Ctrl-C does."""
    os.kill(os.getpid(), signal.SIGINT)


def run(name: str, node_class: Callable[[], ProgramNode], *, example: str, topics: Rows = CONTROL_TOPICS) -> int:
    """Run an example's node until SIGINT or SIGTERM; `example` is a parameter for the usage line."""

    def help_text() -> str:
        summary = (sys.modules[node_class.__module__].__doc__ or "").partition(": ")[2]
        description = summary[:1].upper() + summary[1:]
        return program_help(name, description, example, getattr(node_class, "PARAMETERS", ()), {"topics": topics})

    return run_node(name, lambda end: node_class(), example=example, help_text=help_text)
