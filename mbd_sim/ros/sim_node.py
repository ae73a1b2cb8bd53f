"""`ros2 run mbd_sim sim_node`: a mechanism file as a real-time ROS 2 node."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from itertools import takewhile
from typing import Any

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import SetBool, Trigger

from mbd_sim.errors import MbdSimError, listed
from mbd_sim.ros import realtime
from mbd_sim.ros.command_buffer import CommandBuffer
from mbd_sim.ros.diagnostics import PERIOD, Diagnostics
from mbd_sim.ros.node_parameters import Parameters
from mbd_sim.ros.node_setup import (
    build,
    limits,
    recordings,
    viewer,
    wanted,
)
from mbd_sim.ros.publishing_thread import Outputs
from mbd_sim.ros.simulation_services import serve_simulation_interfaces
from mbd_sim.ros.stepping_thread import Rates, Runner
from mbd_sim.ros.subscriptions import Inputs
from mbd_sim.ros.wrench_buffer import WrenchBuffer

IMPOSSIBLE = (MbdSimError, ValueError, ImportError, InvalidParameterTypeException, InvalidParameterValueException)
USAGE = "Parameters stand after --ros-args, each behind -p: sim_node --ros-args -p mechanism:=double_rod"
STARVED = 3  # times a second that the schedule may start anew before the stepping thread gives up its priority


class SimNode(Node):  # type: ignore[misc]  # rclpy carries no types
    """Runs a mechanism in real time: states and energies out, efforts and wrenches in, every run recorded."""

    def __init__(self, end: Callable[[], None]) -> None:
        """Build everything; `end` is called where a service asks the node to end."""
        super().__init__("sim_node")
        self.parameters = Parameters(self, self._parameter_changed)
        self.simulation, loads = build(self.parameters)
        simulation, prefix = self.simulation, self.parameters["frame_prefix"]
        self._set_at_start(self.parameters.add_live(simulation.live, lambda changes: self.runner.set_live(changes)))
        self._unknown = self.parameters.finish()
        timeout = self.parameters["command_timeout"]
        self.commands = CommandBuffer(simulation.effort_map, timeout)
        self.wrenches = WrenchBuffer(simulation.wrench_map, simulation.model.part_names, timeout, prefix)
        self.rates = Rates(
            real_time_factor=self.parameters["real_time_factor"],
            publish=self.parameters["publish_rate"],
            clock=self.parameters["clock_rate"],
        )
        paused = self.parameters["start_paused"]
        self.runner = Runner(simulation, self.commands, self.rates, wrenches=self.wrenches, paused=paused)
        self.outputs = Outputs(self, simulation.model, wanted(self.parameters, simulation.model.part_names))
        self.recordings = recordings(self.parameters, self.runner, self.outputs, self.get_logger())
        self.outputs.recordings = self.recordings
        self.outputs.viewer = viewer(self.parameters, simulation, self.get_logger())
        inputs = Inputs(self, simulation.mechanism, self.commands, self.wrenches, loads, self._step_on_command)
        self.diagnostics = Diagnostics(self, self.runner, inputs, self.outputs)
        self._priority = self.parameters["real_time_priority"]
        self.create_timer(PERIOD, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.create_service(Trigger, "~/reset", self._reset)
        self.create_service(SetBool, "~/pause", self._pause)
        self.create_service(Trigger, "~/step", self._step)
        self.create_service(SetBool, "~/record", self._record)
        self.create_service(Trigger, "~/split_recording", self._split_recording)
        self.standard = serve_simulation_interfaces(self, self.runner, end)

    def start(self) -> None:
        """Begin to step and to publish."""
        simulation = self.simulation
        pace = "paused" if self.runner.paused else "running"
        self.get_logger().info(
            f"'{simulation.mechanism.name}' is {pace}: degrees of freedom {simulation.model.degrees_of_freedom}, "
            f"method {simulation.model.method.name}, step {simulation.step_size * 1e3:g} ms"
        )
        if self._unknown:
            self.get_logger().warning(f"parameters that mean nothing here: {listed(self._unknown)}")
        if self._priority and (refusal := realtime.lock_memory()):
            self._note(refusal)
        if self.parameters["record"]:
            begun, answer = self.recordings.start(self.runner.moment())
            if not begun:
                self.get_logger().error(f"{answer} The run is not recorded.")
            else:
                self.get_logger().info(f"recording to {answer}")
        self.outputs.start(self.runner.output, self.simulation.live)
        self.diagnostics.begin()
        self.runner.start()
        self._prioritize()

    def stop(self) -> None:
        """End the stepping, then everything that it fed; the recording is finished when this returns."""
        self.runner.stop()
        self.outputs.join()
        energies = self.outputs.energies
        residual = f", energy residual {energies.residual:.1e} J" if energies is not None else ""
        late = self.runner.pacer.lateness.spread()
        self.get_logger().info(
            f"stopped after {self.runner.ticks} steps{residual}; late by {1e3 * late.median:.2f} ms (median), "
            f"{1e3 * late.p99:.2f} (p99), {1e3 * late.maximum:.1f} at most; {self.runner.pacer.overruns} overruns"
        )
        if summary := self.recordings.summary():
            self.get_logger().info(summary)

    def _set_at_start(self, changes: Mapping[str, float]) -> None:
        """Start with live values that differ from the file's.

        :raises CommandError, ValueError: one does not fit, or the loops cannot be closed with them.
        """
        if changes:
            self.simulation.set_live(changes)
            self.simulation.reset()

    def _prioritize(self) -> None:
        """Real-time priority, unless stepping knows no pause: it would leave nothing for the rest of the machine."""
        priority = self._priority if self.rates.real_time_factor > 0.0 else 0
        if self._priority and (refusal := realtime.prioritize(priority)):
            self._note(refusal)
            self._priority = 0

    def _note(self, text: str) -> None:
        self.get_logger().info(text)
        self.diagnostics.notes.append(text)

    def _tick(self) -> None:
        if self._priority and self.diagnostics.overruns_of_late >= STARVED:
            realtime.prioritize(0)
            self._priority = 0
            self._note("stepping takes all the time, so that it goes on without real-time priority")
        self.diagnostics.tick()

    def _step_on_command(self) -> None:
        """Lockstep: the command brings its steps along, so that neither can overtake the other."""
        if self.runner.paused and self.parameters["step_on_command"]:
            self.runner.step(self.parameters["step_count"])

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        problem = self.runner.reset(self.parameters["reset_rewinds_clock"])
        response.success, response.message = not problem, problem or "at the start state"
        return response

    def _pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.runner.pause(request.data)
        response.success, response.message = True, "paused" if request.data else "running"
        return response

    def _record(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if request.data:
            response.success, response.message = self.recordings.start()
            self._prioritize()  # the threads that write are new
        else:
            response.success, response.message = self.recordings.stop()
        if response.success:
            self.get_logger().info(f"recording to {response.message}" if request.data else self.recordings.summary())
        return response

    def _split_recording(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = self.recordings.split()
        return response

    def _step(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        problem = self.runner.step(self.parameters["step_count"])
        response.success = not problem
        response.message = problem or f"t = {1e-9 * self.runner.clock_ns:.9g} s"
        return response

    def _parameter_changed(self, name: str, value: Any) -> None:
        match name:
            case "real_time_factor":
                self.rates.real_time_factor = value
                self.runner.repace()
                self._prioritize()
            case "publish_rate":
                self.rates.publish = value
            case "clock_rate":
                self.rates.clock = value
            case "command_timeout":
                self.commands.timeout = self.wrenches.timeout = value
            case "record_split_size" | "record_split_duration":
                self.recordings.limits = limits(self.parameters)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; either may come again while it ends."""
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    arguments = sys.argv if arguments is None else arguments
    # rclpy passes over what stands before --ros-args: `-p mechanism:=x` alone would run another mechanism.
    if strange := list(takewhile(lambda argument: argument != "--ros-args", arguments[1:])):
        print(f"sim_node cannot start:\nnot understood: {' '.join(strange)}. {USAGE}", file=sys.stderr)
        return 1
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # rclpy exports no class of its own for arguments that it cannot read
        print(f"sim_node cannot start:\n{error}\n{USAGE}", file=sys.stderr)
        return 1
    try:
        return _run(ended)
    finally:
        rclpy.try_shutdown()


def _run(ended: threading.Event) -> int:
    try:
        node = SimNode(ended.set)
    except IMPOSSIBLE as error:
        print(f"sim_node cannot start:\n{error}", file=sys.stderr)
        return 1
    realtime.settle_memory()
    executor = EventsExecutor()
    executor.add_node(node)

    def spin() -> None:
        # EventsExecutor.spin() delivers nothing in rclpy 7.1.6 as built for PyPI; spin_once() does, as fast.
        try:
            while not ended.is_set():
                executor.spin_once(timeout_sec=0.1)
        finally:
            ended.set()

    spinning = threading.Thread(target=spin, name="executor", daemon=True)
    spinning.start()
    node.start()
    realtime.wait_for(ended)
    node.stop()
    executor.shutdown()
    spinning.join(timeout=2.0)
    node.destroy_node()
    return 0


if __name__ == "__main__":
    sys.exit(main())
