"""The start of a run as parameters: `start` lists values or names one of `starts.<name>`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from rclpy.node import Node

from mbd_sim.errors import CommandError, InputError, nearest, quoted
from mbd_sim.mechanism.names import split_assignment, split_words
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism_file.bare_angles import bare_argument_remark
from mbd_sim.mechanism_file.value_parser import parse_value
from mbd_sim.ros.node_parameters import ParameterSpec
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.state_values import StateValues, checked_values

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
        return checked_values(model, positions, speeds)
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
    """The SI unit of each free coordinate by its name."""
    units = [
        coordinate.unit
        for joint in mechanism.joints.values()
        if not joint.drive
        for coordinate in joint.kind.coordinates
    ]
    return dict(zip(mechanism.coordinate_names, units, strict=True))
