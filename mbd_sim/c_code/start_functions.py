"""The start of an exported model as functions of its parameters: what its file gives, and what closes its loops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from mbd_sim.dynamics.constraint_functions import TracedFunctions
from mbd_sim.dynamics.equations import Equations
from mbd_sim.dynamics.initial_conditions import given_start
from mbd_sim.dynamics.symbolic_parameters import Path, with_symbols
from mbd_sim.mechanism.cylinders import Cylinder
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.optimization.parameter_inputs import ParameterInputs, casadi_expression, start_numbers


@dataclass(frozen=True, eq=False)
class StartFunctions:
    """The start of a mechanism for any parameters p (n,).

    `given(p)` are q (nq,) and u (nv,) of the file, before loops are closed. `held(y, inputs, p)` are y and the inputs
    with the states and commands of actuators and drives before the first command, and with the points at which wrenches
    act. `without_formula` are pairs of the index of a state or input and that of a parameter, on which its start
    depends by no short formula.

    `constraints` are functions of (t, q, values); None if there are no constraints or speeds. `coordinates` gives for
    each speed the first index in q of what it moves, and how many there are. `fixed_in_assembly` and `fixed_speeds`
    (nv,) are those that the file gives.
    """

    given: ca.Function
    held: ca.Function
    without_formula: tuple[tuple[int, int], ...]
    constraints: TracedFunctions | None
    coordinates: tuple[tuple[int, int], ...]
    fixed_in_assembly: tuple[bool, ...]
    fixed_speeds: tuple[bool, ...]


def start_functions(equations: Equations, numbers: ParameterInputs | None, centers: Sequence[Any]) -> StartFunctions:
    """Trace the start of a mechanism.

    :param numbers: the parameters, with formulas of the start.
    :param centers: (3,) center of mass of each part with a wrench, in m.
    """
    mechanism, layout = equations.mechanism, equations.layout
    p = ca.SX.sym("p", 0 if numbers is None else len(numbers.keys))
    y = ca.SX.sym("y", len(equations.start_state))
    inputs = ca.SX.sym("inputs", equations.inputs.size)
    start: dict[Path, Any] = dict(start_numbers(mechanism))
    without: list[tuple[int, int]] = []
    if numbers is not None:
        places = _places(equations)
        for path, found in numbers.starts.items():
            if isinstance(found, tuple):
                without += [(places[path], parameter) for parameter in found]
            elif found.parameters:
                start[path] = casadi_expression(found, p)
        symbolic = with_symbols(mechanism, numbers.numbers)[0]
        at = [ca.SX(ca.DM(np.zeros(3))) + symbolic.parts[part].center for part in equations.inputs.loaded]
        centers = [ca.substitute(center, numbers.numbers.symbols, numbers.numbers_at(p)) for center in at]
    q, u = (ca.SX(ca.DM(values)) for values in given_start(mechanism, layout))
    for name in mechanism.joints:
        for what, values, span in (("position", q, layout.q[name]), ("velocity", u, layout.u[name])):
            for index in range(span.start, span.stop):
                values[index] = start[what, name, index - span.start]
    for name, states in layout.drives.items():
        q[states.start] = start["drive", name]
    held_y, held_inputs = ca.SX(y), ca.SX(inputs)
    for span, center in zip(equations.inputs.wrenches.values(), centers, strict=True):
        held_inputs[span.stop - 3 : span.stop] = center
    equations.hold(_with_start(mechanism, start), held_y, held_inputs)
    fixed = [(joint.fixed_in_assembly, joint.fixed_speeds) for joint in mechanism.joints.values()]
    return StartFunctions(
        given=ca.Function("given", [p], [ca.densify(ca.vertcat(q, u))], {"cse": True}),
        held=ca.Function("held", [y, inputs, p], [ca.densify(held_y), ca.densify(held_inputs)], {"cse": True}),
        without_formula=tuple(without),
        constraints=equations.constraints.traced if equations.rows and layout.nv else None,
        coordinates=tuple(_coordinates(equations)),
        fixed_in_assembly=tuple(bool(flag) for flags, _ in fixed for flag in flags),
        fixed_speeds=tuple(bool(flag) for _, flags in fixed for flag in flags),
    )


def _with_start(mechanism: Mechanism, start: dict[Path, Any]) -> Mechanism:
    """The mechanism whose actuators have these numbers at the start."""
    actuators = []
    for actuator in mechanism.actuators:
        motor = actuator.motor
        if isinstance(motor, Cylinder):
            pressures = tuple(start["pressure", actuator.name, index] for index in range(len(motor.pressures)))
            motor = replace(motor, pressures=pressures)
        commands = {channel: start["command", actuator.name, channel] for channel in actuator.start}
        actuators.append(replace(actuator, motor=motor, start=commands))
    return replace(mechanism, actuators=tuple(actuators))


def _places(equations: Equations) -> dict[Path, int]:
    """The index of each start number among the states, and after them the inputs."""
    mechanism, layout = equations.mechanism, equations.layout
    slots = dict(zip((actuator.name for actuator in mechanism.actuators), equations.actuator_layout.slots, strict=True))
    found = {}
    for path in start_numbers(mechanism):
        kind, name = path[0], str(path[1])
        if kind == "position":
            found[path] = layout.q[name].start + int(path[2])
        elif kind == "velocity":
            found[path] = layout.nq + layout.u[name].start + int(path[2])
        elif kind == "drive":
            found[path] = layout.drives[name].start
        elif kind == "pressure":
            found[path] = slots[name].states[f"pressure_{'ab'[int(path[2])]}"]
        else:
            commands = {str(channel): index for channel, index in slots[name].commands.items()}
            found[path] = len(equations.start_state) + commands[str(path[2])]
    return found


def _coordinates(equations: Equations) -> list[tuple[int, int]]:
    """For each speed, where in q it moves something: its coordinate, or the four numbers of a quaternion."""
    found = []
    for name, joint in equations.mechanism.joints.items():
        q, u = equations.layout.q[name], equations.layout.u[name]
        first = joint.kind.quaternion
        for index in range(u.stop - u.start):
            turns = first is not None and index >= first
            found.append((q.start + first, 4) if turns and first is not None else (q.start + index, 1))
    return found
