"""Pydantic's errors about a mechanism file as problems, worded in terms of the file, with remedies.

For keys and types that users are likely to write, the remedy is listed where the most similar spelling is something
else.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from pydantic_core import ErrorDetails

from mbd_sim.base.errors import InputError, Problem, counted, listed, nearest, quoted
from mbd_sim.files.checks.json_schema import PydanticLocation, known_keys, known_types, list_length
from mbd_sim.files.text.spelling import as_written, synonym
from mbd_sim.mechanism.values.expression import QUOTE_COMMAS, is_cut
from mbd_sim.mechanism.values.names import LONGEST_NAME, PLAIN_PATTERN
from mbd_sim.mechanism.values.source import Location, Source

CUTOFF = 0.75  # similarity above which a word counts as a misspelling
Words = tuple[str, ...]

_SERVO = "A servo is a key of an actuator: '{type: effort, joint: …, servo: {controls: position, kp: …}}'."
_MOTOR = "A motor is an entry of actuators: '{type: effort, joint: …}' or '{type: dc_motor, …}'."
_AT = "Name where it is: 'at: part' or 'at: part.point'."

_THIN = "It has none: what is thick is a 'cylinder', with 'radius' and 'length'."

# By section: unknown keys of its entries, and what to do. "Write 'key'…" is only for entries that have this key.
_KEYS: Mapping[str, Mapping[Words, str]] = {
    "": {
        ("name", "model", "robot", "title"): "Write 'mechanism: …', the name of the mechanism.",
        ("motor", "motors", "servo", "servos", "actuator"): "Motors and servos are entries of 'actuators'.",
        ("imu", "imus", "encoder", "encoders", "sensor"): "Sensors are entries of 'sensors'.",
        ("spring", "springs", "dampers", "efforts", "torques", "force"): "Springs and efforts are entries of 'forces'.",
        ("drives", "motions"): "A drive is a key of its joint: 'drive'.",
        ("floor", "plane", "table", "floors"): "A floor is an entry of contacts: 'floor: {parts: all, plane: ground}'.",
    },
    "ground": {
        ("shape", "shapes", "geometry", "mesh", "meshes"): "Ground has only points: give the shapes to a part, and "
        "hold it by a joint '{type: fixed, between: [ground, part]}'.",
    },
    "joints": {
        ("parent", "child", "from", "to", "body1", "body2"): "Write 'between: [parent, child]', with the names of two "
        "parts or points.",
        ("ratio", "pitch"): "Write 'lead', the travel for one turn.",
        ("x", "y", "z", "xyz"): "Write 'position: [x, y, z]'.",
        ("at", "origin", "anchor", "location", "pose", "center", "point", "points"): "Where a joint is, points say: "
        "'between: [ground.point, part.point]', with both of them under 'points' of ground and of the part.",
        ("effort", "torque", "force"): "An effort that acts is an entry of forces, '{type: effort, coordinate: …, "
        "effort: …}', or if it is commanded, of actuators, '{type: effort, joint: …}'. The largest is 'effort_limit'.",
        ("motor", "actuator", "servo", "controller", "pid"): _MOTOR,
        ("drive",): "It has none: use prismatic and revolute joints in a row, with parts of mass 0 between them.",
        ("sensor", "encoder", "imu"): "A sensor is an entry of sensors: '{type: encoder, joint: …, counts: …}'.",
    },
    "drive": {
        ("velocity", "speed", "rate", "rpm", "value", "angle", "expression", "function", "equation"): "A given motion "
        "is an expression of the time, in m or rad, such as 'drive: 2*t'. With these keys, a drive follows commands.",
    },
    "contacts": {
        ("a", "b", "first", "second", "part1", "part2", "shape1", "shape2", "geom1", "geom2", "pairs", "pair"): "Write "
        "'between: [a, b]', with the names of two parts.",
        ("point", "at", "foot", "wheel", "ball"): "Write 'parts: [part.point]', with 'plane: ground'.",
        ("on", "floor", "ground", "surface", "table", "with", "against"): "Write 'plane: ground', or the point of a "
        "plane, whose 'normal' is z by default.",
        ("type", "kind"): "A contact has no type: give 'between' two parts, or 'parts' on a 'plane'.",
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
        ("on", "part"): "Write 'at: part' or 'at: part.point', where it acts.",
        ("force", "magnitude", "value"): "Write 'vector: [x, y, z]'; along a line between two points, "
        "'{type: line_force, between: […], force: …}'.",
    },
}  # fmt: skip
_OF_A_JOINT = (
    "It measures a joint: write 'joint: …'. At points are accelerometer, imu, odometry, pose, range and twist; "
    "a force_torque of a joint may have 'at' besides."
)
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
    if section == "shapes" and key in ("length", "height", "thickness", "width") and "radius" in known:
        return "Write 'length'." if "length" in known else _THIN
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
        return "" if not location else "ground" if location == ("ground",) else "none"
    if location[0] == "joints" and "limits" in location[2:]:
        return "limits"
    if location[0] == "joints" and location[2:3] == ("drive",):
        return "drive"
    if location[0] == "parts" and "shape" in str(location[2:3]):
        return "shapes"
    if location[0] == "actuators" and location[2:] == ("servo",):
        return "servo"
    return str(location[0]) if len(location) == 2 else "none"


def _found(tables: Mapping[str, Mapping[Words, str]], section: str, word: str) -> str:
    table = tables.get(section, {})
    return next((remedy for words, remedy in table.items() if word in words), "")


# Other words that users may write for a type: the first of the types that is valid at this place.
TYPE_SYNONYMS = {
    "hinge": ("revolute",), "pin": ("revolute",), "rotation": ("revolute",), "continuous": ("revolute",),
    "rotary": ("revolute",), "rotational": ("revolute",), "slider": ("prismatic",), "translation": ("prismatic",),
    "slide": ("prismatic",), "linear": ("prismatic", "spring"), "translational": ("prismatic",), "weld": ("fixed",),
    "rigid": ("fixed",), "floating": ("free",), "ball": ("spherical", "sphere"), "socket": ("spherical",),
    "cardan": ("universal",), "hooke": ("universal",), "helical": ("screw",), "lead_screw": ("screw",),
    "bar": ("rod",), "disk": ("disc",), "wheel": ("disc",), "hoop": ("ring",),
    "box": ("block",), "cuboid": ("block",), "cube": ("block",), "point": ("particle",), "point_mass": ("particle",),
    "egg": ("ellipsoid",), "polyhedron": ("hull",), "mesh": ("hull",), "pyramid": ("hull",),
    "mass": ("particle",), "rectangle": ("plate",), "rope": ("cable",), "link": ("distance", "rod"),
    "pulley": ("cable",), "gears": ("gear",), "mimic": ("coupling",), "roll": ("rolling",),
}  # fmt: skip


def problems_of(source: Source, errors: Sequence[ErrorDetails]) -> list[Problem]:
    """The problems that pydantic's errors describe; a missing key is none if an unknown one is to be written so."""
    missing = {details["loc"][:-1] for details in errors if details["type"] == "missing"}
    found = [(details, problem_of(source, details, details["loc"][:-1] in missing)) for details in errors]
    misspelled = {
        (*details["loc"][:-1], key)
        for details, problem in found
        if details["type"] == "extra_forbidden"
        for key in re.findall(r"'(\w+)", problem.remedy)
    }
    return [problem for details, problem in found if details["type"] != "missing" or details["loc"] not in misspelled]


