"""All topics of a run: one entry each. `sim_node` publishes them; recordings contain them, with ROS or without."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial

from mbd_sim.mechanism.sensors import AnySensor
from mbd_sim.messages import event_messages, qos, state_messages
from mbd_sim.messages.acceleration_messages import COORDINATES, accelerations
from mbd_sim.messages.event_messages import EventWriter
from mbd_sim.messages.qos import OfferedQos
from mbd_sim.messages.state_messages import StateWriter
from mbd_sim.messages.topic_names import topic_names
from mbd_sim.simulation.compiled_model import Model

NODE = "sim_node"  # the name of the node, which replaces ~ in the names of topics
SENSOR = "<sensor>"  # stands for the name of a sensor in the name of an entry
PART = "<part>"  # in the name of an entry that stands for one topic for each requested part


class When(Enum):
    """When a topic is published."""

    STATE = "with each state, at `publish_rate`"
    EVENT = "with each event that it reports"
    SAMPLE = "with each measurement, at the `rate` of the sensor"
    START = "once, at the start"
    CLOCK = "at `clock_rate`"
    MARKERS = "at `marker_rate`, while there is a subscriber"
    DIAGNOSTICS = "once a second of real time"


class Recorded(Enum):
    """How a topic is recorded."""

    NO = "not"
    YES = "yes; on a slow disk messages may be dropped"
    VITAL = "yes; no message is ever dropped"  # needed to compute the run again
    EACH_FILE = "as VITAL, and each file of a recording begins with its last message"


@dataclass(frozen=True)
class RequestParameter:
    """The node's parameter that requests a topic: a flag, or names separated by commas."""

    name: str
    default: bool | str
    description: str


@dataclass(frozen=True, eq=False)
class OutputTopic:
    """A topic that the node publishes.

    The function that makes its messages is `on_state`, given the model and the frame prefix, or `on_event`, given the
    model; `at_start`, given the model and its live values, makes the first message, and `at_reset` one that is
    published after a reset and not recorded, because it follows from the reset. Topics without any of them are
    published by the module that makes their messages. With a `parameter`, the topic is published only on request.
    """

    name: str
    message_type: str
    when: When
    qos: OfferedQos
    recorded: Recorded = Recorded.NO
    on_state: Callable[[Model, str], StateWriter] | None = None
    on_event: Callable[[Model], EventWriter] | None = None
    at_start: Callable[[Model, Mapping[str, float]], bytes] | None = None
    at_reset: Callable[[Model], bytes] | None = None
    parameter: RequestParameter | None = None


