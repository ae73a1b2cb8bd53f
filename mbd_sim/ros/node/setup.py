"""Builds the parts of `sim_node` from its parameters.

If that takes more than a second, the node says on the console and on `~/events` what its start does.
"""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, get_args

from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from mbd_sim.base.errors import InputError, listed, nearest
from mbd_sim.base.packages import MissingPackageError
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import load_mechanism
from mbd_sim.files.text.xml import Base
from mbd_sim.files.text.yaml_text import mechanism_text
from mbd_sim.files.urdf.control import INTERFACES
from mbd_sim.files.urdf.writer import ControlTopics, control_blocks, floating_joints
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.recordings.messages.events import robot_description
from mbd_sim.recordings.messages.states import AccelerationMessages, floating_transforms
from mbd_sim.recordings.messages.topics import (
    ACCELERATIONS,
    CLOCK,
    DIAGNOSTICS,
    EVENTS,
    JOINT_STATES,
    MARKERS,
    PART,
    ROBOT_DESCRIPTION,
    SENSORS,
    TF,
    TOPICS,
    OutputTopic,
    for_accelerations,
    for_each_part,
    for_each_sensor,
)
from mbd_sim.recordings.run.metadata import run_metadata
from mbd_sim.recordings.run.paths import FORMATS, new_recording_paths
from mbd_sim.recordings.run.recorder import Recorder
from mbd_sim.recordings.run.run_watch import RunWatch
from mbd_sim.ros.commands.command_buffer import CommandBuffer
from mbd_sim.ros.commands.joint_commands import CommandRanges
from mbd_sim.ros.commands.wrenches import ALL, WrenchTargets, wrench_targets
from mbd_sim.ros.node.parameters import NodeParameters
from mbd_sim.ros.node.subscriptions import JOINT_COMMANDS
from mbd_sim.ros.publishing.publishers import FOLLOWED_CLOCK, TopicPublisher, message_type
from mbd_sim.ros.publishing.recordings import NodeRecordings, SplitLimits
from mbd_sim.ros.publishing.ring import NodeRing, RingTrigger
from mbd_sim.ros.publishing.thread import PublishingThread
from mbd_sim.ros.stepping.clock import FollowedClock, Rates
from mbd_sim.ros.stepping.thread import SteppingThread
from mbd_sim.simulation.model.live_values import names_with_matches
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.run.events import EventKind
from mbd_sim.simulation.run.simulation import BaseSimulation

if TYPE_CHECKING:
    from mbd_sim.pictures.rerun.viewer import Viewer
    from mbd_sim.ros.node.lab import LabPage, PagedNode


LEAST_STEP = 1e-9  # s
KEPT_BLOCKS = (
    "the URDF has <ros2_control> blocks of its own ({names}), which stay: ros2_control:=true adds one for other joints "
    "only. To let them act in this node, add control:=position, velocity or effort"
)


def build_simulation(parameters: NodeParameters) -> tuple[BaseSimulation, WrenchTargets]:
    """The simulation, and the parts and points of it that accept wrenches.

    :raises MechanismError, ValueError: the file is wrong, or a parameter does not fit the mechanism.
    """
    mechanism = _with_seed(loaded_mechanism(parameters), parameters["sensor_seed"])
    if (step := parameters["step"] or mechanism.step) < LEAST_STEP:
        raise ValueError(f"step: a node needs steps of at least 1 ns, the resolution of time in ROS, not {step:g} s.")
    targets = wrench_targets(mechanism, parameters.names_in("wrenches"))
    live = parameters.names_in("live")
    if parameters.is_default("live"):
        live = names_with_matches(mechanism, live)
    simulation = BaseSimulation(
        mechanism,
        method=parameters["method"] or None,
        step=parameters["step"] or None,
        wrenches=tuple(dict.fromkeys(part for part, _ in targets)),
        live=live,
    )
    return simulation, targets