def problem_of(source: Source, details: ErrorDetails, required: bool = False) -> Problem:
    """The problem that one of pydantic's errors describes.

    :param required: for an unknown key, whether another one is missing beside it.
    """
    loc, kind, context = details["loc"], details["type"], details.get("ctx", {})
    location, value = in_file(source, loc)
    if isinstance(error := context.get("error"), InputError):
        return source.problem_of(location, error)
    leaf = str(loc[-1]) if loc else ""
    match kind:
        case "extra_forbidden":
            if location[-1:] != loc[-1:]:  # it is also the value of a key 'type', and was taken for a tag
                location, value = (*location, leaf), value[leaf]
            known = known_keys(loc[:-1])
            remedy = value is None and remedy_for_lone_key(leaf, known)
            remedy = remedy or remedy_for_key(location, known)
            # Of words that are hardly similar, what is missing is the likelier one, whose own problem names it; and
            # one or two letters are similar to anything.
            similar = difflib.get_close_matches(leaf[:100], known, n=1, cutoff=CUTOFF)
            unlike = len(leaf) <= 2 or (required and not similar)
            remedy = remedy or nearest("" if unlike else leaf, known)
            return source.problem(location, f"unknown key {quoted(leaf)}", remedy)
        case "too_long" if isinstance(value, list) and context["max_length"] > list_length(loc):
            message = f"has {counted(len(value), 'value')}, more than {context['max_length']}"
            return source.problem(location, message, "Leave out some.")
        case "missing" | "too_long" if isinstance(value, list):
            where = loc[:-1] if kind == "missing" else loc
            message = f"has {counted(len(value), 'value')}, not {list_length(where)}"
            cut = any(isinstance(entry, str) and is_cut(entry) for entry in value)
            return source.problem(location, message, QUOTE_COMMAS if cut else _list_form(where), value)
        case "missing" if value is None:
            return source.problem(location, "has no value", "Give it a value.")
        case "missing":
            return source.problem(location, f"'{leaf}' is missing", "Add it.")
        case "union_tag_not_found":
            words = [word for word in value if isinstance(word, str)] if isinstance(value, dict) else []
            written = next(iter(difflib.get_close_matches("type", words, n=1, cutoff=CUTOFF)), "")
            instead = f"Write it in place of '{written}'. " if written else ""
            return source.problem(location, "'type' is missing", instead + nearest("", known_types(loc)))
        case "union_tag_invalid":
            return _unknown_type(source, location, loc, value)
        case "literal_error":
            return source.problem(location, "unknown word", f"Write {context['expected']}.".replace("'", ""), value)
    message, remedy = _wording(kind, loc, value)
    if "[key]" in loc or kind == "too_short":
        value = None
    elif value is None:
        message, remedy = "has no value", remedy or "Give it a value."
    return source.problem(location, message or details["msg"], remedy, value)


