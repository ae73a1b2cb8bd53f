"""What is exported of a mechanism: its traced functions, and the names of their arguments and results.

The start is exported as functions of the parameters: what the file gives, and what closes its loops.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from mbd_sim.base.errors import MechanismError, Problem
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import unit
from mbd_sim.dynamics.actuators.functions import MOTOR_READINGS
from mbd_sim.dynamics.constraints.functions import TracedFunctions
from mbd_sim.dynamics.constraints.start import given_start
from mbd_sim.dynamics.equations import Equations, derive
from mbd_sim.dynamics.kinematics.parameters import Path, with_symbols
from mbd_sim.exports.c_code.variables import (
    Variable,
    actuator_outputs,
    distinct,
    drive_outputs,
    identifier,
    input_variables,
    point_outputs,
    state_variables,
)
from mbd_sim.files.text.yaml_text import mechanism_text
from mbd_sim.integrators.between_steps import BetweenSteps
from mbd_sim.integrators.method import Method
from mbd_sim.integrators.methods import METHODS
from mbd_sim.mechanism.contents import require_two_sided
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.laws import Expressed
from mbd_sim.simulation.model.commands import require_parts
from mbd_sim.simulation.model.method_choice import choose_method
from mbd_sim.simulation.model.prepared import require_method
from mbd_sim.simulation.run.arguments import step_size
from mbd_sim.studies.algebra.samples import with_forces_alone
from mbd_sim.studies.optimization.parameter_inputs import (
    ParameterInputs,
    casadi_expression,
    parameter_inputs,
    start_numbers,
)


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
        states = actuator.motor.start_states
        motor = actuator.motor.with_start_states({state: start["state", actuator.name, state] for state in states})
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
        elif kind == "state":
            found[path] = slots[name].states[str(path[2])]
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


ALWAYS = ("rk4", "tsitouras8")  # methods of which every export has a step; Adams methods need the latter


_HEADERS = (
    "math",
    "stdbool",
    "stddef",
    "stdint",
    "stdio",
    "stdlib",
    "string",
    "fmi3_model",
    "fmi3_types",
    "fmi3_functions",
)


@dataclass(frozen=True, eq=False)
class ExportedModel:
    """A mechanism with the functions that become C code.

    `name` is a C identifier. `methods` begins with the one that its file, or the caller, chose; `step` is in s.
    `values(p)` are the numbers of the equations for the parameters, `start` is the start for any of them, and
    `outputs(t, y, inputs, p)` are those of `output_variables`. `remarks` say what differs from a simulation, or is left
    out.
    """

    name: str
    mechanism: Mechanism
    equations: Equations
    methods: tuple[Method, ...]
    step: float
    states: tuple[Variable, ...]
    inputs: tuple[Variable, ...]
    parameters: tuple[Variable, ...]
    output_variables: tuple[Variable, ...]
    values: ca.Function
    outputs: ca.Function
    start: StartFunctions
    remarks: tuple[str, ...]

    @property
    def between_steps(self) -> BetweenSteps | None:
        """What changes in the state at the start of a step; None if nothing does."""
        actuators = self.equations.actuators
        between = None if actuators is None else actuators.between_steps
        return between if between is not None and (between.delays or between.samplers) else None

    @property
    def hash(self) -> str:
        """The SHA-256 hash of the mechanism's file, as hexadecimal digits."""
        return hashlib.sha256(mechanism_text(self.mechanism.source).encode()).hexdigest()

    def tangent(self) -> ca.Function:
        """(t, y, inputs, p, dy, d inputs, dp) -> the derivatives of rates and outputs along that direction.

        Here the inputs are those alone, without the numbers that depend on the parameters.
        """
        sizes = {"y": len(self.states), "u": len(self.inputs), "p": len(self.parameters)}
        t, given = ca.SX.sym("t"), [ca.SX.sym(name, size) for name, size in sizes.items()]
        seeds = [ca.SX.sym(f"d_{name}", size) for name, size in sizes.items()]
        y, u, p = given
        inputs = ca.vertcat(u, self.values(p))
        found = [self.equations.rates.call([t, y, inputs])[0], self.outputs(t, y, inputs, p)]
        along = [ca.densify(ca.jtimes(value, ca.vertcat(*given), ca.vertcat(*seeds))) for value in found]
        return ca.Function("tangent", [t, *given, *seeds], along, {"cse": True})


