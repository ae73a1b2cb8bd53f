"""`ros2 run mbd_sim sim_node`: a mechanism file as a real-time ROS 2 node.

One program can have several mechanisms: a node for each, in a namespace of its own, all on the clock of the first.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter

from mbd_sim.base.errors import CommandError, InputError, counted, listed
from mbd_sim.recordings.messages.definitions import topic_names
from mbd_sim.recordings.messages.events import rate_remark
from mbd_sim.recordings.messages.states import Due
from mbd_sim.recordings.messages.topics import SENSORS, TOPICS
from mbd_sim.ros.commands.wrenches import WrenchBuffer
from mbd_sim.ros.node.diagnostics import PERIOD, Diagnostics
from mbd_sim.ros.node.parameters import NodeParameters, program_help
from mbd_sim.ros.node.program import run_node
from mbd_sim.ros.node.services import SERVICES, RunServices
from mbd_sim.ros.node.setup import (
    BuildProgress,
    build_simulation,
    command_buffer,
    followed_clock,
    initial_rates,
    lab_page,
    node_recordings,
    node_ring,
    requested_topics,
    split_limits,
    viewers,
)
from mbd_sim.ros.node.sim_parameters import PARAMETERS, bare_angles_of, named_starts, start_values
from mbd_sim.ros.node.subscriptions import SUBSCRIBED, Subscriptions
from mbd_sim.ros.node.trajectory_action import serve_trajectory_action
from mbd_sim.ros.publishing.thread import PublishingThread
from mbd_sim.ros.standard.position_ik import serve_position_ik
from mbd_sim.ros.standard.simulation import serve_simulation_interfaces
from mbd_sim.ros.stepping import realtime
from mbd_sim.ros.stepping.thread import SteppingThread
from mbd_sim.simulation.run.changes import StateValues

# Of the nodes that follow: what belongs to a clock is decided by the leader.
OF_THE_LEADER: dict[str, Any] = {
    "use_sim_time": True,
    "real_time_factor": 1.0,
    "reset_rewinds_clock": False,
    "start_paused": False,
}


@dataclass(frozen=True, slots=True)
class Member:
    """A mechanism, and the namespace of its node within that of the program."""

    namespace: str
    mechanism: str


def members(text: str) -> list[Member]:
    """The entries of the parameter `mechanisms`: `namespace=mechanism`, or a mechanism that gives its name to both.

    :raises ValueError: two entries have the same namespace, or one is not a valid namespace.
    """
    found: list[Member] = []
    for entry in filter(None, (entry.strip() for entry in text.split(","))):
        namespace, equals, mechanism = (part.strip() for part in entry.partition("="))
        member = Member(namespace, mechanism if equals else namespace)
        if (equals and not mechanism) or topic_names([namespace])[namespace] != namespace:
            raise InputError(
                f"mechanisms: '{entry}' gives no valid namespace and mechanism",
                "Write NAMESPACE=MECHANISM, with letters, digits and underscores in the namespace.",
            )
        if namespace in [other.namespace for other in found]:
            raise InputError(f"mechanisms: the namespace '{namespace}' is given twice", "Write NAMESPACE=MECHANISM.")
        found.append(member)
    return found


def node_options() -> list[dict[str, Any]]:
    """The options of each node of the program, the leader's first, as the parameter `mechanisms` asks.

    :raises ValueError: see `members`.
    """
    probe = Node("sim_node", start_parameter_services=False, enable_rosout=False)
    try:
        group = members(str(probe.declare_parameter("mechanisms", "").value))
        base = probe.get_namespace().rstrip("/")
        given = probe._parameter_overrides
        prefix = str(given["frame_prefix"].value) if "frame_prefix" in given else ""
    finally:
        probe.destroy_node()
    if not group:
        return [{}]
    options = []
    for number, member in enumerate(group):
        values = {"mechanism": member.mechanism, "frame_prefix": f"{prefix}{member.namespace}/"}
        values |= OF_THE_LEADER if number else {}
        options.append(
            {
                "cli_args": ["--ros-args", "-r", f"__ns:={base}/{member.namespace}"],
                "parameter_overrides": [Parameter(name, value=value) for name, value in values.items()],
            }
        )
    return options


RATES = ("publish_rate", "clock_rate", "marker_rate", "rerun_rate")
EXAMPLE = "mechanism:=double_rod"
MAX_OVERRUNS = 3  # overruns a second from which the node gives up its real-time priority


class SimNode(Node):  # type: ignore[misc]  # rclpy carries no types
    """Runs a mechanism in real time: publishes states and energies, accepts efforts and wrenches, records the run."""

    def __init__(self, end: Callable[[], None], *, leader: SimNode | None = None, **options: Any) -> None:
        """Build all parts; `end` is called when a service asks the program to end.

        :param leader: a node of this program whose clock the node follows.
        :param options: of `rclpy.node.Node`.
        """
        super().__init__("sim_node", **options)
        self.companions: list[SimNode] = []  # the nodes of this program that follow this one
        specs = (*PARAMETERS, *named_starts(self))
        parameters = self.parameters = NodeParameters(self, specs, self._on_parameter_change)
        with BuildProgress(self, f"reading {parameters['mechanism']}"):
            self.simulation, wrench_targets = build_simulation(parameters)
        simulation, frame_prefix = self.simulation, parameters["frame_prefix"]
        given = parameters.add_live(lambda: simulation.live, self._set_live)
        self._apply_initial(given)
        self._unknown_parameters = parameters.finish()
        self.commands = command_buffer(parameters, simulation)
        parts = simulation.model.part_names
        self.wrenches = WrenchBuffer(simulation.wrench_map, parts, self.commands.timeout, frame_prefix)
        self.followed = followed_clock(self, parameters, leader.stepping_thread if leader else None)
        self.rates = initial_rates(parameters, leads=self.followed is None)
        self.stepping_thread: SteppingThread = SteppingThread(
            simulation,
            self.commands,
            self.rates,
            wrenches=self.wrenches,
            paused=parameters["start_paused"],
            followed=self.followed,
            start=self._begin_at_start(),
        )
        self.publishing_thread = PublishingThread(
            self,
            simulation.model,
            requested_topics(parameters, simulation.model, self),
            frame_prefix=frame_prefix,
            clock=self.rates.clock > 0.0,
            step_size=simulation.step_size,
        )
        with BuildProgress(self, "deriving and compiling what the outputs need"):
            self.publishing_thread.prepare(self.stepping_thread.run.output.journal.snapshot(Due.NEW))
        self.recordings = node_recordings(parameters, self.stepping_thread, self.publishing_thread, self.get_logger())
        self.publishing_thread.recordings = self.recordings
        self.publishing_thread.viewers = viewers(parameters, simulation, self.get_logger())
        self.rates.view = parameters["rerun_rate"] if self.publishing_thread.viewers else 0.0
        subscriptions = self.subscribed = Subscriptions(
            self,
            simulation.mechanism,
            self.commands,
            self.wrenches,
            wrench_targets,
            self.step_on_command,
            self.stepping_thread.set_state,
            self.stepping_thread.warn,
            self.stepping_thread.clock,
            parameters["stamped_cmd_vel"],
        )
        self.diagnostics = Diagnostics(self, self.stepping_thread, subscriptions, self.publishing_thread)
        self._priority = parameters["real_time_priority"]
        self.create_timer(PERIOD, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._serve(end)

    def _serve(self, end: Callable[[], None]) -> None:
        """Offer the services, and the action, that control the run from outside; keep what one of them writes."""
        thread, parameters = self.stepping_thread, self.parameters
        self.ring = node_ring(parameters, thread, self.publishing_thread, self.recordings, self.get_logger())
        self.publishing_thread.ring = self.ring
        # The threads of a recording are new, and need their priority.
        self.run_services = RunServices(self, thread, parameters, self.recordings, self.ring, self._prioritize)
        prefix = parameters["frame_prefix"]
        self.simulation_services = serve_simulation_interfaces(self, thread, end, prefix)
        self.position_ik = serve_position_ik(self, thread, prefix, lambda: bool(parameters["position_only_ik"]))
        self.trajectory_action = None
        if parameters["follow_joint_trajectory"]:
            self.trajectory_action = serve_trajectory_action(self, thread, self.subscribed.reject)
        self.lab = lab_page(self)

    def start(self) -> None:
        """Start to record, to publish and to step; first the nodes that follow."""
        for companion in self.companions:
            self.stepping_thread.followers.append(companion.stepping_thread)
            companion.start()
        simulation, log = self.simulation, self.get_logger()
        state = "paused" if self.stepping_thread.paused else "running"
        freedom = simulation.model.degrees_of_freedom
        log.info(
            f"'{simulation.mechanism.name}' is {state}: {freedom} degree{'' if freedom == 1 else 's'} of freedom, "
            f"method {simulation.model.method_name}, step {simulation.step_size * 1e3:g} ms"
        )
        if self._unknown_parameters:
            log.warning(f"unknown parameters are ignored: {listed(self._unknown_parameters)}")
        for name in RATES:
            self._remark_on_rate(name)
        if self._priority and (refusal := realtime.lock_memory()):
            self._add_note(refusal)
        if self.followed is not None:
            log.info("following /clock: waiting for the node that publishes it")
        # What is recorded of a run that follows a clock begins when that clock is known.
        if self.ring is not None and self.followed is not None:
            self.recordings.request(self.ring.begin)
        elif self.ring is not None:
            self.ring.begin(self.stepping_thread.moment())
        elif self.parameters["record"]:
            started, answer = self.recordings.start(None if self.followed else self.stepping_thread.moment())
            if not started:
                log.error(f"{answer} The run is not recorded.")
            else:
                log.info(f"recording to {answer}")
        self.publishing_thread.start(self.stepping_thread.run.output, simulation.live)
        self.diagnostics.restart()
        self.stepping_thread.start()
        self._prioritize()

    def stop(self) -> None:
        """Stop stepping, then everything fed by it; the recording is finished when this returns."""
        self.stepping_thread.stop()
        for companion in self.companions:
            companion.stop()
        self.publishing_thread.join()
        if self.ring is not None:
            writes = self.parameters["record"] and not self.parameters["record_when"]
            self.ring.close("end of the run" if writes else "")
        for beside in (self.lab, self.position_ik):
            if beside is not None:
                beside.close()
        self.diagnostics.collection.close()
        energies = self.publishing_thread.energies
        residual = f", energy residual {energies.residual:.1e} J" if energies is not None else ""
        pacer = self.stepping_thread.pacer
        self.get_logger().info(
            f"stopped after {counted(self.stepping_thread.ticks, 'step')}{residual}; "
            f"{pacer.lateness.summary().in_words()}; {counted(pacer.overruns, 'overrun')}"
        )
        if lost := self.stepping_thread.counters.dropped:
            self.get_logger().warning(
                f"{counted(lost, 'snapshot')} with states and measurements were neither published nor recorded: "
                "publishing could not keep up"
            )
        if summary := self.recordings.closing_summary():
            self.get_logger().info(summary)

    def _apply_initial(self, changes: Mapping[str, float]) -> None:
        """Start with live values that differ from the file's.

        :raises CommandError, ValueError: one does not fit, or the loops cannot be closed with them.
        """
        if changes:
            self.simulation.set_live(changes, reassemble=True)
            self.simulation.reset()

    def _set_live(self, changes: Mapping[str, float]) -> str:
        return self.stepping_thread.set_live(changes, reassemble=self.parameters["reassemble"])

    def _begin_at_start(self) -> StateValues | None:
        """Begin the run at the start that the parameters give, and return it.

        :raises CommandError: it does not fit the mechanism, or the loops cannot be closed there.
        """
        start = self._start_of_parameters()
        self.parameters.check(self._problem_of_start)
        if start is not None:
            self.simulation.reset(*start)
        return start

    def _start_of_parameters(self) -> StateValues | None:
        """The start that the parameters give, to which resets return.

        :raises CommandError: it does not fit the mechanism.
        """
        values = self.parameters.values
        for remark in bare_angles_of(values["start"], values, self.simulation.mechanism):
            self.get_logger().warning(remark)
        return start_values(values["start"], values, self.simulation.model)

    def _problem_of_start(self, values: Mapping[str, Any]) -> str:
        """The problem with the start of all parameters, or ""."""
        try:
            start_values(values["start"], values, self.simulation.model)
        except CommandError as error:
            return str(error)
        return ""

    def _prioritize(self) -> None:
        """Request real-time priority, except when running as fast as possible: that would starve the machine."""
        priority = self._priority if self.rates.real_time_factor > 0.0 else 0
        if self._priority and (refusal := realtime.prioritize(priority)):
            self._add_note(refusal)
            self._priority = 0

    def _add_note(self, text: str) -> None:
        self.get_logger().info(text)
        self.diagnostics.notes.append(text)

    def _on_timer(self) -> None:
        if self._priority and self.diagnostics.recent_overruns >= MAX_OVERRUNS:
            realtime.prioritize(0)
            self._priority = 0
            self._add_note("stepping uses all available time, so it continues without real-time priority")
        self.subscribed.fit_reliability()
        self.diagnostics.publish()

    def step_on_command(self) -> None:
        """Lockstep: a command triggers its steps itself, so that command and steps cannot overtake each other."""
        if self.stepping_thread.paused and self.parameters["step_on_command"]:
            self.stepping_thread.step(self.parameters["step_count"])

    def _on_parameter_change(self, name: str, value: Any) -> None:
        match name:
            case "real_time_factor":
                self.rates.real_time_factor = value
                self.stepping_thread.restart_schedule()
                self._prioritize()
            case "publish_rate":
                self.rates.publish = value
            case "clock_rate" if self.followed is None:
                self.publishing_thread.publish_clock(value > 0.0)
                self.rates.clock = value
            case "marker_rate":
                self.rates.markers = value
            case "rerun_rate":
                self.rates.view = value if self.publishing_thread.viewers else 0.0
            case "command_timeout":
                self.commands.timeout = self.wrenches.timeout = value
            case "actuator_timeout":
                self.commands.watch_actuators(value)
            case "trajectory_rate":
                self.commands.sample_trajectories(value)
            case "record_split_size" | "record_split_duration":
                self.recordings.limits = split_limits(self.parameters)
        if name == "start" or name.startswith("starts."):
            self.stepping_thread.run.start_values = self._start_of_parameters()
        self._remark_on_rate(name)

    def _remark_on_rate(self, name: str) -> None:
        """Say what a rate becomes that no step size of this simulation can give."""
        if name in RATES and (remark := rate_remark(name, self.parameters[name], self.simulation.step_size)):
            self.get_logger().warning(remark)


def _make_node(end: Callable[[], None]) -> SimNode:
    leader, *others = node_options()
    node = SimNode(end, **leader)
    node.companions = [SimNode(end, leader=node, **options) for options in others]
    realtime.freeze_memory()
    return node


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM."""
    return run_node("sim_node", _make_node, arguments, example=EXAMPLE, help_text=help_text)


def help_text() -> str:
    """What `--help` prints."""
    types = {topic.name: topic.message_type for topic in TOPICS} | {SENSORS.name: "by the type of the sensor"}
    published = [(topic.name, f"{types[topic.name]}, {topic.when.value}") for topic in TOPICS]
    sections = {"published topics": published, "subscribed topics": SUBSCRIBED, "services": SERVICES}
    return program_help("sim_node", "Runs a mechanism in real time.", EXAMPLE, PARAMETERS, sections)


if __name__ == "__main__":
    sys.exit(main())
