"""Bodies, force elements, actuators and sensors in the report of `mbd_sim check`, and what a step costs.

For forces and actuators the report says what they act on and what they depend on, and for sensors what they measure.
With `--inertia` it gives center of mass, inertia tensor and principal axes of each part and of the whole, and with
`--cost` the scalar instructions of the compiled functions, counted by kind.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, assert_never

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.compiler.lists.instruction_list import MULTIPLY_ADD, MULTIPLY_SUBTRACT, SUBTRACT_PRODUCT, InstructionList
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.dynamics.equations import Equations
from mbd_sim.integrators.method import Method
from mbd_sim.mechanism.elements.actuators import (
    Actuator,
    CoordinatePort,
    DcMotor,
    EffortMotor,
    FluidCylinder,
    LinePort,
    Machine,
    Oil,
    Port,
    SumPort,
    WrenchPort,
)
from mbd_sim.mechanism.elements.forces import (
    AppliedEffort,
    AppliedForce,
    AppliedPotential,
    Bushing,
    Damper,
    ForceElement,
    Spring,
)
from mbd_sim.mechanism.elements.parts import Part
from mbd_sim.mechanism.elements.sensors import (
    EXACT,
    AnySensor,
    CoordinateSensor,
    Encoder,
    ErrorModel,
    ForceTorque,
    MotorCurrent,
)
from mbd_sim.mechanism.mass_properties import MassProperties, composite
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.mechanism.values.laws import Expressed, GreenStrain, Varying

RELATIVE = ("relative position", "relative velocity")


def force_reports(mechanism: Mechanism) -> list[dict[str, Any]]:
    """Each force element: its type, what it acts on, and the names of what it depends on."""
    return [
        {
            "name": element.name,
            "type": _type(element),
            "at": _place(element),
            "depends_on": list(_variables(element)),
        }
        for element in mechanism.force_elements
    ]


def _type(element: ForceElement) -> str:
    match element:
        case Spring(law=GreenStrain()):
            return "elastic_bar"
        case Spring(law=Expressed() | Varying()):
            return "spring by law"
        case Spring():
            return "spring"
        case Damper():
            return "damper"
        case AppliedForce():
            return "couple" if element.couple else "force"
        case AppliedEffort():
            return "effort"
        case AppliedPotential():
            return "potential"
        case Bushing():
            return "joint spring" if element.in_joint else "bushing"
        case _:
            assert_never(element)


def _place(element: ForceElement) -> str:
    match element:
        case Spring() | Damper() | Bushing():
            return f"{element.first.part} – {element.second.part}"
        case AppliedForce():
            return element.at.part
        case AppliedEffort():
            return element.coordinate
        case AppliedPotential():
            return ", ".join(dict.fromkeys(name.coordinate for name in element.energy.state))
        case _:
            assert_never(element)


def _variables(element: ForceElement) -> Iterator[str]:
    """The names of what a force depends on; none for a constant one."""
    match element:
        case Spring():
            law = element.law
            found = _names([law.force]) if isinstance(law, Expressed | Varying) else ["x"] if element.elastic else []
            yield from found
            if element.damping and "x.velocity" not in found:
                yield "x.velocity"
        case Damper():
            yield "x.velocity" if element.needs_line else RELATIVE[1]
        case AppliedForce():
            yield from _names(element.vector)
        case AppliedEffort():
            yield from _names([element.effort])
        case AppliedPotential():
            yield from _names([element.energy])
        case Bushing():
            if element.stiffness.any():
                yield RELATIVE[0]
            if element.damping.any():
                yield RELATIVE[1]
        case _:
            assert_never(element)


def _names(expressions: Sequence[TimeExpression]) -> list[str]:
    return sorted(set().union(*(expression.variables for expression in expressions)))


def actuator_report(actuator: Actuator) -> dict[str, Any]:
    """The type of an actuator, what it acts on, its servo and its commands, and its data in SI units."""
    servo = actuator.servo
    return {
        "name": actuator.name,
        "type": _machine(actuator.motor),
        "at": _port(actuator.port),
        "servo": None if servo is None else servo.controls,
        "sample_rate": None if servo is None or servo.period is None else 1.0 / servo.period,
        "commands": list(actuator.channels),
        "delay": actuator.delay,
        "limits": _limits(actuator),
    }


def _machine(machine: Machine) -> str:
    match machine:
        case EffortMotor():
            return "effort"
        case DcMotor():
            return "dc_motor"
        case FluidCylinder(fluid=Oil()):
            return "hydraulic_cylinder"
        case FluidCylinder():
            return "pneumatic_cylinder"
        case _:
            assert_never(machine)


def _port(port: Port) -> str:
    match port:
        case CoordinatePort():
            return port.coordinate
        case LinePort():
            return f"{port.first.part} – {port.second.part}"
        case SumPort():
            return ", ".join(port.factors)
        case WrenchPort():
            return port.at.part
        case _:
            assert_never(port)


def _limits(actuator: Actuator) -> list[str]:
    """The limits of an actuator as text, with their units."""
    machine, effort = actuator.motor, "N·m" if actuator.port.rotation else "N"
    match machine:
        case EffortMotor():
            given = [(actuator.output_limit, effort)]
            if any(map(math.isfinite, machine.effort_range)):
                lower, upper = machine.effort_range
                return [f"{lower:.4g} to {upper:.4g} {effort}"]
        case DcMotor():
            given = [(machine.voltage_limit, "V"), (machine.current_limit, "A")]
        case FluidCylinder():
            push, pull = (area * (machine.supply - machine.tank) for area in machine.areas)
            return [f"pushes {push:.4g} N", f"pulls {pull:.4g} N", f"stroke {machine.stroke:g} m"]
        case _:
            assert_never(machine)
    return [f"{value:.4g} {unit}" for value, unit in given if math.isfinite(value)]


WHOLE = "whole mechanism"
INERTIA_ROUND_OFF = 1e-15  # relative to the largest number


def inertia_report(parts: Mapping[str, Part], poses: Mapping[str, Pose]) -> list[dict[str, Any]]:
    """One record for each part in its own frame, and one for all parts as one rigid body in ground's frame at `poses`.

    Parts without mass are left out. The principal axes (3, 3) are unit vectors, one in each row, in the order of
    increasing principal moments.
    """
    bodies = {
        name: MassProperties(part.mass, part.center, part.inertia) for name, part in parts.items() if part.mass > 0.0
    }
    records = [_record(name, body) for name, body in bodies.items()]
    if bodies:
        records.append(_record(WHOLE, composite([body.placed(poses[name]) for name, body in bodies.items()])))
    return records


def _record(name: str, body: MassProperties) -> dict[str, Any]:
    moments, axes = np.linalg.eigh(body.inertia)
    axes = axes * np.where(axes[np.argmax(np.abs(axes), axis=0), range(3)] < 0.0, -1.0, 1.0)
    return {
        "name": name,
        "mass": body.mass,
        "center": body.center.tolist(),
        "inertia": body.inertia.tolist(),
        "inertia_at_origin": body.about(np.zeros(3)).tolist(),
        "principal_moments": moments.tolist(),
        "principal_axes": axes.T.tolist(),
    }


def inertia_text(records: list[dict[str, Any]]) -> str:
    """The report as text, in kg, m and kg·m²."""
    return "\n\n".join(_text(record) for record in records)


def _text(record: dict[str, Any]) -> str:
    frame = "the ground frame, at the start" if record["name"] == WHOLE else "the frame of the part"
    lines = [f"{record['name']}: {record['mass']:.6g} kg, center of mass {_row(record['center'])} m, in {frame}"]
    lines += _matrix("inertia about center of mass", record["inertia"])
    lines += _matrix("inertia about origin", record["inertia_at_origin"])
    moments = _cleaned(record["principal_moments"])
    lines += [
        f"  principal moment {moment:.6g} kg·m² about {_row(axis)}"
        for moment, axis in zip(moments, record["principal_axes"], strict=True)
    ]
    return "\n".join(lines)


def _matrix(title: str, rows: list[list[float]]) -> list[str]:
    size = float(np.max(np.abs(rows)))
    return [f"  {title if not index else '':30s} {_row(row, size)}" for index, row in enumerate(rows)]


def _row(values: list[float], size: float = 0.0) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in _cleaned(values, size)) + "]"


def _cleaned(values: list[float], size: float = 0.0) -> list[float]:
    """The values with round-off replaced by zero; otherwise it would hide that the axes are principal axes."""
    largest = max(size, *(abs(value) for value in values))
    return [0.0 if abs(value) < INERTIA_ROUND_OFF * largest else value for value in values]


def sensor_report(sensor: AnySensor, step: float) -> dict[str, Any]:
    """Type, place, timing, and the errors of each quantity that has any, in SI units.

    :param step: in s.
    """
    pairs = list(zip(sensor.quantities, sensor.errors, strict=True))
    resolution = {"resolution": sensor.resolution} if isinstance(sensor, Encoder) else {}
    return {
        "name": sensor.name,
        "type": sensor.kind,
        "at": _sensor_place(sensor),
        "rate": 1.0 / step if sensor.sampling.rate is None else sensor.sampling.rate,
        "delay": sensor.sampling.delay,
        "drop_out": sensor.sampling.drop_out,
        "units": {quantity.name: quantity.unit for quantity in sensor.quantities},
        "errors": {
            quantity.name: {**_given(errors), **resolution}
            for quantity, errors in pairs
            if errors != EXACT or resolution
        },
    }


def _sensor_place(sensor: AnySensor) -> str:
    if isinstance(sensor, CoordinateSensor):
        return sensor.coordinate
    if isinstance(sensor, ForceTorque):
        return sensor.joint
    if isinstance(sensor, MotorCurrent):
        return sensor.actuator
    position = ", ".join(f"{value:.6g}" for value in sensor.at.pose.position + 0.0)
    return sensor.at.part if sensor.at.is_of_part else f"{sensor.at.part} [{position}]"


def _given(errors: ErrorModel) -> dict[str, float]:
    return {key: value for key, value in vars(errors).items() if value and math.isfinite(value)}


_KINDS = {
    "additions": (ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_TWICE),
    "multiplications": (ca.OP_MUL, ca.OP_SQ),
    "fused of both": (MULTIPLY_ADD, MULTIPLY_SUBTRACT, SUBTRACT_PRODUCT),
    "divisions": (ca.OP_DIV, ca.OP_INV),
    "roots": (ca.OP_SQRT,),
    "sines and cosines": (ca.OP_SIN, ca.OP_COS),
}
_TITLES = {"fused of both": "fused multiply-add"}  # columns whose title differs from their key
_FREE = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST)


def cost(equations: Equations, method: Method) -> dict[str, Any]:
    """The instructions of one evaluation of the accelerations, of one projection onto the constraints, and of a step.

    A step takes `evaluations` of the accelerations and one projection; implicit methods take more instructions, and so
    do Adams methods where the motion is not smooth. Of a Taylor method, this is a step that has no expansion.
    """
    evaluations = method.evaluations
    accelerations = _counted(arranged(equations.rates))
    projection = _counted(arranged(equations.project, fused=False)) if equations.project is not None else {}
    return {
        "accelerations": accelerations,
        "back_to_constraints": projection,
        "evaluations": evaluations,
        "step": evaluations * sum(accelerations.values()) + sum(projection.values()),
    }


def cost_text(found: dict[str, Any]) -> str:
    """The result of `cost` as a table."""
    columns = [*_KINDS, "others"]
    lines = [f"{'instructions':22s}" + "".join(f"{_TITLES.get(name, name):>19s}" for name in ("all", *columns))]
    for key, name in (("accelerations", "accelerations"), ("back_to_constraints", "projection")):
        if found[key]:
            counts = (sum(found[key].values()), *(found[key][kind] for kind in columns))
            lines.append(f"{name:22s}" + "".join(f"{count:19d}" for count in counts))
    lines.append(f"{'one step':22s}{found['step']:19d}  ({found['evaluations']} evaluations of the accelerations)")
    return "\n".join(lines)


def _counted(program: InstructionList) -> dict[str, int]:
    of_kind = {operation: kind for kind, operations in _KINDS.items() for operation in operations}
    operations = (program.instruction_id(index) for index in range(program.n_instructions()))
    counts = Counter(of_kind.get(operation, "others") for operation in operations if operation not in _FREE)
    return {kind: counts[kind] for kind in (*_KINDS, "others")}