def loaded_mechanism(parameters: NodeParameters) -> Mechanism:
    """The mechanism of the parameters, on a floor and with stops where they say so.

    :raises ValueError: a parameter has an unknown word.
    """
    for name, words in (("base", get_args(Base)), ("limits", ("stops",)), ("control", INTERFACES)):
        if parameters[name] not in ("", *words):
            raise InputError(f"{name}: '{parameters[name]}' is not one of {', '.join(words)}", "Or leave it empty.")
    return load_mechanism(
        parameters["mechanism"],
        parameters["base"] or None,
        floor=parameters["floor"],
        limits=parameters["limits"] or None,
        control=parameters["control"] or None,
    )


def _with_seed(mechanism: Mechanism, seed: int) -> Mechanism:
    """The mechanism with the noise of its sensors by another seed; -1: that of the file.

    :raises ValueError: there are no sensors.
    """
    if seed < 0:
        return mechanism
    if not mechanism.sensors:
        raise InputError(f"sensor_seed: {mechanism.name} has no sensors", "Leave the parameter out.")
    return with_values(mechanism, {"sensor_seed": seed})


def command_buffer(parameters: NodeParameters, simulation: BaseSimulation) -> CommandBuffer:
    """The buffer of commands, with its watchdogs."""
    timeout, step_size = parameters["command_timeout"], simulation.step_size
    ranges = CommandRanges(simulation.mechanism)
    commands = CommandBuffer(simulation.effort_map, timeout, simulation.command_map, step_size, ranges)
    commands.watch_actuators(parameters["actuator_timeout"])
    commands.sample_trajectories(parameters["trajectory_rate"])
    commands.skip_nan(parameters["ros2_control"])
    return commands


def requested_topics(parameters: NodeParameters, model: Model, node: Node) -> list[OutputTopic]:
    """The topics of the publishing thread: those without a parameter, and those that their parameters request.

    :raises ValueError: a parameter names a part that does not exist.
    """
    requested: list[OutputTopic] = []
    part_names = model.part_names
    if parameters["tf_floating"] and not parameters["tf"]:
        requested += _floating_transforms(model.mechanism, node.get_logger())
    for topic in TOPICS:
        if topic in (CLOCK, MARKERS, DIAGNOSTICS) or (topic.parameter and not parameters[topic.parameter.name]):
            continue
        if topic is ROBOT_DESCRIPTION and parameters["ros2_control"]:
            topics = ControlTopics(*map(node.resolve_topic_name, (JOINT_COMMANDS, JOINT_STATES.name)))
            own = [block.attributes.get("name", "") for block in control_blocks(model.mechanism)]
            if own and not model.mechanism.source.data.get("control"):
                node.get_logger().warning(KEPT_BLOCKS.format(names=listed(own)))
            requested.append(replace(topic, at_start=partial(robot_description, control=topics)))
            continue
        if topic is SENSORS:
            requested += for_each_sensor(model.mechanism.sensors)
            continue
        if topic is ACCELERATIONS:
            requested.append(_accelerations(parameters.names_in("accelerations"), model))
            continue
        if PART not in topic.name or topic.parameter is None:
            requested.append(topic)
            continue
        name = topic.parameter.name
        parts = parameters.names_in(name)
        for part in parts:
            if part not in (*part_names, ALL):
                raise ValueError(f"{name}: there is no part '{part}'. {nearest(part, part_names)}")
        requested.extend(for_each_part(topic, part_names, part_names if ALL in parts else parts))
    return requested


def _accelerations(names: list[str], model: Model) -> OutputTopic:
    """The topic of the accelerations that a parameter names.

    :raises ValueError: there is no such part or point.
    """
    try:
        AccelerationMessages(model, names)
    except InputError as error:
        raise ValueError(f"accelerations: {error}") from error
    return for_accelerations(names)


def _floating_transforms(mechanism: Mechanism, log: Any) -> list[OutputTopic]:
    """/tf with the transforms of floating joints; none, which is logged, if tf2_msgs is not installed."""
    if not floating_joints(mechanism):
        return []
    try:
        message_type(TF.message_type)
    except ImportError:
        log.info("the transforms of floating joints are not published on /tf: tf2_msgs is not installed")
        return []
    return [replace(TF, on_state=floating_transforms)]