def export_model(
    mechanism: Mechanism,
    *,
    method: str | None = None,
    step: float | None = None,
    parameters: Sequence[str] = (),
    wrenches: Sequence[str] = (),
) -> ExportedModel:
    """Trace a mechanism for C code.

    :param method: by default that of the file.
    :param step: in s; by default that of the file.
    :param parameters: keys of numbers of the file that stay variable, as for live values: `l`, `parts.rod.mass`.
    :param wrenches: parts on which forces can act.
    :raises MechanismError: it has one-sided elements, the method uses series, or a key cannot be a parameter.
    :raises CommandError: there is no such part.
    """
    reason = "cannot be exported, since its steps would end at events that only the simulation locates"
    require_two_sided(mechanism, reason, "Make contacts compliant, or leave the one-sided elements out.")
    require_parts(wrenches, mechanism)
    step = step_size(step, mechanism.step)
    numbers, given = None, mechanism
    if parameters:
        given = with_forces_alone(mechanism)
        numbers = parameter_inputs(given, parameters, starts=True)
    equations = derive(given, wrenches, None if numbers is None else numbers.numbers, step)
    centers = [given.parts[part].center for part in wrenches]
    inputs = equations.inputs_at_start(centers)
    methods, remarks = _methods(given, equations, inputs, method, step)
    variables, outputs = _outputs(equations, numbers, _knows_potential(mechanism, equations, bool(parameters)), remarks)
    if mechanism.sensors:
        remarks.append(f"sensors are left out: {', '.join(sensor.name for sensor in mechanism.sensors)}")
    p = ca.SX.sym("p", len(parameters))
    values = ca.SX(0, 1) if numbers is None else numbers.numbers_at(p)
    starts = [] if numbers is None else numbers.values.tolist()
    return ExportedModel(
        name=_module_name(mechanism),
        mechanism=mechanism,
        equations=equations,
        methods=methods,
        step=step,
        states=state_variables(equations, _start_state(equations)),
        inputs=input_variables(equations, inputs),
        parameters=distinct([_parameter(key, start) for key, start in zip(parameters, starts, strict=True)]),
        output_variables=variables,
        values=ca.Function("values", [p], [ca.densify(values)], {"cse": True}),
        outputs=outputs,
        start=start_functions(equations, numbers, centers),
        remarks=tuple(remarks),
    )


def _module_name(mechanism: Mechanism) -> str:
    """The name of the mechanism in lower case, if its header does not have the name of another one then."""
    name = identifier(mechanism.name).lower()
    return f"{name}_mechanism" if name in _HEADERS else name


def _start_state(equations: Equations) -> Array:
    """The state at the start, with unit quaternions."""
    start, joints = equations.start_state.copy(), equations.mechanism.joints
    for name, span in equations.layout.q.items():
        first = joints[name].kind.quaternion
        if first is not None and not joints[name].drive:
            place = slice(span.start + first, span.start + first + 4)
            start[place] = unit(start[place])
    return start


def _parameter(key: str, start: float) -> Variable:
    return Variable(f"p_{identifier(key)}", key, "", f"{key} of the mechanism's file, in SI units", start)


def _methods(
    mechanism: Mechanism, equations: Equations, inputs: Array, asked: str | None, step: float
) -> tuple[tuple[Method, ...], list[str]]:
    """The chosen method, then those that are always exported.

    :raises MechanismError: the method uses series.
    """
    name = require_method(mechanism, asked)
    choice = choose_method(mechanism, equations, inputs, name, step)
    method, remarks = choice.method, [choice.remark] if choice.remark else []
    if method.uses_series:
        able = ", ".join(other for other, each in METHODS.items() if not each.uses_series)
        message = f"method {method.name} cannot be exported, since its series are compiled for this machine"
        raise MechanismError([Problem(message, f"Choose with --method one of {able}.", key="method")])
    others = [METHODS[other] for other in ALWAYS if other != method.name]
    return (method, *others), remarks


def _knows_potential(mechanism: Mechanism, equations: Equations, has_parameters: bool) -> bool:
    """Whether the function `energies` has all of the potential."""
    laws = [joint.spring for joint in mechanism.joints.values()] + [spring.law for spring in mechanism.springs]
    expressed = any(isinstance(law, Expressed) for law in laws)
    return equations.distant_springs is None and not (has_parameters and expressed)


def _outputs(
    equations: Equations, numbers: ParameterInputs | None, knows_potential: bool, remarks: list[str]
) -> tuple[tuple[Variable, ...], ca.Function]:
    """The outputs, and their function of (t, y, inputs, p)."""
    mechanism = equations.mechanism
    t, y = ca.SX.sym("t"), ca.SX.sym("y", len(equations.start_state))
    inputs, p = ca.SX.sym("inputs", equations.inputs.size), ca.SX.sym("p", 0 if numbers is None else len(numbers.keys))

    def value(function: ca.Function, *more: ca.SX) -> ca.SX:
        return function.call([t, y, inputs, *more][: function.n_in()])[0]

    energies = value(equations.energies)
    variables, found = [Variable("kinetic_energy", "kinetic_energy", "J", "kinetic energy")], [energies[0]]
    if knows_potential:
        variables.append(Variable("potential_energy", "potential_energy", "J", "potential energy"))
        found.append(energies[1])
    else:
        remarks.append("the potential energy is left out: that of a spring with 'force' is an integral in pieces")
    if mechanism.driven_names:
        variables += drive_outputs(mechanism)
        found.append(value(equations.drives))
    if equations.actuators is not None:
        readings = value(equations.actuators.readings)
        for row, column, one in actuator_outputs(mechanism, MOTOR_READINGS):
            variables.append(one)
            found.append(readings[row, column])
    for part in mechanism.parts.values():
        for name, pose in part.points.items():
            point = ca.SX(ca.DM(np.asarray(pose.position)))
            if numbers is not None:
                point = numbers.point_at(part.name, name, p)
            variables += point_outputs(part.name, name)
            found.append(value(equations.measurements.frame(part.name, "pose"), point)[:3])
            found.append(value(equations.measurements.frame(part.name, "velocity"), point)[:3])
    function = ca.Function("outputs", [t, y, inputs, p], [ca.densify(ca.vertcat(*found))], {"cse": True})
    return distinct(variables), function
