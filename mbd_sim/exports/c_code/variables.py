"""The numbers of an exported model by name: states, inputs, parameters and outputs, in the order of their arrays."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import assert_never

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.equations import Equations
from mbd_sim.dynamics.layouts.actuators import ENERGIES, FLUID
from mbd_sim.dynamics.layouts.vectors import AUDIT_STATES
from mbd_sim.mechanism.contents import commanded_drives
from mbd_sim.mechanism.elements.actuators import PRESSURES, Actuator
from mbd_sim.mechanism.elements.joint_types import Channel, CommandedDrive
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.names import reference

_WRENCH = (
    ("force", "N", "ground's"),
    ("couple", "N.m", "ground's"),
    ("own_force", "N", "the part's"),
    ("own_couple", "N.m", "the part's"),
    ("point", "m", "the part's"),
)
_MEANINGS = {
    "work_applied": "work of the applied forces since the start",
    "work_drives": "work of the drives since the start",
    "dissipated": "energy dissipated since the start",
}


_NOMINAL = {"Pa": 1e5, "J": 1.0}  # the least


@dataclass(frozen=True)
class Variable:
    """A number of a model: a C identifier (`field`), a `name` with dots, an SI `unit` and its value at the start.

    The unit is written with `.` for products, and is "" where the file does not say which it is, and "1" for a pure
    number.
    """

    field: str
    name: str
    unit: str
    description: str
    start: float = 0.0

    @property
    def nominal(self) -> float:
        """The order of magnitude from which tools choose tolerances: 1, but for pressures and their energies."""
        return max(abs(float(self.start)), _NOMINAL[self.unit]) if self.unit in _NOMINAL else 1.0


def identifier(name: str) -> str:
    """A name as a C identifier."""
    plain = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_") or "_"
    return f"_{plain}" if plain[0].isdigit() else plain


def distinct(variables: Sequence[Variable]) -> tuple[Variable, ...]:
    """Variables with distinct fields: where fields are equal, the later ones get numbers."""
    taken: set[str] = set()
    found = []
    for variable in variables:
        field, number = variable.field, 2
        while field in taken:
            field, number = f"{variable.field}_{number}", number + 1
        taken.add(field)
        found.append(replace(variable, field=field))
    return tuple(found)


def variable(prefix: str, name: str, suffix: str, unit: str, description: str, start: float = 0.0) -> Variable:
    """The variable `prefix_name`, called `name.suffix`."""
    return Variable(f"{prefix}_{identifier(name)}", f"{name}.{suffix}", unit, description, start)


def state_variables(equations: Equations, start: Array) -> tuple[Variable, ...]:
    """The components of y, with their values (n,) at the `start`."""
    mechanism, layout = equations.mechanism, equations.layout
    found: dict[int, Variable] = {}
    for name, joint in mechanism.joints.items():
        if joint.drive:
            continue
        kind, q, u = joint.kind, layout.q[name].start, layout.u[name].start
        for index, (coordinate, own) in enumerate(zip(kind.coordinates, joint.motion_names, strict=True)):
            if kind.quaternion is None or index < kind.quaternion:
                about = f"position of {own}"
                found[q + index] = variable("q", own, "position", coordinate.unit, about, start[q + index])
            at = layout.nq + u + index
            found[at] = variable("u", own, "velocity", f"{coordinate.unit}/s", f"speed of {own}", start[at])
        if kind.quaternion is not None:
            for index, letter in enumerate("wxyz", q + kind.quaternion):
                own = f"{name}.q{letter}"
                about = f"component {letter} of the unit quaternion of {name}"
                found[index] = variable("q", own, "position", "1", about, start[index])
    for name, span in layout.drives.items():
        unit = mechanism.joints[name].kind.coordinates[0].unit
        meanings = (("position", unit), ("velocity", f"{unit}/s"), ("acceleration", f"{unit}/s2"))
        for index, (what, own_unit) in enumerate(meanings, span.start):
            found[index] = variable(f"drive_{what}", name, what, own_unit, f"{what} of the drive {name}", start[index])
    found |= _actuator_states(equations, start)
    for index, name in enumerate(AUDIT_STATES, len(start) - len(AUDIT_STATES)):
        found[index] = Variable(name, name, "J", _MEANINGS[name])
    return distinct([found[index] for index in range(len(start))])


def _actuator_states(equations: Equations, start: Array) -> dict[int, Variable]:
    found, mechanism = {}, equations.mechanism
    for actuator, slots in zip(mechanism.actuators, equations.actuator_layout.slots, strict=True):
        units = _state_units(mechanism, actuator)
        for name, index in slots.states.items():
            about = f"{name.replace('_', ' ')} of {actuator.name}"
            found[index] = variable("a", f"{actuator.name}.{name}", "state", units[name], about, start[index])
        for channel, first in slots.lines.items():
            for place in range(slots.delay):
                own = f"{actuator.name}.{channel}.waiting{place}"
                about = f"command of the {channel} of {actuator.name} that waits for its delay"
                found[first + place] = variable("a", own, "state", units[channel], about, start[first + place])
    return found


def _state_units(mechanism: Mechanism, actuator: Actuator) -> dict[str, str]:
    """The unit of each state that an actuator can have: see `mbd_sim.dynamics.layouts.actuators`."""
    output = _command_unit(mechanism, actuator, actuator.control)
    units = {"current": "A", **dict.fromkeys(PRESSURES, "Pa"), **dict.fromkeys((*ENERGIES, *FLUID), "J")}
    units |= {"integral": output, "output": output}
    if actuator.servo is not None:
        units |= dict.fromkeys(("reference", "error"), _command_unit(mechanism, actuator, actuator.servo.controls))
    return units | {channel: _command_unit(mechanism, actuator, channel) for channel in actuator.channels}


def input_variables(equations: Equations, inputs: Array) -> tuple[Variable, ...]:
    """The efforts, wrenches and commands, with their values at the start."""
    mechanism, layout = equations.mechanism, equations.inputs
    found = []
    for name in mechanism.coordinate_names:
        unit = mechanism.coordinate(name).effort_unit.replace("·", ".")
        found.append(variable("effort", name, "effort", unit, f"generalized force on {name}"))
    for part in layout.loaded:
        for what, unit, axes in _WRENCH:
            for letter in "xyz":
                about = f"{what.replace('_', ' ')} on {part} in {axes} axes"
                if what == "point":
                    about = f"point of {part} at which the forces act, in the part's frame"
                start = float(inputs[len(found)])
                found.append(variable("wrench", f"{part}.{what}.{letter}", "wrench", unit, about, start))
    for taker in mechanism.commanded:
        for channel in taker.channels:
            about = f"command of the {channel} of {taker.name}"
            start, unit = float(inputs[len(found)]), _command_unit(mechanism, taker, channel)
            found.append(variable("command", f"{taker.name}.{channel}", "command", unit, about, start))
    return distinct(found)


def _command_unit(mechanism: Mechanism, taker: Actuator | CommandedDrive, channel: Channel) -> str:
    match channel:
        case "voltage":
            return "V"
        case "current":
            return "A"
        case "opening":
            return "1"
        case "position" | "velocity" | "effort":
            return _unit_of(mechanism, taker, channel)
        case _:
            assert_never(channel)


def _unit_of(mechanism: Mechanism, taker: Actuator | CommandedDrive, quantity: str) -> str:
    """The unit of a position, velocity or effort of an actuator or drive."""
    own = taker.port.rotation if isinstance(taker, Actuator) else None
    rotates = mechanism.joints[taker.name].kind.rotates if own is None else own
    units = {"position": "rad", "velocity": "rad/s", "effort": "N.m"}
    return units[quantity] if rotates else {"position": "m", "velocity": "m/s", "effort": "N"}[quantity]


def drive_outputs(mechanism: Mechanism) -> list[Variable]:
    """Position, velocity and effort of each driven coordinate, one quantity after the other."""
    commanded = commanded_drives(mechanism)
    found = []
    for what in ("position", "velocity", "effort"):
        for name in mechanism.driven_names:
            unit = mechanism.coordinate(name).unit
            units = {"position": unit, "velocity": f"{unit}/s", "effort": "N.m" if unit == "rad" else "N"}
            suffix = f"drive_{what}" if name in commanded else what  # positions of commanded drives are states too
            found.append(variable(f"drive_{what}", name, suffix, units[what], f"{what} of the drive of {name}"))
    return found


def actuator_outputs(mechanism: Mechanism, readings: Sequence[str]) -> list[tuple[int, int, Variable]]:
    """Effort, voltage and current of the actuators, with their row and column in the readings."""
    found = []
    for column, actuator in enumerate(mechanism.actuators):
        electric = {"voltage": "V", "current": "A"} if actuator.motor.electric else {}
        for what, unit in {"effort": _unit_of(mechanism, actuator, "effort"), **electric}.items():
            about = f"{what} of {actuator.name}"
            found.append((readings.index(what), column, variable(what, actuator.name, f"motor_{what}", unit, about)))
    return found


def point_outputs(part: str, point: str) -> list[Variable]:
    """Position and velocity of a point in ground's axes."""
    name, found = reference(part, point), []
    for what, prefix, unit in (("position", "p", "m"), ("velocity", "v", "m/s")):
        for letter in "xyz":
            about = f"{what} {letter} of {name} in ground's axes"
            found.append(variable(prefix, f"{name}.{letter}", what, unit, about))
    return found
