"""`ros2 run mbd_sim sim_node`: a mechanism file as a real-time ROS 2 node."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from mbd_sim.errors import CommandError, MbdSimError, listed, nearest
from mbd_sim.mechanism.load import load_mechanism
from mbd_sim.recording.metadata import run_metadata
from mbd_sim.recording.recorder import Recorder, RecordingError, new_file
from mbd_sim.ros import qos, realtime
from mbd_sim.ros.commands import CommandBuffer
from mbd_sim.ros.diagnostics import PERIOD, Diagnostics
from mbd_sim.ros.names import topic_names
from mbd_sim.ros.outputs import Outputs, Wanted
from mbd_sim.ros.parameters import Parameters
from mbd_sim.ros.runner import Rates, Runner
from mbd_sim.ros.wrenches import EVERY, WrenchBuffer, loadable
from mbd_sim.simulation import Simulation
from mbd_sim.viewer import Viewer, ViewerError

IMPOSSIBLE = (MbdSimError, ValueError, ImportError, InvalidParameterTypeException, InvalidParameterValueException)
STARVED = 3  # times a second that the schedule may start anew before the stepping thread gives up its priority
LOOK = 0.2  # seconds between looks at signals


class SimNode(Node):  # type: ignore[misc]  # rclpy carries no types
    """Runs a mechanism in real time: states and energies out, efforts in, every run recorded."""

    def __init__(self) -> None:
        super().__init__("sim_node")
        self.parameters = Parameters(self, self._parameter_changed)
        self.simulation = self._build()
        self._set_at_start(self.parameters.add_live(self.simulation.live, self._set_live))
        self._unknown = self.parameters.finish()
        timeout = self.parameters["command_timeout"]
        self.commands = CommandBuffer(self.simulation.effort_map, timeout)
        self.wrenches = WrenchBuffer(
            self.simulation.wrench_map,
            self.simulation.model.part_names,
            timeout,
            self.parameters["frame_prefix"],
        )
        self.rates = Rates(
            real_time_factor=self.parameters["real_time_factor"],
            publish=self.parameters["publish_rate"],
            clock=self.parameters["clock_rate"],
        )
        self.runner = Runner(
            self.simulation,
            self.commands,
            self.rates,
            wrenches=self.wrenches,
            paused=self.parameters["start_paused"],
        )
        self.outputs = Outputs(self, self.simulation.model, self._wanted())
        self.outputs.recorder = self._recorder()
        self.outputs.viewer = self._viewer()
        self.diagnostics = Diagnostics(self, self.runner, self.outputs)
        self._priority = self.parameters["real_time_priority"]
        self._warned = 0.0
        self.create_timer(PERIOD, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.create_subscription(Float64MultiArray, "~/commands", self._command_by_order, qos.COMMAND)
        self.create_subscription(JointState, "joint_commands", self._command_by_name, qos.COMMAND)
        self._subscribe_wrenches()
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
        if self._unknown:
            self.get_logger().warning(f"parameters that mean nothing here: {listed(self._unknown)}")
        if self._priority and (refusal := realtime.lock_memory()):
            self._note(refusal)
        self.outputs.start(self.runner.output, self.simulation.live)
        self.diagnostics.begin()
        self.runner.start()
        self._prioritize()

    def stop(self) -> None:
        """End the stepping, then everything that it fed; the recording is finished when this returns."""
        self.runner.stop()
        self.outputs.join()
        recorder, energies = self.outputs.recorder, self.outputs.energies
        residual = f", energy residual {energies.residual:.1e} J" if energies is not None else ""
        late = self.runner.pacer.lateness.spread()
        self.get_logger().info(
            f"stopped after {self.runner.ticks} steps{residual}; late by {1e3 * late.median:.2f} ms (median), "
            f"{1e3 * late.p99:.2f} (p99), {1e3 * late.maximum:.1f} at most; {self.runner.pacer.overruns} overruns"
        )
        if recorder is not None:
            lost = f", {recorder.dropped} dropped" if recorder.dropped else ""
            self.get_logger().info(f"recorded {recorder.written} messages{lost} to {recorder.path}")

    def _build(self) -> Simulation:
        mechanism = load_mechanism(self.parameters["mechanism"])
        self._loadable = loadable(mechanism, self.parameters.listed("wrenches"))
        return Simulation(
            mechanism,
            method=self.parameters["method"] or None,
            step=self.parameters["step"] or None,
            wrenches=tuple(dict.fromkeys(part for part, _ in self._loadable)),
            live=self.parameters.listed("live"),
        )

    def _set_at_start(self, changes: Mapping[str, float]) -> None:
        """Start with live values that differ from the file's.

        :raises CommandError, ValueError: one does not fit, or the loops cannot be closed with them.
        """
        if changes:
            self.simulation.set_live(changes)
            self.simulation.reset()

    def _set_live(self, changes: Mapping[str, float]) -> str:
        return self.runner.set_live(changes)

    def _subscribe_wrenches(self) -> None:
        """`~/wrench/<part>` acts at the mass centre, `~/wrench/<part>/<point>` at a named point."""
        parts = self.simulation.mechanism.parts
        tokens = topic_names(parts)
        for part, point in self._loadable:
            topic = f"~/wrench/{tokens[part]}"
            if point is not None:
                topic += f"/{topic_names(parts[part].points)[point]}"
            take = partial(self._wrench, topic, part, point)
            self.create_subscription(WrenchStamped, topic, take, qos.COMMAND)

    def _wanted(self) -> Wanted:
        """What is published besides joints and energies.

        :raises ValueError: `part_poses` names a part that does not exist.
        """
        given, names = self.parameters.listed("part_poses"), self.simulation.model.part_names
        for name in given:
            if name not in (*names, EVERY):
                raise ValueError(f"part_poses: there is no part '{name}'. {nearest(name, names)}")
        return Wanted(
            reactions=self.parameters["joint_reactions"],
            violation=self.parameters["constraint_violation"],
            poses=tuple(names) if EVERY in given else tuple(given),
            tf=self.parameters["tf"],
            marker_rate=self.parameters["marker_rate"],
            frame_prefix=self.parameters["frame_prefix"],
        )

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

    def _wrench(self, topic: str, part: str, point: str | None, message: WrenchStamped) -> None:
        force, torque = message.wrench.force, message.wrench.torque
        vectors = (force.x, force.y, force.z), (torque.x, torque.y, torque.z)
        try:
            self.wrenches.take(part, point, message.header.frame_id, *vectors)
        except CommandError as error:
            self._reject(topic, error)

    def _reject(self, topic: str, error: CommandError) -> None:
        self.diagnostics.last_rejection = topic, error
        now = time.monotonic()
        if now - self._warned >= 1.0:  # the logger's own throttle looks at the stack of each call
            self._warned = now
            rejected = self.commands.rejected + self.wrenches.rejected
            self.get_logger().warning(f"{topic}: message rejected ({rejected} so far): {error}")

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        problem = self.runner.reset(self.parameters["reset_rewinds_clock"])
        response.success, response.message = not problem, problem or "at the start state"
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
                self._prioritize()
            case "publish_rate":
                self.rates.publish = value
            case "clock_rate":
                self.rates.clock = value
            case "command_timeout":
                self.commands.timeout = self.wrenches.timeout = value


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
    except (
        MbdSimError,
        ValueError,
        ImportError,
        InvalidParameterTypeException,
        InvalidParameterValueException,
    ) as error:
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
    while not ended.wait(LOOK):  # a signal that another thread receives does not wake this one
        pass
    node.stop()
    executor.shutdown()
    spinning.join(timeout=2.0)
    node.destroy_node()
    return 0


if __name__ == "__main__":
    sys.exit(main())
