"""`ros2 run mbd_sim sim_node`: a mechanism file as a real-time ROS 2 node."""

from __future__ import annotations

import gc
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rclpy
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from mbd_sim.errors import CommandError, MbdSimError
from mbd_sim.recording.metadata import run_metadata
from mbd_sim.recording.recorder import Recorder, RecordingError, new_file
from mbd_sim.ros import qos
from mbd_sim.ros.commands import CommandBuffer
from mbd_sim.ros.outputs import Outputs
from mbd_sim.ros.parameters import Parameters
from mbd_sim.ros.runner import Rates, Runner
from mbd_sim.simulation import Simulation
from mbd_sim.viewer import Viewer, ViewerError

# A thread that wakes up waits this long at most for another one to give up the interpreter (default: 5 ms).
SWITCH_INTERVAL = 2e-4


class SimNode(Node):  # type: ignore[misc]  # rclpy carries no types
    """Runs a mechanism in real time: states and energies out, efforts in, every run recorded."""

    def __init__(self) -> None:
        super().__init__("sim_node")
        self.parameters = Parameters(self, self._parameter_changed)
        self.simulation = self._build()
        self.commands = CommandBuffer(self.simulation.effort_map, self.parameters["command_timeout"])
        self.rates = Rates(
            real_time_factor=self.parameters["real_time_factor"],
            publish=self.parameters["publish_rate"],
            clock=self.parameters["clock_rate"],
        )
        self.runner = Runner(self.simulation, self.commands, self.rates, paused=self.parameters["start_paused"])
        self.outputs = Outputs(self, self.simulation.model)
        self.outputs.recorder = self._recorder()
        self.outputs.viewer = self._viewer()
        self.create_subscription(Float64MultiArray, "~/commands", self._command_by_order, qos.COMMAND)
        self.create_subscription(JointState, "joint_commands", self._command_by_name, qos.COMMAND)
        self.create_service(Trigger, "~/reset", self._reset)
        self.create_service(SetBool, "~/pause", self._pause)
        self.create_service(Trigger, "~/step", self._step)

    def start(self) -> None:
        """Begin to step and to publish."""
        simulation = self.simulation
        pace = "paused" if self.runner.paused else "running"
        self.get_logger().info(
            f"'{simulation.mechanism.name}' is {pace}: degrees of freedom {simulation.model.degrees_of_freedom}, "
            f"method {simulation.model.method.name}, step {simulation.step_size * 1e3:g} ms"
        )
        self.outputs.start(self.runner.output)
        self.runner.start()

    def stop(self) -> None:
        """End the stepping, then everything that it fed; the recording is finished when this returns."""
        self.runner.stop()
        self.outputs.join()
        recorder, energies = self.outputs.recorder, self.outputs.energies
        residual = f", energy residual {energies.residual:.1e} J" if energies is not None else ""
        self.get_logger().info(f"stopped after {self.runner.ticks} steps{residual}")
        if recorder is not None:
            lost = f", {recorder.dropped} dropped" if recorder.dropped else ""
            self.get_logger().info(f"recorded {recorder.written} messages{lost} to {recorder.path}")

    def _build(self) -> Simulation:
        return Simulation.from_file(
            self.parameters["mechanism"],
            method=self.parameters["method"] or None,
            step=self.parameters["step"] or None,
        )

    def _recorder(self) -> Recorder | None:
        if not self.parameters["record"]:
            return None
        mechanism = self.simulation.mechanism
        try:
            path = new_file(Path(self.parameters["record_dir"]).expanduser(), mechanism.name)
            recorder = Recorder(
                path,
                self.outputs.topics(),
                mechanism.source.text,
                run_metadata(self.simulation),
                self.outputs.bytes_per_second(self.rates.publish),
            )
        except RecordingError as error:
            self.get_logger().error(f"{error} The run is not recorded.")
            return None
        self.get_logger().info(f"recording to {path}")
        return recorder

    def _viewer(self) -> Viewer | None:
        if not self.parameters["rerun"]:
            return None
        try:
            viewer = Viewer(self.simulation.model, self.parameters["rerun"], rate=self.parameters["rerun_rate"])
        except ViewerError as error:
            self.get_logger().error(f"{error} The run is not shown.")
            return None
        self.get_logger().info(f"showing in Rerun: {viewer.address}")
        return viewer

    def _command_by_order(self, message: Float64MultiArray) -> None:
        try:
            self.commands.by_order(message.data)
        except CommandError as error:
            self._reject("~/commands", error)
        else:
            self._step_on_command()

    def _command_by_name(self, message: JointState) -> None:
        try:
            self.commands.by_name(message.name, message.effort)
        except CommandError as error:
            self._reject("joint_commands", error)
        else:
            self._step_on_command()

    def _step_on_command(self) -> None:
        """Lockstep: the command brings its steps along, so that neither can overtake the other."""
        if self.runner.paused and self.parameters["step_on_command"]:
            self.runner.step(self.parameters["step_count"])

    def _reject(self, topic: str, error: CommandError) -> None:
        self.get_logger().warning(
            f"{topic}: message rejected ({self.commands.rejected} so far): {error}", throttle_duration_sec=1.0
        )

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.runner.reset(self.parameters["reset_rewinds_clock"])
        response.success, response.message = True, "at the start state"
        return response

    def _pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.runner.pause(request.data)
        response.success, response.message = True, "paused" if request.data else "running"
        return response

    def _step(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        problem = self.runner.step(self.parameters["step_count"])
        response.success = not problem
        response.message = problem or f"t = {self.simulation.time:.9g} s"
        return response

    def _parameter_changed(self, name: str, value: Any) -> None:
        match name:
            case "real_time_factor":
                self.rates.real_time_factor = value
                self.runner.repace()
            case "publish_rate":
                self.rates.publish = value
            case "clock_rate":
                self.rates.clock = value
            case "command_timeout":
                self.commands.timeout = value


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; either may come again while it ends."""
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    try:
        return _run(ended)
    finally:
        rclpy.try_shutdown()


def _run(ended: threading.Event) -> int:
    try:
        node = SimNode()
    except (MbdSimError, ValueError, InvalidParameterTypeException, InvalidParameterValueException) as error:
        print(f"sim_node cannot start:\n{error}", file=sys.stderr)
        return 1
    sys.setswitchinterval(SWITCH_INTERVAL)
    gc.collect()
    gc.freeze()
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
    node.start()
    spinning.start()
    ended.wait()
    node.stop()
    executor.shutdown()
    spinning.join(timeout=2.0)
    node.destroy_node()
    return 0


if __name__ == "__main__":
    sys.exit(main())