def _unknown_type(source: Source, location: Location, loc: PydanticLocation, value: object) -> Problem:
    where, types = (*location, "type"), known_types(loc)
    tag = value.get("type") if isinstance(value, dict) else None
    if tag is None:
        return source.problem(where, "has no value", nearest("", types))
    remedy = remedy_for_type(location, str(tag)) or nearest(str(tag), types)
    if meant := [word for word in TYPE_SYNONYMS.get(str(tag), ()) if word in types]:
        remedy = f"Did you mean '{meant[0]}'? Valid: {listed(types)}."
    return source.problem(where, f"unknown type {quoted(tag)}", remedy)


def _wording(kind: str, loc: PydanticLocation, value: object) -> tuple[str, str]:
    """A message and a remedy for a kind of error; both empty for kinds that cannot occur."""
    match kind:
        case "string_pattern_mismatch" if "color" in loc[-1:]:
            return "not a color", "Write it in quotes, as '#1f77b4'."
        case "string_pattern_mismatch" | "string_too_long":
            text = str(loc[-2] if loc[-1:] == ("[key]",) else value)
            if "{" in text:
                return "not a valid name", "An index in braces needs for: {i: 1..6} in the entry."
            if loc[:1] in (("parameters",), ("ranges",), ("tables",)):
                valid = re.sub(r"[^A-Za-z0-9_]+", "_", text).strip("_")
                example = f", for example {valid}" if len(valid) <= 60 and re.match(PLAIN_PATTERN, valid) else ""
                return "not a valid name", f"Use at most 60 letters, digits and underscores, a letter first{example}."
            if text.startswith("/") and loc[:1] in (("parts",), ("sensors",)):
                return "begins with '/'", "Remove it: names of frames in TF, which this is as well, do not begin so."
            form = f"Use at most {LONGEST_NAME} characters without line ends, and none of {{ }}."
            return "not a valid name", form
        case "string_type":
            is_name = "between" in loc[-2:] or isinstance(value, dict | list)
            return "must be text", "Write the name of a part, or part.point." if is_name else "Put it in quotes."
        case "bool_type" | "bool_parsing":
            return "must be true or false", "Write true or false."
        case "tuple_type" | "list_type":
            return "must be a list", _list_form(loc, value)
        case "model_type" | "model_attributes_type" | "dict_type" if loc[-1:] == ("mapping",):
            return "must be a list or a mapping", _list_form((*loc[:-1], "list"))
        case "model_type" | "model_attributes_type" | "dict_type" if loc[:1] == ("actuators",) and loc[-1] == "command":
            return "must be a mapping of channels to values", "Write for example '{position: 0.5}' or '{effort: 2}'."
        case "model_type" | "model_attributes_type" | "dict_type":
            if isinstance(value, list) and len(loc) == 1:
                return (
                    "must be a mapping of keys to values",
                    "Write each entry with its name: 'rod: {mass: 1}'.",
                )
            keys = known_keys(loc)
            remedy = f"Its keys: {listed(keys)}." if keys else "Write 'name: value'."
            if loc[-1:] == ("limits",) and isinstance(value, list) and len(value) == 2:
                remedy = f"Write {{lower: {value[0]}, upper: {value[1]}}}. {remedy}"
            return "must be a mapping of keys to values", remedy
        case "too_short":
            return "needs at least one entry", "Add one below it."
    return "", ""


