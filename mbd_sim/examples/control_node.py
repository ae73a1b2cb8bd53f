"""What the controllers share: joint states in, efforts by name out, and an orderly end."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence

import numpy as np
import rclpy
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from mbd_sim.errors import MbdSimError
from mbd_sim.geometry.pose import Array
from mbd_sim.load import load_mechanism

AT_START = ParameterDescriptor(read_only=True)  # a parameter that takes effect at the start alone
NEWEST = QoSProfile(depth=1)  # a controller that is late answers the newest state, not an old one


class ControlNode(Node):  # type: ignore[misc]  # rclpy carries no types
    """Answers every joint state with efforts, so that its rate is the simulator's `publish_rate`.

    Its own model comes from the parameter `mechanism`; it never asks the simulator for it.
    """

    def __init__(self, name: str, mechanism: str) -> None:
        super().__init__(name)
        self.declare_parameter("mechanism", mechanism, AT_START)
        self.mechanism = load_mechanism(self.get_parameter("mechanism").value)
        self.names = list(self.mechanism.coordinate_names)
        self._commands = self.create_publisher(JointState, "joint_commands", 10)

    def start(self) -> None:
        """Begin to listen, now that the controller is ready."""
        self.create_subscription(JointState, "joint_states", self._on_state, NEWEST)
        self.get_logger().info(f"controls '{self.mechanism.name}'")

    def control(self, time: float, q: Array, u: Array) -> Array:
        """The efforts (nv,) in N and N·m at a time in s, for coordinates and speeds (nv,) in the order of `names`."""
        raise NotImplementedError

    def _on_state(self, state: JointState) -> None:
        where = {name: place for place, name in enumerate(state.name)}
        if missing := [name for name in self.names if name not in where]:
            self.get_logger().warning(
                f"joint_states has no {', '.join(missing)}: is '{self.mechanism.name}' what is simulated?",
                throttle_duration_sec=2.0,
            )
            return
        order = [where[name] for name in self.names]
        time = state.header.stamp.sec + 1e-9 * state.header.stamp.nanosec
        efforts = self.control(time, np.array(state.position)[order], np.array(state.velocity)[order])
        self.command(efforts)

    def command(self, efforts: Array) -> None:
        """Publish efforts (nv,)."""
        self._commands.publish(JointState(name=self.names, effort=np.asarray(efforts, dtype=float).tolist()))


def end() -> None:
    """End this program, as Ctrl-C does."""
    os.kill(os.getpid(), signal.SIGINT)


def run(make: Callable[[], Node], arguments: Sequence[str] | None = None) -> int:
    """Spin a node until SIGINT or SIGTERM; either may come again while it ends."""
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = make()
        executor = EventsExecutor()
        executor.add_node(node)
        while not ended.is_set():
            executor.spin_once(timeout_sec=0.1)
        executor.shutdown()
        node.destroy_node()
    except (MbdSimError, ValueError, InvalidParameterTypeException, InvalidParameterValueException) as error:
        print(error, file=sys.stderr)
        return 1
    finally:
        rclpy.try_shutdown()
    return 0
