"""Forces that are undefined at the start: without a direction, or without a finite value."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import assert_never

import numpy as np

from mbd_sim.base.errors import InputError, MechanismError, Problem
from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.layouts.coordinates import coordinate_layout
from mbd_sim.dynamics.layouts.state_scales import natural_units
from mbd_sim.mechanism.contents import ForceExpression, expressions_of_forces
from mbd_sim.mechanism.elements.forces import Damper, Spring
from mbd_sim.mechanism.mass_properties import state_numbers
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import TIME
from mbd_sim.mechanism.values.laws import ELONGATION, ELONGATION_RATE

COINCIDENT = 1e-12  # of the natural length


@dataclass(frozen=True, slots=True)
class StartOfForces:
    """Coordinates q (nq,) and speeds u (nv,) at the start, and the `lengths` (n,) of springs and dampers.

    The lengths are in m, and their `rates` (n,) in m/s.
    """

    q: Array
    u: Array
    lengths: Array
    rates: Array


def require_defined_forces(mechanism: Mechanism, start: StartOfForces) -> None:
    """Refuse forces that are undefined at the start: no direction, or no finite value.

    :raises MechanismError: the elements are named.
    """
    problems = list(_undefined_expressions(mechanism, start))
    least = COINCIDENT * natural_units(mechanism, mechanism.step).length
    for element, length in zip(mechanism.two_point_elements, start.lengths, strict=True):
        if not element.needs_line or length > least:
            continue
        match element:
            case Spring():
                kind, remedy = "spring", "a spring without length or damping needs no direction."
            case Damper():
                kind, remedy = "damper", "a damper with 'along: velocity' needs no direction."
            case _:
                assert_never(element)
        message = f"the ends coincide at the start, where the {kind} has no direction"
        location = ("forces", element.name, "between")
        problems.append(mechanism.source.problem(location, message, f"Move one of the points; {remedy}"))
    if problems:
        raise MechanismError(problems)


def _undefined_expressions(mechanism: Mechanism, start: StartOfForces) -> Iterator[Problem]:
    """Expressions of springs and of the motion that have no finite value at the start."""
    for force in expressions_of_forces(mechanism):
        variables = state_numbers(mechanism, force.expression, 0.0, np.concatenate([start.q, start.u]))
        variables |= _elongation(mechanism, force, start)
        try:
            force.expression.value(variables)
        except InputError:
            shown = {name: value for name, value in variables.items() if name in force.expression.variables - {TIME}}
            where = ", ".join(f"{name} = {value:g}" for name, value in shown.items())
            message = f"has no finite value at the start, where {where}"
            remedy = "Write a force for every elongation that occurs." if force.stretched else _REMEDY
            yield mechanism.source.problem(force.location, message, remedy)


_REMEDY = "Write an expression that is finite over the whole motion."


def _elongation(mechanism: Mechanism, force: ForceExpression, start: StartOfForces) -> dict[str, float]:
    """The elongation of the spring to which an expression belongs, and its rate; empty if it belongs to none."""
    if force.stretched is None:
        return {}
    if isinstance(force.stretched, Spring):
        index = mechanism.springs.index(force.stretched)
        x, rate = start.lengths[index] - force.stretched.length, start.rates[index]
    else:
        layout, joint = coordinate_layout(mechanism), force.stretched
        x, rate = start.q[layout.q[joint.name].start] - joint.rest[0], start.u[layout.u[joint.name].start]
    return {ELONGATION: float(x), ELONGATION_RATE: float(rate)}