AXES = {"x": [1, 0, 0], "y": [0, 1, 0], "z": [0, 0, 1]}
DIRECTIONS = (("axis",), ("x_axis",), ("normal",), ("direction",))


def _list_form(loc: PydanticLocation, value: object = None) -> str:
    """How to write the list at a location, in place of a value."""
    if loc[-1:] in DIRECTIONS and isinstance(value, str) and (axis := AXES.get(value.strip("+-").lower())):
        return f"Write {[-one for one in axis] if value.startswith('-') else axis}."
    if loc == ("gravity",) and isinstance(value, int | float):
        return f"Write [0, 0, {-abs(value):g}]."
    if loc[-1:] == ("between",):
        return "Write it as [ground, part] or [part.point, part.point]."
    if loc[-1:] == ("table",):
        return "Write it as [[elongation, force], [elongation, force]]."
    if "table" in loc[-2:]:
        return "Write it as [elongation, force]."
    if "inertia" in loc[-2:]:
        return "Write it as [I_xx, I_yy, I_zz] or {xx: …, yy: …, zz: …, xy: …}."
    letters = {2: "x, y", 3: "x, y, z", 4: "w, x, y, z"}.get(list_length(loc))
    return f"Write it as [{letters}]." if letters else "Begin each entry with '- '."


def in_file(source: Source, loc: PydanticLocation) -> tuple[Location, Any]:
    """A pydantic location without the tags of unions, and the value there."""
    location: Location = ()
    value, entered = source.data, False
    for step in loc:
        if entered and isinstance(value, dict) and step == value.get("type"):
            entered = False  # the tag of a union, which may also be one of the keys
            continue
        if isinstance(value, list) and isinstance(step, int) and step < len(value):
            value, entered = value[step], True
        elif isinstance(value, dict) and (written := as_written(step, value)) in value:
            step, value, entered = written, value[written], True
        else:
            continue  # the tag of a union, or a missing key
        location += (step,)
    return location, value
