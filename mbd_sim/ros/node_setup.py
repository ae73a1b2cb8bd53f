"""Builds the parts of `sim_node` from its parameters."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from mbd_sim.errors import InputError, listed, nearest
from mbd_sim.load import load_mechanism
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism_file.override import with_values
from mbd_sim.mechanism_file.yaml_writer import mechanism_text
from mbd_sim.messages.acceleration_messages import Accelerations
from mbd_sim.messages.event_messages import robot_description
from mbd_sim.messages.state_messages import floating_transforms
from mbd_sim.messages.topics import (
    ACCELERATIONS,
    CLOCK,
    DIAGNOSTICS,
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
from mbd_sim.recording.recorder import Recorder
from mbd_sim.recording.recording_paths import FORMATS, new_recording_paths
from mbd_sim.recording.run_metadata import run_metadata
from mbd_sim.ros.command_buffer import CommandBuffer
from mbd_sim.ros.command_ranges import CommandRanges
from mbd_sim.ros.followed_clock import FollowedClock
from mbd_sim.ros.message_types import message_type
from mbd_sim.ros.node_parameters import NodeParameters
from mbd_sim.ros.node_recordings import NodeRecordings, SplitLimits
from mbd_sim.ros.publishing_thread import PublishingThread
from mbd_sim.ros.qos import FOLLOWED_CLOCK
from mbd_sim.ros.rates import Rates
from mbd_sim.ros.stepping_thread import SteppingThread
from mbd_sim.ros.subscriptions import JOINT_COMMANDS
from mbd_sim.ros.wrench_buffer import ALL, WrenchTargets, wrench_targets
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.live_search import names_with_matches
from mbd_sim.simulation.simulation import Simulation
from mbd_sim.urdf.ros2_control import ControlTopics
from mbd_sim.urdf.urdf_writer import floating_joints

if TYPE_CHECKING:
    from mbd_sim.viewer import Viewer

LEAST_STEP = 1e-9  # s
KEPT_BLOCKS = (
    "the URDF has <ros2_control> blocks of its own ({names}), which stay: ros2_control:=true adds one for other joints "
    "only. To control their joints in this node, remove these blocks, or give them the plugin and topics that "
    "docs/ros2_control.md describes"
)


def build_simulation(parameters: NodeParameters) -> tuple[Simulation, WrenchTargets]:
    """The simulation, and the parts and points of it that accept wrenches.

    :raises MechanismError, ValueError: the file is wrong, or a parameter does not fit the mechanism.
    """
    mechanism = _with_seed(load_mechanism(parameters["mechanism"]), parameters["sensor_seed"])
    if (step := parameters["step"] or mechanism.step) < LEAST_STEP:
        raise ValueError(f"step: a node needs steps of at least 1 ns, the resolution of time in ROS, not {step:g} s.")
    targets = wrench_targets(mechanism, parameters.names_in("wrenches"))
    live = parameters.names_in("live")
    if parameters.is_default("live"):
        live = names_with_matches(mechanism, live)
    simulation = Simulation(
        mechanism,
        method=parameters["method"] or None,
        step=parameters["step"] or None,
        wrenches=tuple(dict.fromkeys(part for part, _ in targets)),
        live=live,
    )
    return simulation, targets


def _with_seed(mechanism: Mechanism, seed: int) -> Mechanism:
    """The mechanism with the noise of its sensors by another seed; -1: that of the file.

    :raises ValueError: there are no sensors.
    """
    if seed < 0:
        return mechanism
    if not mechanism.sensors:
        raise ValueError(f"sensor_seed: {mechanism.name} has no sensors. Leave the parameter out.")
    return with_values(mechanism, {"sensor_seed": seed})


def command_buffer(parameters: NodeParameters, simulation: Simulation) -> CommandBuffer:
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
            if own := [block.attributes.get("name", "") for block in model.mechanism.source.ros2_control]:
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
        Accelerations(model, names)
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

    def open_recorder() -> Recorder:
        paths = new_recording_paths(Path(parameters["record_dir"]), mechanism.name, rosbag2=file_format == "rosbag2")
        return Recorder(paths, publishing_thread.recorded_topics(), mechanism_text(mechanism.source))

    return NodeRecordings(
        open_recorder,
        metadata=lambda moment: run_metadata(simulation, moment, parameters.values),
        request_moment=stepping_thread.request_moment,
        on_failure=lambda failure: log.error(f"{failure}. The simulation continues."),
        on_long_files=log.warning,
        limits=split_limits(parameters),
    )


def split_limits(parameters: NodeParameters) -> SplitLimits:
    """Where a recording continues in another file."""
    return SplitLimits(1e6 * parameters["record_split_size"], parameters["record_split_duration"])


def rerun_viewer(parameters: NodeParameters, simulation: Simulation, log: Any) -> Viewer | None:
    """The Rerun viewer; None if it is not requested, or if it cannot be opened, which is logged."""
    if not parameters["rerun"]:
        return None
    from mbd_sim.viewer import Viewer, ViewerError

    try:
        viewer = Viewer(
            simulation.model,
            parameters["rerun"],
            rate=None,  # the stepping thread selects the samples
            traces=parameters.names_in("rerun_traces") or None,
            trace_time=parameters["rerun_trace_time"],
            reactions=parameters["joint_reactions"],
        )
    except (ViewerError, ValueError) as error:
        log.error(f"{error} The run is not shown.")
        return None
    log.info(f"showing in Rerun: {viewer.address}")
    return viewer


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