def node_recordings(
    parameters: NodeParameters, stepping_thread: SteppingThread, publishing_thread: PublishingThread, log: Any
) -> NodeRecordings:
    """The recordings of the node, of which none has been started.

    :raises ValueError: `record_format` is unknown.
    """
    simulation = stepping_thread.simulation
    mechanism, file_format = simulation.mechanism, parameters["record_format"]
    if file_format not in FORMATS:
        raise ValueError(f"record_format: there is no format '{file_format}'. {nearest(file_format, FORMATS)}")

    return NodeRecordings(
        partial(_open_recorder, parameters, mechanism, publishing_thread, mechanism.name),
        metadata=lambda moment: run_metadata(simulation, moment, parameters.values),
        request_moment=stepping_thread.request_moment,
        on_failure=lambda failure: log.error(f"{failure}. The simulation continues."),
        on_long_files=log.warning,
        limits=split_limits(parameters),
    )


def _open_recorder(
    parameters: NodeParameters, mechanism: Mechanism, publishing_thread: PublishingThread, name: str
) -> Recorder:
    """A recorder of a new recording with this name and the time.

    :raises RecordingError: it cannot be opened.
    """
    rosbag2 = parameters["record_format"] == "rosbag2"
    paths = new_recording_paths(Path(parameters["record_dir"]), name, rosbag2=rosbag2)
    return Recorder(paths, publishing_thread.recorded_topics(), mechanism_text(mechanism.source))


def node_ring(
    parameters: NodeParameters,
    stepping_thread: SteppingThread,
    publishing_thread: PublishingThread,
    recordings: NodeRecordings,
    log: Any,
) -> NodeRing | None:
    """The ring of the last seconds, with what triggers it; None without one.

    :raises ValueError: a parameter has no effect, or its event is not possible.
    """
    seconds, when, after = (parameters[f"record_{name}"] for name in ("last", "when", "after"))
    if (when or after) and not seconds:
        raise InputError("record_when, record_after: no last seconds are kept", "Give record_last too.")
    if after and not when:
        raise InputError("record_after: there is no event", "Give record_when too.")
    if not seconds:
        return None
    simulation = stepping_thread.simulation
    mechanism = simulation.mechanism
    try:
        watch = RunWatch(simulation, when, after, rest=seconds)
    except InputError as error:
        raise ValueError(f"record_when: {error}") from error

    def written(text: str) -> None:
        if stepping_thread.has_ended:
            log.info(text)
        else:
            stepping_thread.tell(EventKind.NOTE, text)

    ring = NodeRing(
        seconds,
        simulation.step_size,
        partial(_open_recorder, parameters, mechanism, publishing_thread, f"{mechanism.name}_last"),
        metadata=lambda moment: run_metadata(simulation, moment, parameters.values),
        request=recordings.request,
        on_written=written,
        on_failure=lambda failure: log.error(f"{failure}. The simulation continues."),
    )
    stepping_thread.run.output.watch = RingTrigger(ring, watch)
    return ring


def split_limits(parameters: NodeParameters) -> SplitLimits:
    """Where a recording continues in another file."""
    return SplitLimits(1e6 * parameters["record_split_size"], parameters["record_split_duration"])


def viewers(parameters: NodeParameters, simulation: BaseSimulation, log: Any) -> tuple[Viewer, ...]:
    """The viewers that are requested; one that cannot be opened is logged and left out."""
    if not (parameters["rerun"] or parameters["foxglove"]):
        return ()
    from mbd_sim.pictures.foxglove.viewer import FoxgloveViewer
    from mbd_sim.pictures.rerun.sinks import ViewerError
    from mbd_sim.pictures.rerun.viewer import Viewer

    opened: list[Viewer] = []
    port = str(parameters["foxglove"] or "")
    for kind, sink in ((Viewer, parameters["rerun"]), (FoxgloveViewer, port)):
        if not sink:
            continue
        try:
            viewer = kind(
                simulation.model,
                sink,
                rate=None,  # the stepping thread selects the samples
                traces=parameters.names_in("rerun_traces") or None,
                trace_time=parameters["rerun_trace_time"],
                reactions=parameters["joint_reactions"],
            )
        except (ViewerError, ValueError) as error:
            log.error(f"{error} The run is not shown.")
            continue
        log.info(f"showing in {viewer.program}: {viewer.address}")
        opened.append(viewer)
    return tuple(opened)