JOINT_STATES = OutputTopic(
    "joint_states",
    "sensor_msgs/msg/JointState",
    When.STATE,
    qos.STATE,
    Recorded.YES,
    on_state=lambda model, prefix: state_messages.joint_states(model),
)
ENERGIES = OutputTopic(
    "energies",
    "std_msgs/msg/Float64MultiArray",
    When.STATE,
    qos.STATE,
    Recorded.YES,
    on_state=lambda model, prefix: state_messages.energies(model),
)
ENERGY_VALUES = OutputTopic(
    "energy_values",
    "sensor_msgs/msg/JointState",
    When.STATE,
    qos.STATE,
    on_state=lambda model, prefix: state_messages.energy_values(model),
    parameter=RequestParameter(
        "energy_values", False, "publish the energies with names and a time stamp, for plotting tools"
    ),
)
JOINT_REACTIONS = OutputTopic(
    "joint_reactions",
    "sensor_msgs/msg/MultiDOFJointState",
    When.STATE,
    qos.STATE,
    Recorded.YES,
    on_state=state_messages.joint_reactions,
    parameter=RequestParameter("joint_reactions", False, "publish the force and moment that each joint transmits"),
)
CONTACT_STATES = OutputTopic(
    "contact_states",
    "sensor_msgs/msg/JointState",
    When.STATE,
    qos.STATE,
    Recorded.YES,
    on_state=lambda model, prefix: state_messages.contact_states(model),
    parameter=RequestParameter(
        "contact_states", False, "publish gaps, normal forces, slip and friction of contacts, stops, ropes and clutches"
    ),
)
CONSTRAINT_VIOLATION = OutputTopic(
    "constraint_violation",
    "std_msgs/msg/Float64MultiArray",
    When.STATE,
    qos.STATE,
    Recorded.YES,
    on_state=lambda model, prefix: state_messages.constraint_violation(model),
    parameter=RequestParameter("constraint_violation", False, "publish the violations of loops and constraints"),
)
ACCELERATIONS = OutputTopic(
    "accelerations",
    "std_msgs/msg/Float64MultiArray",
    When.STATE,
    qos.STATE,
    Recorded.YES,
    on_state=lambda model, prefix: accelerations(model, [COORDINATES]),
    parameter=RequestParameter(
        "accelerations",
        "",
        "accelerations to publish, separated by commas: coordinates, parts, points (part.point); all; or empty: none",
    ),
)
PART_POSES = OutputTopic(
    f"~/poses/{PART}",
    "geometry_msgs/msg/PoseStamped",
    When.STATE,
    qos.STATE,
    Recorded.YES,
    parameter=RequestParameter(
        "part_poses", "", "parts whose poses are published, separated by commas; all; or empty: none"
    ),
)
TF = OutputTopic(
    "/tf",
    "tf2_msgs/msg/TFMessage",
    When.STATE,
    qos.STATE,
    on_state=state_messages.transforms,
    parameter=RequestParameter(
        "tf", False, "publish the poses of all parts on /tf, for use without robot_state_publisher; needs tf2_msgs"
    ),
)
SENSORS = OutputTopic(
    f"~/sensors/{SENSOR}",
    "sensor_msgs/msg/Imu",  # or another, that of the sensor
    When.SAMPLE,
    qos.STATE,
    Recorded.YES,
)
APPLIED_EFFORTS = OutputTopic(
    "~/applied_efforts",
    "std_msgs/msg/Float64MultiArray",
    When.EVENT,
    qos.LATCHED_COMMAND,
    Recorded.VITAL,
    on_event=event_messages.applied_efforts,
    at_reset=event_messages.no_efforts,
)
APPLIED_COMMANDS = OutputTopic(
    "~/applied_commands",
    "std_msgs/msg/Float64MultiArray",
    When.EVENT,
    qos.LATCHED_COMMAND,
    Recorded.VITAL,
    on_event=event_messages.applied_commands,
    at_reset=event_messages.start_commands,
)
APPLIED_WRENCHES = OutputTopic(
    "~/applied_wrenches",
    "std_msgs/msg/Float64MultiArray",
    When.EVENT,
    qos.COMMAND,
    Recorded.VITAL,
    on_event=event_messages.applied_wrenches,
)
LIVE_VALUES = OutputTopic(
    "~/live_values",
    "std_msgs/msg/Float64MultiArray",
    When.EVENT,
    qos.LATCHED,
    Recorded.EACH_FILE,
    on_event=event_messages.live_values,
    at_start=event_messages.live_values_at_start,
)
EVENTS = OutputTopic(
    "~/events",
    "std_msgs/msg/String",
    When.EVENT,
    qos.LATCHED_COMMAND,
    Recorded.VITAL,
    on_event=event_messages.event_texts,
)
NEW_STATES = OutputTopic(
    "~/new_states",
    "std_msgs/msg/Float64MultiArray",
    When.EVENT,
    qos.COMMAND,
    Recorded.VITAL,
    on_event=event_messages.new_states,
)
ROBOT_DESCRIPTION = OutputTopic(
    "robot_description",
    "std_msgs/msg/String",
    When.START,
    qos.LATCHED,
    Recorded.EACH_FILE,
    at_start=event_messages.robot_description,
)
CLOCK = OutputTopic("/clock", "rosgraph_msgs/msg/Clock", When.CLOCK, qos.CLOCK)
MARKERS = OutputTopic("markers", "visualization_msgs/msg/MarkerArray", When.MARKERS, qos.STATE)
DIAGNOSTICS = OutputTopic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", When.DIAGNOSTICS, qos.STATE)

# Messages of one tick are published, and channels recorded, in this order.
TOPICS = (
    JOINT_STATES,
    ENERGIES,
    ENERGY_VALUES,
    JOINT_REACTIONS,
    CONTACT_STATES,
    CONSTRAINT_VIOLATION,
    ACCELERATIONS,
    PART_POSES,
    TF,
    SENSORS,
    APPLIED_EFFORTS,
    APPLIED_COMMANDS,
    APPLIED_WRENCHES,
    LIVE_VALUES,
    EVENTS,
    NEW_STATES,
    ROBOT_DESCRIPTION,
    CLOCK,
    MARKERS,
    DIAGNOSTICS,
)


def for_each_part(topic: OutputTopic, part_names: Sequence[str], parts: Sequence[str]) -> Iterator[OutputTopic]:
    """An entry with `<part>` in its name as one entry for each of some of the mechanism's parts."""
    tokens, poses = topic_names(part_names), state_messages.SharedPoses()
    for part in parts:
        writer = partial(state_messages.part_pose, part=part, poses=poses)
        yield replace(topic, name=topic.name.replace(PART, tokens[part]), on_state=writer)


def for_each_sensor(sensors: Sequence[AnySensor]) -> list[OutputTopic]:
    """The topic of each sensor, in order."""
    tokens = topic_names(sensor.name for sensor in sensors)
    return [
        replace(SENSORS, name=SENSORS.name.replace(SENSOR, tokens[one.name]), message_type=one.message_type)
        for one in sensors
    ]


def for_accelerations(requested: Sequence[str]) -> OutputTopic:
    """The topic of the requested accelerations."""
    return replace(ACCELERATIONS, on_state=lambda model, prefix: accelerations(model, requested))


def absolute_name(topic: OutputTopic) -> str:
    """The name of a topic of a node that is called `sim_node`, in no namespace."""
    return topic.name.replace("~", f"/{NODE}") if topic.name[0] in "~/" else f"/{topic.name}"


def is_vital(topic: OutputTopic) -> bool:
    """Whether no message of a topic may be missing from a recording."""
    return topic.recorded in (Recorded.VITAL, Recorded.EACH_FILE)
