"""The page of a running node: the node's end of it.

The page is a process of its own. A timer of the node takes its requests, and does with each what a message or a call of
a service with the same content would do, in the same thread; then it answers with the newest state.
"""

from __future__ import annotations

import json
import pickle
import subprocess
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Protocol, cast

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.parameter import Parameter

from mbd_sim.base.errors import CommandError
from mbd_sim.base.packages import require_packages
from mbd_sim.lab.session.hold import Hold
from mbd_sim.lab.session.link import NodeState, PageOrder, start_linked
from mbd_sim.mechanism.elements.joint_types import Channel
from mbd_sim.ros.commands.command_buffer import CommandBuffer
from mbd_sim.ros.commands.wrenches import WrenchBuffer
from mbd_sim.ros.node.parameters import NodeParameters
from mbd_sim.ros.node.services import RunServices
from mbd_sim.ros.node.subscriptions import LAB, Subscriptions
from mbd_sim.ros.publishing.recordings import NodeRecordings
from mbd_sim.ros.stepping.clock import Rates
from mbd_sim.ros.stepping.thread import SteppingThread
from mbd_sim.simulation.run.changes import StateValues
from mbd_sim.simulation.run.simulation import BaseSimulation

PERIOD = 0.01  # s between two looks for requests
CLOSE_TIMEOUT = 2.0  # s
PROGRAM = "mbd_sim.lab.node_page"  # a module
ZERO = (0.0, 0.0, 0.0)
FARTHEST, STIFFEST = 1e6, 1e9  # m, and N/m for each m: beyond, forces would not be finite


class PagedNode(Protocol):
    """What the page needs of a `SimNode`, besides what it is as an `rclpy.node.Node`."""

    simulation: BaseSimulation
    parameters: NodeParameters
    stepping_thread: SteppingThread
    commands: CommandBuffer
    wrenches: WrenchBuffer
    rates: Rates
    subscribed: Subscriptions
    run_services: RunServices
    recordings: NodeRecordings
    create_timer: Any
    set_parameters: Any
    get_logger: Any

    def step_on_command(self) -> None:
        """Take steps that a command triggers."""


class LabPage:
    """Serves the page of a node. What pages have commanded is repeated while one is open, until others command it."""

    def __init__(self, node: PagedNode) -> None:
        """Start the process of the page; its address is logged when it is open.

        :raises MissingPackageError: viser is not installed.
        """
        require_packages("viser", purpose="The lab")
        self._node, self._told = node, ""
        self._efforts, self._commands = dict[str, float](), dict[str, float]()
        self._actions: Mapping[str, Callable[..., str]] = {
            "pause": self._pause,
            "step": lambda: node.stepping_thread.step(node.parameters["step_count"]),
            "reset": lambda: node.stepping_thread.reset(node.parameters["reset_rewinds_clock"]),
            "speed": self._set_speed,
            "live": node.parameters.change_live,
            "effort": self._command_effort,
            "command": self._command_actuator,
            "pull": self._pull,
            "release": self._release,
            "abandon": lambda part: "" if node.wrenches.timeout else self._release(part),
            "place": self._place,
            "state": lambda positions, speeds: self._set_state(StateValues(positions, speeds)),
            "record": lambda on: node.run_services.record(on)[1],
        }
        simulation, parameters = node.simulation, node.parameters
        model = simulation.model
        arguments = {
            "method": model.method_name,
            "step": simulation.step_size,
            "wrenches": model.input_layout.loaded,
            "live": tuple(simulation.live),
        }
        order = PageOrder(model.mechanism, arguments, parameters["lab_host"], parameters["lab_port"])
        self._process, self._link = start_linked(PROGRAM)
        self._link.send(pickle.dumps(order))
        self._timer = node.create_timer(PERIOD, self._serve, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def close(self) -> None:
        """End the page."""
        self._link.close()
        try:
            self._process.wait(CLOSE_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _serve(self) -> None:
        """Do what the page has requested, if it has, and answer."""
        try:
            message = self._link.receive()
            if message is None:
                return
            given = json.loads(message)
            if "requests" not in given:
                self._show_address(given)
                return
            for name, *arguments in given["requests"]:
                self._do(name, arguments)
            if given["pages"]:
                self._node.commands.renew(self._efforts, self._commands)
            self._link.send(pickle.dumps(self._state()))
        except OSError:
            self._timer.cancel()
            self._node.get_logger().error("the page of the lab has ended; the run goes on")

    def _show_address(self, given: Mapping[str, str]) -> None:
        log = self._node.get_logger()
        if "address" in given:
            log.info(f"the lab is at {given['address']}")
        else:
            log.error(f"the lab cannot be opened: {given.get('failed')}")
            self._timer.cancel()

    def _do(self, name: str, arguments: list[Any]) -> None:
        try:
            problem = self._actions[name](*arguments)
        except CommandError as error:
            self._node.subscribed.reject(LAB, error)
            problem = str(error)
        self._told = problem or self._told

    def _state(self) -> NodeState:
        node, point = self._node, self._node.stepping_thread.shown().point
        inputs = node.commands.overlay(point.inputs, node.simulation.model.input_layout)
        run, (told, self._told) = node.stepping_thread.run, (self._told, "")
        return NodeState(
            point=replace(point, inputs=inputs),
            running=not node.stepping_thread.paused,
            speed=node.rates.real_time_factor,
            recording=node.recordings.location,
            told=told or run.problem or run.advice,
        )

    def _pause(self, paused: bool) -> str:
        self._node.stepping_thread.pause(paused)
        return ""

    def _set_speed(self, factor: float) -> str:
        (result,) = self._node.set_parameters([Parameter("real_time_factor", value=float(factor))])
        return str(result.reason)

    def _command_effort(self, name: str, value: float) -> str:
        self._node.commands.efforts_by_name({name: value})
        self._efforts[name] = value
        self._node.step_on_command()
        return ""

    def _command_actuator(self, channel: str, value: float) -> str:
        name, _, quantity = channel.rpartition(".")
        self._node.commands.actuators_by_name({name: {cast(Channel, quantity): value}})
        self._commands[channel] = value
        self._node.step_on_command()
        return ""

    def _pull(self, part: str, point: list[float], target: list[float], *spring: float) -> str:
        if not np.all(np.abs([*point, *target, *(one / STIFFEST for one in spring)]) < FARTHEST):
            raise CommandError("a pull is too strong", "Pull less far.")
        self._node.wrenches.pull(Hold(part, np.array(point), np.array(target), *spring))
        return ""

    def _release(self, part: str) -> str:
        self._node.wrenches.take(part, None, "", ZERO, ZERO)
        return ""

    def _place(self, positions: Mapping[str, float], speeds: Mapping[str, float]) -> str:
        """Set the state of a mechanism that is dragged: not if it runs meanwhile."""

        def given() -> StateValues:
            if not self._node.stepping_thread.paused:
                raise CommandError("the run goes on", "Pause it before moving the mechanism.")
            return StateValues(positions, speeds)

        return self._set_state(given)

    def _set_state(self, given: StateValues | Callable[[], StateValues]) -> str:
        if problem := self._node.stepping_thread.set_state(given, told=False):
            self._node.subscribed.states_rejected += 1
            raise CommandError(problem)
        self._node.subscribed.states_accepted += 1
        return ""
