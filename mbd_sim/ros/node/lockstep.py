"""Controls a running `sim_node` in lockstep: one command, some steps, and the resulting state.

For co-simulation and learning, where the same commands must give the same motion, bit for bit, however busy the machine
is. A command and a call of `~/step` could overtake each other; therefore the command itself triggers the steps
(`step_on_command`), and the answer is the state with the next stamp.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any

import numpy as np
import rclpy
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from mbd_sim.base.errors import CommandError, MbdSimError, listed
from mbd_sim.base.geometry.pose import Array
from mbd_sim.ros.events_executor import EventsExecutor

# Hz, of what is published at the end of a command's steps in any case; 0 would stop it altogether
SELDOM = 1e-3
UNANSWERED = 2.0  # s, after which a request is sent again


class LockstepError(MbdSimError):
    """The simulator does not answer, or refuses a request."""


@dataclass(frozen=True, slots=True)
class State:
    """Time in s since the reset, coordinates, speeds, and the efforts applied during the last steps."""

    time: float
    q: Array
    u: Array
    efforts: Array


class Lockstep:
    """Pauses and resets a running `sim_node`, and steps it until `close`, which leaves it paused.

    `q`, `u` and `efforts` are those of `joint_states`: in the order of `names`, driven joints last.

    >>> with Lockstep(steps=10) as sim:
    ...     state = sim.reset()
    ...     for _ in range(1000):
    ...         state = sim.step(-2.0 * state.u)
    """

    def __init__(
        self, simulator: str = "sim_node", steps: int = 1, *, timeout: float = 10.0, context: Context | None = None
    ) -> None:
        """Find the simulator by its name, with its namespace if it has one, and reset it.

        :param steps: integration steps for each command.
        :param timeout: seconds of real time to wait for an answer.
        :param context: an initialized rclpy context; by default that of `rclpy.init()`, which is called if necessary.
        :raises LockstepError: there is no such simulator, or it does not accept `steps`.
        """
        self.timeout = timeout
        if context is None and not rclpy.ok():
            rclpy.init()
        self._node = Node("lockstep", context=context)
        self._executor = EventsExecutor(context=context)
        self._executor.add_node(self._node)
        self._newest: JointState | None = None
        space = simulator.rpartition("/")[0]
        states = f"{space}/joint_states" if space else "joint_states"
        self._node.create_subscription(JointState, states, self._on_state, QoSProfile(depth=10))
        self._commands, self._actuators = (
            self._node.create_publisher(Float64MultiArray, f"{simulator}/{topic}", 10)
            for topic in ("commands", "actuator_commands")
        )
        self._simulator = simulator
        self._stamp = -1
        self.names: tuple[str, ...] = ()
        self._clients: dict[str, Any] = {}
        self._original_parameters: dict[str, Any] = {}
        lockstep_parameters = {
            "step_on_command": True,
            "step_count": steps,
            "publish_rate": 0.0,  # only the states at the end of a command's steps
            "clock_rate": SELDOM,  # so is the time
            "command_timeout": 0.0,
            "reset_rewinds_clock": True,
        }
        try:
            self._original_parameters = self._get_parameters(list(lockstep_parameters))
            if not self._original_parameters["clock_rate"]:
                del lockstep_parameters["clock_rate"]  # the time is not published at all
            self._call(SetBool, "pause", data=True)
            self._set_parameters(lockstep_parameters)
            for publisher in (self._commands, self._actuators):
                self._wait_for(publisher.get_subscription_count, "its subscription to commands")
            self.reset()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Lockstep:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def reset(self) -> State:
        """Reset to the start state and to time zero."""
        self._call(Trigger, "reset", repeats=False)  # a late repetition would undo the first commands
        return self._state(0, "the start state")

    def step(self, efforts: Sequence[float] | Array) -> State:
        """Apply efforts (N or N·m, one for each coordinate), take the steps, and return the resulting state.

        :raises CommandError: an effort is not finite.
        :raises LockstepError: no answer, for example because of a wrong number of efforts or a diverged motion.
        """
        return self._send(self._commands, efforts, "an effort")

    def command(self, commands: Sequence[float] | Array) -> State:
        """Command all channels of the actuators, take the steps, and return the resulting state.

        :param commands: in the order of the labels of `~/applied_commands`: that of the file, in SI units.
        :raises CommandError: a command is not finite.
        :raises LockstepError: no answer, for example because of a wrong number of commands.
        """
        return self._send(self._actuators, commands, "a command")

    def _send(self, publisher: Publisher, numbers: Sequence[float] | Array, what: str) -> State:
        values = np.asarray(numbers, dtype=float)
        if not np.all(np.isfinite(values)):
            raise CommandError(f"{what} is not finite: {listed([str(value) for value in values])}")
        publisher.publish(Float64MultiArray(data=values.tolist()))
        return self._state(self._stamp + 1, "the state after the steps (if it rejected the command, its log says why)")

    def close(self) -> None:
        """Restore the simulator's parameters, and disconnect; it stays paused."""
        try:
            if self._original_parameters and self._node.context.ok():
                self._set_parameters(self._original_parameters)
        finally:
            self._executor.shutdown()
            self._node.destroy_node()

    def _on_state(self, state: JointState) -> None:
        self._newest = state

    def _state(self, earliest: int, awaited: str) -> State:
        """The first state with a stamp of at least `earliest` (ns); for 0 the state at zero, after a reset."""
        self._wait_for(lambda: self._is_due(earliest), awaited)
        state = self._newest
        assert state is not None
        self._stamp, self.names = _nanoseconds(state), tuple(state.name)
        arrays = (np.array(values) for values in (state.position, state.velocity, state.effort))
        return State(1e-9 * self._stamp, *arrays)

    def _is_due(self, earliest: int) -> bool:
        if self._newest is None:
            return False
        stamp = _nanoseconds(self._newest)
        return stamp == 0 if earliest == 0 else stamp >= earliest

    def _wait_for(self, condition: Callable[[], Any], awaited: str) -> None:
        end = time.monotonic() + self.timeout
        while not condition():
            if time.monotonic() > end:
                raise LockstepError(
                    f"'{self._simulator}' did not answer within {self.timeout:g} s: waited for {awaited}."
                )
            self._executor.spin_once(timeout_sec=0.05)

    def _call(self, kind: Any, name: str, *, repeats: bool = True, **fields: Any) -> Any:
        """Call a service.

        :param repeats: call again where no answer comes: DDS drops it if the simulator has not discovered us yet.
        """
        if name not in self._clients:
            self._clients[name] = self._node.create_client(kind, f"{self._simulator}/{name}")
        client = self._clients[name]
        self._wait_for(client.service_is_ready, f"its service '{name}'")
        answers, sent = list[Any](), -math.inf

        def is_answered() -> bool:
            nonlocal sent
            now = time.monotonic()
            if not answers or (repeats and now > sent + UNANSWERED):
                answers.append(client.call_async(kind.Request(**fields)))
                sent = now
            return any(answer.done() for answer in answers)

        self._wait_for(is_answered, f"its service '{name}'")
        return next(answer for answer in answers if answer.done()).result()

    def _get_parameters(self, names: list[str]) -> dict[str, Any]:
        values = self._call(GetParameters, "get_parameters", names=names).values
        messages = [ParameterMessage(name=name, value=value) for name, value in zip(names, values, strict=True)]
        return {message.name: Parameter.from_parameter_msg(message).value for message in messages}

    def _set_parameters(self, values: dict[str, Any]) -> None:
        messages = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        results = self._call(SetParameters, "set_parameters", parameters=messages).results
        for result, name in zip(results, values, strict=True):
            if not result.successful:
                raise LockstepError(f"'{self._simulator}' rejects {name} = {values[name]}: {result.reason}")


def _nanoseconds(state: JointState) -> int:
    return int(state.header.stamp.sec) * 1_000_000_000 + int(state.header.stamp.nanosec)
