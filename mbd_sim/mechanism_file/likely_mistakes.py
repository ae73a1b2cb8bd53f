"""Remedies for keys and types that users are likely to write, where the most similar spelling is something else."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from mbd_sim.mechanism.source import Location
from mbd_sim.mechanism_file.key_synonyms import synonym

Words = tuple[str, ...]

_SERVO = "A servo is a key of an actuator: '{type: effort, joint: …, servo: {controls: position, kp: …}}'."
_MOTOR = "A motor is an entry of actuators: '{type: effort, joint: …}' or '{type: dc_motor, …}'."
_AT = "Name where it is: 'at: part' or 'at: part.point'."

# By section: unknown keys of its entries, and what to do. "Write 'key'…" is only for entries that have this key.
_KEYS: Mapping[str, Mapping[Words, str]] = {
    "": {
        ("name", "model", "robot", "title"): "Write 'mechanism: …', the name of the mechanism.",
        ("motor", "motors", "servo", "servos", "actuator"): "Motors and servos are entries of 'actuators'.",
        ("imu", "imus", "encoder", "encoders", "sensor"): "Sensors are entries of 'sensors'.",
        ("spring", "springs", "dampers", "efforts", "torques", "force"): "Springs and efforts are entries of 'forces'.",
        ("drives", "motions"): "A drive is a key of its joint: 'drive'.",
    },
    "joints": {
        ("parent", "child", "from", "to", "body1", "body2"): "Write 'between: [parent, child]', with the names of two "
        "parts or points.",
        ("ratio", "pitch"): "Write 'lead', the travel for one turn.",
        ("effort", "torque", "force"): "An effort that acts is an entry of forces, '{type: effort, coordinate: …, "
        "effort: …}', or if it is commanded, of actuators, '{type: effort, joint: …}'. The largest is 'effort_limit'.",
        ("motor", "actuator", "servo", "controller", "pid"): _MOTOR,
        ("drive",): "It has none: use prismatic and revolute joints in a row, with parts of mass 0 between them.",
        ("sensor", "encoder", "imu"): "A sensor is an entry of sensors: '{type: encoder, joint: …, counts: …}'.",
    },
    "limits": {
        ("effort", "torque"): "Write 'effort_limit' in the joint itself.",
        ("velocity", "speed"): "Write 'velocity_limit' in the joint itself.",
    },
    "sensors": {
        ("frequency", "update_rate", "hz", "sample_rate"): "Write 'rate', in Hz.",
        ("topic", "topic_name"): "Its topic is ~/sensors/ with its name: remap that when starting the node.",
        ("part", "link", "body", "parent", "frame", "frame_id"): _AT,
        ("gyro", "gyroscope"): "Write 'angular_velocity: {…}'.",
        ("acceleration", "accelerometer", "linear_acceleration"): "Write 'specific_force: {…}'.",
        ("noise", "stddev", "std_dev"): "Write 'noise_density': the standard deviation of the noise divided by √rate.",
        ("max", "maximum", "max_range", "range"): "Write 'most'.",
        ("min", "minimum", "min_range"): "Write 'least'.",
        ("cpr", "ppr", "ticks", "counts_per_revolution", "counts_per_turn"): "Write 'counts', per turn.",
        ("seed",): "The seed is one for all sensors: 'sensor_seed', beside 'sensors'.",
    },
    "actuators": {
        ("kp", "ki", "kd", "p", "i", "d", "pid", "gains", "controls"): _SERVO,
        ("effort", "voltage", "current", "opening"): "Write the largest one as 'effort_limit', 'voltage_limit' or "
        "'current_limit', and the command at the start as 'command: {…}'.",
        ("at", "on", "part"): "Give 'joint', or 'between' with two points.",
        ("kt", "ke", "back_emf", "motor_constant"): "Write 'torque_constant', which is also that of the back-EMF.",
        ("r",): "Write 'resistance'.",
        ("l",): "Write 'inductance'.",
    },
    "servo": {
        ("type", "control", "mode", "position", "velocity"): "Write 'controls: position' or 'controls: velocity'.",
        ("rate", "frequency", "period", "dt"): "Write 'sample_rate', in Hz.",
    },
    "forces": {
        ("on", "part"): "Name where it acts: 'at: part' or 'at: part.point'.",
        ("force", "magnitude", "value"): "Write 'vector: [x, y, z]'; along a line between two points, "
        "'{type: line_force, between: […], force: …}'.",
    },
}  # fmt: skip
_OF_A_JOINT = "It measures a joint: write 'joint: …'. At points are accelerometer, imu, odometry, pose and twist."
_AT_A_POINT = _AT + " Of a joint are encoder, force_torque and tachometer."
_ERRORS = ("noise", "noise_density", "bias", "bias_walk", "resolution", "limit", "stddev")
_QUANTITIES = ("angular_velocity", "specific_force", "force", "torque", "position", "orientation", "velocity")
_TYPES: Mapping[str, Mapping[Words, str]] = {
    "actuators": {
        ("position", "velocity", "servo", "pid"): _SERVO,
        ("torque", "force", "motor"): "Did you mean 'dc_motor', or 'effort' for one without an electrical side?",
        ("cylinder", "hydraulic", "pneumatic"): "Did you mean 'hydraulic_cylinder' or 'pneumatic_cylinder'?",
    },
    "sensors": {
        ("gyro", "gyroscope"): "Did you mean 'imu'?",
        ("lidar", "laser", "ultrasound", "distance"): "Did you mean 'range'?",
        ("ft", "load_cell", "strain", "strain_gauge", "torque", "force"): "Did you mean 'force_torque'?",
        ("gps", "gnss", "mocap"): "Did you mean 'pose', or 'odometry' with velocities?",
        ("position", "angle", "potentiometer", "joint"): "Did you mean 'encoder'?",
        ("velocity", "speed"): "Did you mean 'tachometer' of a joint, or 'twist' of a part?",
    },
    "forces": {
        ("torque", "moment"): "Did you mean 'couple' on a part, or 'effort' on a joint coordinate?",
        ("motor", "actuator", "servo"): _MOTOR,
    },
}  # fmt: skip


def remedy_for_key(location: Location, known: Collection[str]) -> str:
    """What to write instead of an unknown key; "" if its spelling says it.

    :param known: the keys that there are at this place.
    """
    section, key = _section(location[:-1]), str(location[-1])
    if section == "sensors" and key == "joint" and "at" in known:
        return _AT_A_POINT
    if section == "sensors" and key == "joint" and "actuator" in known:
        return "Name a DC motor: 'actuator: …'."
    if section == "sensors" and key in ("at", "part", "link") and "joint" in known:
        return _OF_A_JOINT
    if section == "sensors" and key in _ERRORS and (own := [name for name in known if name in _QUANTITIES]):
        return f"Give it for a quantity: '{own[0]}: {{noise_density: …}}'."
    remedy = _found(_KEYS, section, key)
    if section == "limits" or (remedy and not remedy.startswith("Write '")):
        return remedy
    if remedy and remedy.split("'")[1].partition(":")[0] in known:
        return remedy
    return f"Write '{found}'." if (found := synonym(key, known)) else ""


def remedy_for_lone_key(key: str, known: Collection[str]) -> str:
    """What to write instead of an unknown key without a value; "" if nothing shows it.

    :param known: the keys that there are at this place.
    """
    word, _, rest = key.partition(" ")
    if word in known and rest:
        return f"A colon is missing: write '{word}: {rest}'."
    if key[:1].isdigit():
        return "A comma separates entries: write decimals with a point, as in 0.5."
    return ""


def remedy_for_type(location: Location, word: str) -> str:
    """What to write instead of an unknown type of an entry; "" if its spelling says it."""
    return _found(_TYPES, str(location[0]) if location else "", word)


def _section(location: Location) -> str:
    """The table for the keys of an entry at a location."""
    if len(location) < 2:
        return "" if not location else "none"
    if location[0] == "joints" and "limits" in location[2:]:
        return "limits"
    if location[0] == "actuators" and location[2:] == ("servo",):
        return "servo"
    return str(location[0]) if len(location) == 2 else "none"


def _found(tables: Mapping[str, Mapping[Words, str]], section: str, word: str) -> str:
    table = tables.get(section, {})
    return next((remedy for words, remedy in table.items() if word in words), "")