def lab_page(node: PagedNode) -> LabPage | None:
    """The page of the node; None if it is not requested, or if viser is not installed, which is logged."""
    if not node.parameters["lab"]:
        return None
    from mbd_sim.ros.node.lab import LabPage

    try:
        return LabPage(node)
    except MissingPackageError as error:
        node.get_logger().error(f"{error} The run has no page.")
        return None


def initial_rates(parameters: NodeParameters, *, leads: bool) -> Rates:
    """The rates at the start; only a node that leads publishes the clock."""
    clock = parameters["clock_rate"] if leads else 0.0
    return Rates(parameters["real_time_factor"], parameters["publish_rate"], clock, parameters["marker_rate"])


def followed_clock(
    node: Node, parameters: NodeParameters, leader: SteppingThread | None = None
) -> FollowedClock | None:
    """The clock that the node follows with `use_sim_time`; None if it has a clock of its own.

    :param leader: feeds the clock; by default it is fed from `/clock`.
    :raises ValueError: a parameter contradicts a followed clock.
    """
    parameters.fix("use_sim_time", "set use_sim_time when starting the node: it decides whose clock the node follows.")
    if not node.get_parameter("use_sim_time").value:
        return None
    for name, value in (("real_time_factor", 1.0), ("reset_rewinds_clock", False)):
        reason = f"with use_sim_time, time is that of /clock: set {name} in the node that publishes it."
        if parameters[name] != value:
            raise ValueError(f"{name} cannot be {parameters[name]} here: {reason}")
        parameters.fix(name, reason)
    clock = FollowedClock()
    if leader is not None:
        return clock

    def take(message: Clock) -> None:
        clock.take(message.clock.sec * 1_000_000_000 + message.clock.nanosec)

    node.create_subscription(Clock, CLOCK.name, take, FOLLOWED_CLOCK)
    return clock


SOURCE = "mbd_sim"  # the logger whose messages are reported
PATIENCE, PERIOD = 1.0, 5.0  # s until the first report, and between those that follow


class BuildProgress(logging.Handler):
    """While it is entered, what is being done, and for how long so far, appears on the console and on `~/events`.

    The package's own logger says what is being done; its messages of the level INFO appear at once. They are not
    recorded: there is no run yet.
    """

    def __init__(self, node: Node, first: str) -> None:
        """`first` is what is done at first, such as "reading robot.urdf"."""
        super().__init__(logging.DEBUG)
        self._node, self._publisher = node, TopicPublisher(node, EVENTS).publisher
        self._logger = logging.getLogger(SOURCE)
        self._level = self._logger.level
        self._doing, self._ended = first, threading.Event()
        self._began = self._said = time.monotonic()
        self._thread = threading.Thread(target=self._report, daemon=True, name="progress")

    def emit(self, record: logging.LogRecord) -> None:
        """Note a message, and say it if it is important."""
        text = record.getMessage()
        if record.levelno >= logging.INFO:
            self._say(text)
        else:
            self._doing = text

    def _say(self, text: str) -> None:
        self._said = time.monotonic()
        self._node.get_logger().info(text)
        self._publisher.publish(String(data=text))

    def _report(self) -> None:
        wait = PATIENCE
        while not self._ended.wait(wait):
            now = time.monotonic()
            if now - self._said >= wait:
                self._say(f"{self._doing}: {now - self._began:.0f} s so far")
            wait = self._said + PERIOD - time.monotonic()

    def __enter__(self) -> BuildProgress:
        self._logger.addHandler(self)
        self._logger.setLevel(logging.DEBUG)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()
        self._logger.removeHandler(self)
        self._logger.setLevel(self._level)
        if kind is None and (elapsed := time.monotonic() - self._began) >= PATIENCE:
            self._say(f"done after {elapsed:.1f} s")
        self._node.destroy_publisher(self._publisher)
