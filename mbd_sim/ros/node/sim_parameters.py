"""The parameters of `sim_node`, among them those of the start of a run.

Parameters that request a topic are declared with the topic, in `topics`. The parameter `start` lists values or names
one of `starts.<name>`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from rclpy.node import Node

from mbd_sim.base.errors import CommandError, InputError, nearest, quoted
from mbd_sim.files.checks.bare_angles import bare_argument_remark
from mbd_sim.files.text.units import parse_value
from mbd_sim.mechanism.contents import commanded_drives
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.names import split_assignment, split_words
from mbd_sim.recordings.messages.topics import TOPICS
from mbd_sim.ros.node.parameters import ALL, ParameterSpec
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.run.changes import StateValues, checked_values

PARAMETERS = (
    ParameterSpec(
        "mechanism", "double_rod",
        "a mechanism file, a URDF, MJCF, SDF or xacro file (with its arguments: 'FILE NAME:=VALUE …'), or a shipped "
        "mechanism",
    ),
    ParameterSpec(
        "mechanisms", "",
        "several mechanisms, each with a node in its own namespace, on the clock of the first: "
        "'left=double_rod, four_bar'",
    ),
    ParameterSpec(
        "base", "", "fixed or free: how the root link of a URDF or SDF is attached to ground; empty: as the file says"
    ),
    ParameterSpec(
        "floor", False, "put a floor at z = 0, and a free base where its lowest point touches it"
    ),
    ParameterSpec("limits", "", "stops: the limits of joints are rigid stops; empty: as the file says"),
    ParameterSpec("method", "", "integration method; empty: from the mechanism file"),
    ParameterSpec("step", 0.0, "integration step in s; 0: from the mechanism file", 0.0, 1.0),
    ParameterSpec(
        "publish_rate", 100.0, "joint_states and energies messages per simulated second", 0.0, 100_000.0, live=True
    ),
    ParameterSpec("clock_rate", 200.0, "/clock messages per simulated second; 0: none", 0.0, 100_000.0, live=True),
    ParameterSpec("real_time_factor", 1.0, "1: real time; 0: as fast as possible", 0.0, 1000.0, live=True),
    ParameterSpec("start_paused", False, "wait for ~/pause or ~/step before the first step"),
    ParameterSpec(
        "start", "",
        "state at the start and after a reset: 'hip = 30 deg, knee.velocity = 1', or the name of a parameter "
        "starts.NAME; empty: from the mechanism file", live=True,
    ),
    ParameterSpec(
        "command_timeout", 0.5,
        "simulated s after the last command for a joint until its effort is set to zero; 0: never",
        0.0, 1e6, live=True,
    ),
    ParameterSpec(
        "actuator_timeout", 0.0,
        "simulated s after the last command for an actuator until only its position is held and all else is zero; "
        "0: never",
        0.0, 1e6, live=True,
    ),
    ParameterSpec(
        "follow_joint_trajectory", False,
        "serve the action ~/follow_joint_trajectory of control_msgs, if that package is installed",
    ),
    ParameterSpec(
        "position_only_ik", False,
        "whether ~/compute_ik of moveit_msgs, if that package is installed, leaves the orientation free", live=True,
    ),
    ParameterSpec(
        "stamped_cmd_vel", False,
        "whether the velocities of bases on wheels, on cmd_vel, are TwistStamped instead of Twist",
    ),
    ParameterSpec(
        "trajectory_rate", 1000.0, "commands computed from a trajectory per simulated second; at most one in each step",
        1.0, 100_000.0, live=True,
    ),
    ParameterSpec(
        "sensor_seed", -1, "whole number that selects the noise of all sensors; -1: from the mechanism file", -1, 10**15
    ),
    ParameterSpec(
        "reassemble", False,
        "whether a live value that would open loops assembles the mechanism anew from where it is, or is refused",
        live=True,
    ),
    ParameterSpec("step_count", 1, "steps taken by one call of ~/step", 1, 1_000_000, live=True),
    ParameterSpec("step_on_command", False, "while paused, each command triggers step_count steps", live=True),
    ParameterSpec("reset_rewinds_clock", False, "whether ~/reset sets /clock back to zero", live=True),
    ParameterSpec("record", True, "record the run from the start; ~/record starts and stops a recording"),
    ParameterSpec("record_dir", "recordings", "folder of the recordings, relative to the node's working directory"),
    ParameterSpec("record_format", "mcap", "mcap: one file; rosbag2: a folder with metadata.yaml"),
    ParameterSpec(
        "record_split_size", 0.0, "MB after which a recording continues in another file, at most every 0.1 s; 0: never",
        0.0, 1e9, live=True,
    ),
    ParameterSpec(
        "record_split_duration", 0.0, "simulated s after which a recording continues in another file; 0: never",
        0.0, 1e9, live=True,
    ),
    ParameterSpec(
        "record_last", 0.0,
        "simulated s of which the last ones are kept in memory, instead of recording the run from the start, until "
        "~/record_last, an event or a failure writes them, or the end with record; 0: none",
        0.0, 1e6,
    ),
    ParameterSpec(
        "record_when", "",
        "with record_last: the event that writes them: impact, or a condition such as 'abs(elbow.velocity) > 3'",
    ),
    ParameterSpec("record_after", 0.0, "with record_when: simulated s after the event", 0.0, 1e6),
    ParameterSpec(
        "wrenches", ALL,
        "parts and points (part.point) that accept wrenches, separated by commas; all; or empty: none", takes_all=True,
    ),
    ParameterSpec(
        "live", "gravity[*], parameters.*, forces.*, joints.*.stiffness, joints.*.damping",
        "values of the mechanism file that are parameters of this node; all; or empty: none", takes_all=True,
    ),
    ParameterSpec("rerun", "", "show the run in Rerun: spawn, serve, connect, connect:URL, or a file.rrd; empty: off"),
    ParameterSpec(
        "foxglove", 0, "show the run to Foxglove by a server on this port, such as 8765; 0: off", 0, 65535
    ),
    ParameterSpec(
        "rerun_rate", 60.0, "updates of the scene in Rerun and Foxglove per simulated second", 1.0, 10_000.0, live=True
    ),
    ParameterSpec(
        "rerun_traces", "",
        "parts and points (part.point) whose paths are drawn, separated by commas; empty: chain ends",
    ),
    ParameterSpec("rerun_trace_time", 1.0, "length of the drawn paths in simulated s", 0.01, 1e6),
    ParameterSpec("lab", False, "open the page of `mbd_sim lab` on this run; it needs the extra lab"),
    ParameterSpec("lab_port", 8080, "port of this page; 0: a free one", 0, 65535),
    ParameterSpec("lab_host", "127.0.0.1", "where this page listens; 0.0.0.0: also for other machines, with a token"),
    ParameterSpec(
        "marker_rate", 30.0, "markers per simulated second, while subscribed; 0: none", 0.0, 1000.0, live=True
    ),
    *(
        ParameterSpec(
            topic.parameter.name, topic.parameter.default, topic.parameter.description,
            takes_all=isinstance(topic.parameter.default, str),
        )
        for topic in TOPICS
        if topic.parameter is not None
    ),
    ParameterSpec(
        "tf_floating", True,
        "publish on /tf the transforms of free and spherical joints, which robot_state_publisher does not; see also tf",
    ),
    ParameterSpec(
        "ros2_control", False,
        "add a block for ros2_control's JointStateTopicSystem to robot_description, and take NaN in joint_commands as "
        "no command",
    ),
    ParameterSpec(
        "control", "",
        "position, velocity or effort: make the <ros2_control> blocks of the robot act; of several command interfaces, "
        "a joint serves this one; empty: they do not act",
    ),
    ParameterSpec("frame_prefix", "", "prefix of all frame names, for several nodes: name/"),
    ParameterSpec("real_time_priority", 20, "SCHED_FIFO priority of the stepping thread, if permitted; 0: none", 0, 90),
)  # fmt: skip


PREFIX = "starts."
_SPEED = ".velocity"
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


def named_starts(node: Node) -> list[ParameterSpec]:
    """The parameters `starts.<name>` that were given when the node was started."""
    names = sorted(name for name in node._parameter_overrides if name.startswith(PREFIX))
    return [ParameterSpec(name, "", "a named start: values as in the parameter 'start'", live=True) for name in names]


def start_values(text: str, parameters: Mapping[str, Any], model: Model) -> StateValues | None:
    """The values of a start; None for an empty text, which is the start of the mechanism's file.

    :param text: the name of a start, or `joint = value` entries separated by commas, such as
        `hip = 30 deg, knee.velocity = 1`; numbers without a unit are in SI units.
    :param parameters: those of the node.
    :raises CommandError: no such start or joint, or a value that is not a number of the joint's dimension.
    """
    text = text.strip()
    if not text:
        return None
    if "=" not in text:
        names = [name.removeprefix(PREFIX) for name in parameters if name.startswith(PREFIX)]
        if text not in names:
            remedy = nearest(text, names) or "Give joint = value, or define it as a parameter: starts.NAME."
            raise CommandError(f"start: there is no start '{text}'", remedy)
        text = str(parameters[PREFIX + text])
    positions: dict[str, float] = {}
    speeds: dict[str, float] = {}
    for entry in split_words(text, ","):
        name, value, is_speed = _entry(entry, model)
        values = speeds if is_speed else positions
        if name in values:
            raise CommandError(f"start: {name} is given twice", "Give one value.")
        values[name] = value
    try:
        return checked_values(model, positions, speeds, at_start=True)
    except CommandError as error:
        raise CommandError(f"start: {error.message}", error.remedy) from error


def _entry(text: str, model: Model) -> tuple[str, float, bool]:
    name, value = split_assignment(text)
    if not value:
        raise CommandError(f"start: '{text.strip()}' is not of the form joint = value")
    units = coordinate_units(model.mechanism)
    is_speed = name not in units and name.endswith(_SPEED)
    name = name.removesuffix(_SPEED) if is_speed else name
    unit = units.get(name)
    try:
        return name, parse_value(value, {}, f"{unit}/s" if is_speed and unit else unit), is_speed
    except InputError as error:
        raise CommandError(f"start: {name} = {quoted(value)}: {error.message}", error.remedy) from error


def bare_angles_of(text: str, parameters: Mapping[str, Any], mechanism: Mechanism) -> list[str]:
    """A sentence on each angle of a start that exceeds a full turn and has no unit."""
    units = coordinate_units(mechanism)
    pairs = [split_assignment(entry) for entry in split_words(str(parameters.get(PREFIX + text.strip(), text)), ",")]
    angles = [(name, value) for name, value in pairs if units.get(name) == "rad" and _NUMBER.fullmatch(value)]
    found = [bare_argument_remark(f"start: {name} = {value}", [float(value)]) for name, value in angles]
    return [remark for remark in found if remark]


def coordinate_units(mechanism: Mechanism) -> dict[str, str]:
    """The SI unit of each coordinate that has a start by its name: of free ones, and of drives that follow commands."""
    names = (*mechanism.coordinate_names, *commanded_drives(mechanism))
    return {name: mechanism.coordinate(name).unit for name in names}
