"""Forces and actuators in the report of `mbd_sim check`: what they act on, and what they depend on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, assert_never

from mbd_sim.mechanism.actuators import (
    Actuator,
    CoordinatePort,
    DcMotor,
    EffortMotor,
    LinePort,
    Machine,
    Port,
    SumPort,
    WrenchPort,
)
from mbd_sim.mechanism.cylinders import Cylinder, Oil
from mbd_sim.mechanism.expression import TimeExpression
from mbd_sim.mechanism.force_elements import (
    AppliedEffort,
    AppliedForce,
    AppliedPotential,
    Bushing,
    Damper,
    ForceElement,
    Spring,
)
from mbd_sim.mechanism.laws import Expressed, GreenStrain, Varying
from mbd_sim.mechanism.records import Mechanism

RELATIVE = ("relative position", "relative velocity")


def force_reports(mechanism: Mechanism) -> list[dict[str, Any]]:
    """Each force element: its type, what it acts on, and the names of what it depends on."""
    return [
        {
            "name": element.name,
            "type": _type(element, mechanism),
            "at": _place(element),
            "depends_on": list(_variables(element)),
        }
        for element in mechanism.force_elements
    ]


def _type(element: ForceElement, mechanism: Mechanism) -> str:
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
        case Cylinder(fluid=Oil()):
            return "hydraulic_cylinder"
        case Cylinder():
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
        case Cylinder():
            push, pull = (area * (machine.supply - machine.tank) for area in machine.areas)
            return [f"pushes {push:.4g} N", f"pulls {pull:.4g} N", f"stroke {machine.stroke:g} m"]
        case _:
            assert_never(machine)
    return [f"{value:.4g} {unit}" for value, unit in given if math.isfinite(value)]
