"""What the sliders of a page change: live values, efforts, commands and the state, in the units of the file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import yaml

from mbd_sim.base.errors import InputError, MechanismError
from mbd_sim.files.checks.override import location_of
from mbd_sim.files.text.units import si_factor, split_unit
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.positions import PositionBench
from mbd_sim.lab.session.session import Session
from mbd_sim.mechanism.contents import action_bounds
from mbd_sim.mechanism.elements.actuators import Actuator, CoordinatePort
from mbd_sim.mechanism.elements.joint_types import Channel, CommandedDrive
from mbd_sim.mechanism.elements.parts import Joint
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import evaluate, names_in
from mbd_sim.mechanism.values.source import value_at
from mbd_sim.pictures.shapes.joints import weight
from mbd_sim.simulation.run.simulation import BaseSimulation

Kind = Literal["drive", "value", "effort", "command", "position", "speed"]
STEPS = 400  # of a slider from end to end
GRAVITY = 20.0  # m/s²
COMMANDS: Mapping[str, tuple[str, float]] = {  # unit and range of a command without limits, by its channel
    "voltage": ("V", 24.0),
    "current": ("A", 10.0),
    "opening": ("", 1.0),
}
DEGREE = math.radians(1.0)
TURN, FAST = 180.0, 1000.0  # deg, deg/s


@dataclass(frozen=True)
class Setting:
    """A number that can change: its `value` in the file or at the start, and the ends of its slider, in `unit`.

    `factor` makes SI units of it. The file has a number without a unit if it is not `with_unit`.
    """

    kind: Kind
    group: str
    key: str
    label: str
    unit: str
    factor: float
    value: float
    low: float
    high: float
    with_unit: bool = True

    @property
    def step(self) -> float:
        """The step of the slider: a round number."""
        return float(f"{(self.high - self.low) / STEPS:.0e}")

    @property
    def from_file(self) -> bool:
        """Whether `value` is what the mechanism goes back to; a position or speed is that of the start only."""
        return self.kind not in ("drive", "position", "speed")

    def apply(self, session: Session, shown: float) -> None:
        """Give the mechanism of a session a value in `unit`.

        :raises CommandError: it does not fit.
        """
        value = shown * self.factor
        match self.kind:
            case "value":
                session.change(self.key, value)
            case "effort":
                session.set_effort(self.key, value)
            case "command":
                session.set_command(self.key, value)
            case "position":
                session.set_state({self.label: value}, {})
            case "speed":
                session.set_state({}, {self.label: value})
            case "drive":
                session.drive_to(value)


def settings_of(bench: Bench, size: float, *, with_state: bool = True) -> list[Setting]:
    """All numbers that can change, in the order of the file; `size` is the length of the mechanism in m.

    :param with_state: also the positions and speeds of joints.
    """
    if isinstance(bench, PositionBench):
        return [_drive(bench, size), *(one for one in _values(bench.simulation, size) if one.group == "Parameters")]
    simulation = bench.simulation
    return [
        *_commands(simulation, size),
        *_values(simulation, size),
        *_efforts(simulation, size),
        *(_states(simulation, size) if with_state else ()),
    ]


def as_yaml(settings: list[Setting], shown: Mapping[str, float]) -> str:
    """The changed values as the file has them; `shown` are values by key, in their units."""
    written = {key: float(f"{value:.12g}") for key, value in shown.items()}
    changed = [one for one in settings if one.kind == "value" and written.get(one.key, one.value) != one.value]
    lists = {one.key.partition("[")[0] for one in changed if "[" in one.key}
    data: dict[str, Any] = {}
    for setting in settings:
        name, bracket, _ = setting.key.partition("[")
        if setting not in changed and not (bracket and name in lists):
            continue
        value = written.get(setting.key, setting.value)
        entry = f"{value:.12g} {setting.unit}" if setting.unit and setting.with_unit else value
        *sections, last = name.split(".")
        here = data
        for section in sections:
            here = here.setdefault(section, {})
        if bracket:
            here.setdefault(last, []).append(entry)  # the file has the whole list
        else:
            here[last] = entry
    return yaml.safe_dump(data, sort_keys=False, allow_unicode=True) if data else "# as in the file\n"


def _drive(bench: PositionBench, size: float) -> Setting:
    """The position of the driven joint: a turn to both sides, or the length of the mechanism."""
    name, start = bench.drive, bench.position
    joints = bench.simulation.mechanism.joints.values()
    rotates = any(
        coordinate.rotation
        for joint in joints
        for own, coordinate in zip(joint.coordinate_names, joint.kind.coordinates, strict=True)
        if own == name
    )
    factor, end, unit = (math.radians(1.0), 360.0, "deg") if rotates else (1.0, _round(size), "m")
    shown = start / factor
    return Setting("drive", "Drive", name, name, unit, factor, shown, _round(shown - end), _round(shown + end))


def _commands(simulation: BaseSimulation, size: float) -> Iterator[Setting]:
    """Those of actuators and drives, within their limits, or those of the joint."""
    mechanism = simulation.mechanism
    values = iter(simulation.inputs[simulation.model.input_layout.commands].tolist())
    for taker in mechanism.commanded:
        rotates, joint = _moved(mechanism, taker)
        for channel, bounds in zip(taker.channels, action_bounds(mechanism, taker), strict=True):
            value, name = next(values), f"{taker.name}.{channel}"
            unit, factor, end = _of_channel(mechanism, channel, rotates, size)
            if channel == "effort" and joint is not None:
                end = joint.effort_limit or end
            shown = float(f"{value / factor:.12g}")
            middle = shown if channel == "position" else 0.0
            lower, upper = (float(f"{bound / factor:.12g}") for bound in bounds)
            low = min(lower if math.isfinite(lower) else _round(middle - end), shown)
            high = max(upper if math.isfinite(upper) else _round(middle + end), shown)
            yield Setting("command", "Commands", name, name, unit, factor, shown, low, high)


def _moved(mechanism: Mechanism, taker: Actuator | CommandedDrive) -> tuple[bool, Joint | None]:
    """Whether an actuator or a drive turns something, and the joint that it moves."""
    if isinstance(taker, CommandedDrive):
        joint = mechanism.joints[taker.name]
        return joint.kind.coordinates[0].rotation, joint
    port = taker.port
    if not isinstance(port, CoordinatePort):
        return port.rotation, None
    return port.rotation, next(one for one in mechanism.joints.values() if port.coordinate in one.coordinate_names)


def _of_channel(mechanism: Mechanism, channel: Channel, rotates: bool, size: float) -> tuple[str, float, float]:
    """The unit of a command, what makes SI units of it, and its end if it has no limit."""
    match channel:
        case "position":
            return ("deg", DEGREE, TURN) if rotates else ("m", 1.0, _round(size))
        case "velocity":
            return ("deg/s", DEGREE, FAST) if rotates else ("m/s", 1.0, _round(5.0 * size))
        case "effort":
            full = weight(mechanism, size)
            return ("N*m", 1.0, _round(0.5 * size * full)) if rotates else ("N", 1.0, _round(full))
        case _:
            unit, end = COMMANDS[channel]
            return unit, 1.0, end


def _efforts(simulation: BaseSimulation, size: float) -> Iterator[Setting]:
    mechanism = simulation.mechanism
    full = weight(mechanism, size)
    for joint in mechanism.joints.values():
        if joint.drive:
            continue
        for name, coordinate in zip(joint.coordinate_names, joint.kind.coordinates, strict=True):
            end = joint.effort_limit or _round(full * (0.5 * size if coordinate.rotation else 1.0))
            unit = "N*m" if coordinate.rotation else "N"
            yield Setting("effort", "Efforts", name, name, unit, 1.0, 0.0, -end, end)


def _states(simulation: BaseSimulation, size: float) -> Iterator[Setting]:
    """The position and the speed of each joint with one coordinate; loops are closed from there."""
    names, model = simulation.coordinate_names, simulation.model
    places = dict(zip(names, model.coordinates(model.start).tolist(), strict=True))
    speeds = dict(zip(names, model.start[model.u_range].tolist(), strict=True))
    for joint in simulation.mechanism.joints.values():
        if joint.drive or len(joint.kind.coordinates) != 1:
            continue
        (name,), (coordinate,) = joint.coordinate_names, joint.kind.coordinates
        factor, reach, unit = (math.radians(1.0), 180.0, "deg") if coordinate.rotation else (1.0, _round(size), "m")
        place, limits = float(f"{places[name] / factor:.12g}"), joint.limits_of(0)
        lower, upper = (limits.lower / factor, limits.upper / factor) if limits else (-math.inf, math.inf)
        low = min(_round(lower if math.isfinite(lower) else place - reach), place)
        high = max(_round(upper if math.isfinite(upper) else place + reach), place)
        yield Setting("position", "Positions", f"position {name}", name, unit, factor, place, low, high)
        speed = float(f"{speeds[name] / factor:.12g}")
        end = max(2.0 * reach, 2.0 * abs(speed))
        yield Setting("speed", "Speeds", f"speed {name}", name, f"{unit}/s", factor, speed, -end, end)


def _values(simulation: BaseSimulation, size: float) -> Iterator[Setting]:
    mechanism = simulation.mechanism
    for key, value in simulation.live.items():
        text = _written(mechanism, key)
        unit, factor, with_unit = "", 1.0, True
        if isinstance(text, str):
            formula, unit = split_unit(text)
            number = _constant(formula, mechanism)
            if number is None:
                continue  # it follows other values
            factor = si_factor(unit) if unit else 1.0
            value = number * factor
        elif text is not None:
            value = float(text)
        shown = float(f"{value / factor:.12g}")
        group, label = _named(key)
        given = mechanism.ranges.get(label) if group == "Parameters" else None
        if given is not None:  # a value that was changed with --set may be outside
            low, high = (float(f"{end / factor:.12g}") for end in given)
            low, high = min(low, shown), max(high, shown)
        else:
            low, high = _range(mechanism, key, shown, size / factor if group == "Parameters" else size, factor)
        if not unit:
            unit, with_unit = _si_unit(mechanism, key), False
        yield Setting("value", group, key, label, unit, factor, shown, low, high, with_unit)


def _constant(formula: str, mechanism: Mechanism) -> float | None:
    """The value of a number or of a formula such as `2*pi`; None if it depends on other values of the file."""
    if names_in(formula, mechanism.parameters):
        return None
    try:
        return evaluate(formula, {})
    except InputError:
        return None  # it calls a function of the file


def _written(mechanism: Mechanism, key: str) -> Any:
    try:
        return value_at(mechanism.source.data, location_of(mechanism, key))
    except MechanismError:
        return None


def _named(key: str) -> tuple[str, str]:
    """The folder of a setting, and its label there."""
    section, _, rest = key.partition(".")
    if section.startswith("gravity"):
        return "Gravity", "xyz"[int(key[8])]
    return section.capitalize(), rest


def _one_coordinate(mechanism: Mechanism, key: str) -> bool | None:
    """Whether the joint of a value rotates; None if it has not one coordinate, or the value is that of no joint."""
    section, _, rest = key.partition(".")
    joint = mechanism.joints.get(rest.rpartition(".")[0]) if section == "joints" else None
    return joint.kind.coordinates[0].rotation if joint and len(joint.kind.coordinates) == 1 else None


def _si_unit(mechanism: Mechanism, key: str) -> str:
    """The unit of a number that the file gives without one, as far as its key says which; "" if not."""
    if key.startswith("gravity"):
        return "m/s^2"
    name, rotates = key.rpartition(".")[2], _one_coordinate(mechanism, key)
    if rotates is None:
        return {"stiffness": "N/m", "length": "m"}.get(name, "") if key.startswith("forces.") else ""
    turning, sliding = {"stiffness": ("N*m/rad", "N/m"), "damping": ("N*m*s/rad", "N*s/m")}.get(name, ("", ""))
    return turning if rotates else sliding


def _range(mechanism: Mechanism, key: str, value: float, size: float, factor: float = 1.0) -> tuple[float, float]:
    """Sensible ends of a slider."""
    if key.startswith("gravity"):
        return -max(GRAVITY, abs(value)), max(GRAVITY, abs(value))
    if key.endswith(".restitution"):
        return 0.0, 1.0
    rotates, scale = _one_coordinate(mechanism, key), weight(mechanism, size)
    if rotates is not None and key.endswith((".stiffness", ".damping")):
        stiff = scale * size if rotates else 10.0 * scale / size
        critical = 2.0 * math.sqrt(stiff * mechanism.mass) * (size if rotates else 1.0)  # of the whole mechanism
        if key.endswith(".damping"):
            return 0.0, max(_round((0.1 if rotates else 1.0) * critical / factor), _round(4.0 * value))
        if value == 0.0:
            return 0.0, _round(stiff)
    if value == 0.0:
        return 0.0, _round(scale * size * (0.1 if key.endswith("damping") else 1.0))
    if key.startswith("parameters."):
        ends = sorted((0.25 * value, 2.0 * value))
        return _round(ends[0]), _round(ends[1])
    return min(0.0, _round(4.0 * value)), max(0.0, _round(4.0 * value))


def _round(value: float) -> float:
    """A value with two digits."""
    return float(f"{value:.1e}")
