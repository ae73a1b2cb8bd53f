"""All topics of a run, those of its sensors included: one entry each.

`sim_node` publishes them; recordings contain them, with ROS or without.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from typing import NamedTuple

from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.sensors import AnySensor, Encoder
from mbd_sim.recordings.messages import definitions, events, states
from mbd_sim.recordings.messages.definitions import OfferedQos, topic_names
from mbd_sim.recordings.messages.events import EventWriter
from mbd_sim.recordings.messages.sensors import sensor_writer
from mbd_sim.recordings.messages.states import COORDINATES, StateWriter, accelerations
from mbd_sim.simulation.kernel.sensors import INDEX, Arrival, SensorModel, SensorReading, StateSample
from mbd_sim.simulation.model.model import Model

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
    definitions.STATE,
    Recorded.YES,
    on_state=lambda model, prefix: states.joint_states(model),
)
ENERGIES = OutputTopic(
    "energies",
    "std_msgs/msg/Float64MultiArray",
    When.STATE,
    definitions.STATE,
    Recorded.YES,
    on_state=lambda model, prefix: states.energies(model),
)
ENERGY_VALUES = OutputTopic(
    "energy_values",
    "sensor_msgs/msg/JointState",
    When.STATE,
    definitions.STATE,
    on_state=lambda model, prefix: states.energy_values(model),
    parameter=RequestParameter(
        "energy_values", False, "publish the energies with names and a time stamp, for plotting tools"
    ),
)
JOINT_REACTIONS = OutputTopic(
    "joint_reactions",
    "sensor_msgs/msg/MultiDOFJointState",
    When.STATE,
    definitions.STATE,
    Recorded.YES,
    on_state=states.joint_reactions,
    parameter=RequestParameter("joint_reactions", False, "publish the force and moment that each joint transmits"),
)
CONTACT_STATES = OutputTopic(
    "contact_states",
    "sensor_msgs/msg/JointState",
    When.STATE,
    definitions.STATE,
    Recorded.YES,
    on_state=lambda model, prefix: states.contact_states(model),
    parameter=RequestParameter(
        "contact_states", False, "publish gaps, normal forces, slip and friction of contacts, stops, ropes and clutches"
    ),
)
CONSTRAINT_VIOLATION = OutputTopic(
    "constraint_violation",
    "std_msgs/msg/Float64MultiArray",
    When.STATE,
    definitions.STATE,
    Recorded.YES,
    on_state=lambda model, prefix: states.constraint_violation(model),
    parameter=RequestParameter("constraint_violation", False, "publish the violations of loops and constraints"),
)
ACCELERATIONS = OutputTopic(
    "accelerations",
    "std_msgs/msg/Float64MultiArray",
    When.STATE,
    definitions.STATE,
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
    definitions.STATE,
    Recorded.YES,
    parameter=RequestParameter(
        "part_poses", "", "parts whose poses are published, separated by commas; all; or empty: none"
    ),
)
TF = OutputTopic(
    "/tf",
    "tf2_msgs/msg/TFMessage",
    When.STATE,
    definitions.STATE,
    on_state=states.transforms,
    parameter=RequestParameter(
        "tf", False, "publish the poses of all parts on /tf, for use without robot_state_publisher; needs tf2_msgs"
    ),
)
SENSORS = OutputTopic(
    f"~/sensors/{SENSOR}",
    "sensor_msgs/msg/Imu",  # or another, that of the sensor
    When.SAMPLE,
    definitions.STATE,
    Recorded.YES,
)
APPLIED_EFFORTS = OutputTopic(
    "~/applied_efforts",
    "std_msgs/msg/Float64MultiArray",
    When.EVENT,
    definitions.LATCHED_COMMAND,
    Recorded.VITAL,
    on_event=events.applied_efforts,
    at_reset=events.no_efforts,
)
APPLIED_COMMANDS = OutputTopic(
    "~/applied_commands",
    "std_msgs/msg/Float64MultiArray",
    When.EVENT,
    definitions.LATCHED_COMMAND,
    Recorded.VITAL,
    on_event=events.applied_commands,
    at_reset=events.start_commands,
)
APPLIED_WRENCHES = OutputTopic(
    "~/applied_wrenches",
    "std_msgs/msg/Float64MultiArray",
    When.EVENT,
    definitions.COMMAND,
    Recorded.VITAL,
    on_event=events.applied_wrenches,
)
LIVE_VALUES = OutputTopic(
    "~/live_values",
    "std_msgs/msg/Float64MultiArray",
    When.EVENT,
    definitions.LATCHED,
    Recorded.EACH_FILE,
    on_event=events.live_values,
    at_start=events.live_values_at_start,
)
EVENTS = OutputTopic(
    "~/events",
    "std_msgs/msg/String",
    When.EVENT,
    definitions.LATCHED_COMMAND,
    Recorded.VITAL,
    on_event=events.event_texts,
)
NEW_STATES = OutputTopic(
    "~/new_states",
    "std_msgs/msg/Float64MultiArray",
    When.EVENT,
    definitions.COMMAND,
    Recorded.VITAL,
    on_event=events.new_states,
)
ROBOT_DESCRIPTION = OutputTopic(
    "robot_description",
    "std_msgs/msg/String",
    When.START,
    definitions.LATCHED,
    Recorded.EACH_FILE,
    at_start=events.robot_description,
)
CLOCK = OutputTopic("/clock", "rosgraph_msgs/msg/Clock", When.CLOCK, definitions.CLOCK)
MARKERS = OutputTopic("markers", "visualization_msgs/msg/MarkerArray", When.MARKERS, definitions.STATE)
DIAGNOSTICS = OutputTopic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", When.DIAGNOSTICS, definitions.STATE)

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
    tokens, poses = topic_names(part_names), states.SharedPoses()
    for part in parts:
        writer = partial(states.part_pose, part=part, poses=poses)
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


class Measured(NamedTuple):
    """A measurement of a sensor as the message of a topic, and as such."""

    topic: str
    payload: bytes
    sensor: str
    reading: SensorReading


class SensorMessages:
    """Serializes measurements; for one thread."""

    def __init__(self, model: Model, step_size: float, frame_prefix: str = "") -> None:
        """Prepare the messages for steps of `step_size` s; frame names begin with a prefix."""
        sensors = self._sensors = SensorModel(model, model.mechanism, step_size)
        self.names = [topic.name for topic in for_each_sensor(sensors.sensors)]
        self.writers = [sensor_writer(sensors, number, frame_prefix) for number in range(len(sensors.sensors))]
        self._delays_ns = [timing.delay * round(step_size * 1e9) for timing in sensors.timings]

    def prepare(self, y: Array, inputs: Array) -> None:
        """Derive and import everything that measurements need, by those of one state."""
        for number, writer in enumerate(self.writers):
            writer.payload(self._sensors.reading(number, StateSample(0, y, inputs)), 0)

    def measured(self, arrivals: Sequence[Arrival], clock_ns: int) -> Iterator[Measured]:
        """The measurements that arrive at a time in ns; the stamp of their messages is the time of the sample."""
        for number, sample in arrivals:
            reading = self._sensors.reading(number, sample)
            payload = self.writers[number].payload(reading, clock_ns - self._delays_ns[number])
            yield Measured(self.names[number], payload, self._sensors.sensors[number].name, reading)

    def rounding(self, number: int, quantity: str) -> float:
        """By how much a value of a sensor may change because the value before rounding changes in its last bits."""
        sensor = self._sensors.sensors[number]
        if isinstance(sensor, Encoder):
            return 1.0 if quantity == INDEX else sensor.resolution
        by_name = {one.name: errors for one, errors in zip(sensor.quantities, sensor.errors, strict=True)}
        return by_name[quantity].resolution
