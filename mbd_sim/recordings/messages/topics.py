"""All topics of a run, those of its sensors included: one entry each.

`sim_node` publishes them; recordings contain them, with ROS or without.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial

from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.sensors import AnySensor, Encoder
from mbd_sim.recordings.messages import definitions, events, states
from mbd_sim.recordings.messages.cdr import JOINT_STATE, MULTI_ARRAY, STRING
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


def _state(
    name: str,
    message_type: str,
    on_state: Callable[[Model, str], StateWriter] | None,
    description: str = "",
    *,
    parameter: str = "",
    default: bool | str = False,
    recorded: Recorded = Recorded.YES,
) -> OutputTopic:
    """A topic that is published with each state; with a `description` of its parameter, only on request.

    :param parameter: the name of the parameter, by default that of the topic.
    """
    requested = RequestParameter(parameter or name, default, description) if description else None
    return OutputTopic(name, message_type, When.STATE, definitions.STATE, recorded, on_state, parameter=requested)


JOINT_STATES = _state("joint_states", JOINT_STATE, states.joint_states)
ENERGIES = _state("energies", MULTI_ARRAY, states.energies)
ENERGY_VALUES = _state(
    "energy_values",
    JOINT_STATE,
    states.energy_values,
    "publish the energies with names and a time stamp, for plotting tools",
    recorded=Recorded.NO,
)
JOINT_REACTIONS = _state(
    "joint_reactions",
    "sensor_msgs/msg/MultiDOFJointState",
    states.joint_reactions,
    "publish the force and moment that each joint transmits",
)
CONTACT_STATES = _state(
    "contact_states",
    JOINT_STATE,
    states.contact_states,
    "publish gaps, normal forces, slip and friction of contacts, stops, ropes and clutches",
)
CONTACT_FORCES = _state(
    "contact_forces",
    "sensor_msgs/msg/MultiDOFJointState",
    states.contact_forces,
    "publish the point, the normal and the force vector of each contact",
)
CONSTRAINT_VIOLATION = _state(
    "constraint_violation",
    MULTI_ARRAY,
    states.constraint_violation,
    "publish the violations of loops and constraints",
)
ACCELERATIONS = _state(
    "accelerations",
    MULTI_ARRAY,
    partial(accelerations, requested=[COORDINATES]),
    "accelerations to publish, separated by commas: coordinates, parts, points (part.point); all; or empty: none",
    default="",
)
PART_POSES = _state(
    f"~/poses/{PART}",
    "geometry_msgs/msg/PoseStamped",
    None,
    "parts whose poses are published, separated by commas; all; or empty: none",
    parameter="part_poses",
    default="",
)
TF = _state(
    "/tf",
    "tf2_msgs/msg/TFMessage",
    states.transforms,
    "publish the poses of all parts on /tf, for use without robot_state_publisher; needs tf2_msgs",
    parameter="tf",
    recorded=Recorded.NO,
)
# The type is that of the sensor.
SENSORS = OutputTopic(f"~/sensors/{SENSOR}", "sensor_msgs/msg/Imu", When.SAMPLE, definitions.STATE, Recorded.YES)

_event = partial(OutputTopic, when=When.EVENT, recorded=Recorded.VITAL)
APPLIED_EFFORTS = _event(
    "~/applied_efforts",
    MULTI_ARRAY,
    qos=definitions.LATCHED_COMMAND,
    on_event=events.applied_efforts,
    at_reset=events.no_efforts,
)
APPLIED_COMMANDS = _event(
    "~/applied_commands",
    MULTI_ARRAY,
    qos=definitions.LATCHED_COMMAND,
    on_event=events.applied_commands,
    at_reset=events.start_commands,
)
APPLIED_WRENCHES = _event("~/applied_wrenches", MULTI_ARRAY, qos=definitions.COMMAND, on_event=events.applied_wrenches)
LIVE_VALUES = _event(
    "~/live_values",
    MULTI_ARRAY,
    qos=definitions.LATCHED,
    recorded=Recorded.EACH_FILE,
    on_event=events.live_values,
    at_start=events.live_values_at_start,
)
EVENTS = _event("~/events", STRING, qos=definitions.LATCHED_COMMAND, on_event=events.event_texts)
NEW_STATES = _event("~/new_states", MULTI_ARRAY, qos=definitions.COMMAND, on_event=events.new_states)
ROBOT_DESCRIPTION = OutputTopic(
    "robot_description",
    STRING,
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
    CONTACT_FORCES,
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
    return replace(ACCELERATIONS, on_state=partial(accelerations, requested=requested))


def absolute_name(topic: OutputTopic) -> str:
    """The name of a topic of a node that is called `sim_node`, in no namespace."""
    return topic.name.replace("~", f"/{NODE}") if topic.name[0] in "~/" else f"/{topic.name}"


def is_vital(topic: OutputTopic) -> bool:
    """Whether no message of a topic may be missing from a recording."""
    return topic.recorded in (Recorded.VITAL, Recorded.EACH_FILE)


@dataclass(frozen=True, slots=True)
class SensorMessage:
    """A measurement of a sensor as the message of a topic, and as such."""

    topic: str
    payload: bytes
    sensor: str
    reading: SensorReading


class SensorSerializer:
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

    def measured(self, arrivals: Sequence[Arrival], clock_ns: int) -> Iterator[SensorMessage]:
        """The measurements that arrive at a time in ns; the stamp of their messages is the time of the sample."""
        for number, sample in arrivals:
            reading = self._sensors.reading(number, sample)
            payload = self.writers[number].payload(reading, clock_ns - self._delays_ns[number])
            yield SensorMessage(self.names[number], payload, self._sensors.sensors[number].name, reading)

    def rounding(self, number: int, quantity: str) -> float:
        """By how much a value of a sensor may change because the value before rounding changes in its last bits."""
        sensor = self._sensors.sensors[number]
        if isinstance(sensor, Encoder):
            return 1.0 if quantity == INDEX else sensor.resolution
        by_name = {one.name: errors for one, errors in zip(sensor.quantities, sensor.errors, strict=True)}
        return by_name[quantity].resolution
