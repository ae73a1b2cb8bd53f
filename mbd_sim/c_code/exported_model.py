"""What is exported of a mechanism: its traced functions, and the names of their arguments and results."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.c_code.start_functions import StartFunctions, start_functions
from mbd_sim.c_code.variables import (
    Variable,
    actuator_outputs,
    distinct,
    drive_outputs,
    identifier,
    input_variables,
    point_outputs,
    state_variables,
)
from mbd_sim.dynamics.actuator_functions import MOTOR_READINGS
from mbd_sim.dynamics.equations import Equations, derive
from mbd_sim.errors import MechanismError, Problem
from mbd_sim.geometry.pose import Array
from mbd_sim.geometry.rotation import unit
from mbd_sim.integrators.adams import ADAMS, Adams
from mbd_sim.integrators.between_steps import BetweenSteps
from mbd_sim.integrators.methods import METHODS
from mbd_sim.integrators.tableau import EXPLICIT, Tableau
from mbd_sim.mechanism.laws import Expressed
from mbd_sim.mechanism.one_sided import require_two_sided
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism_file.yaml_writer import mechanism_text
from mbd_sim.optimization.parameter_inputs import ParameterInputs, parameter_inputs
from mbd_sim.simulation.argument_checks import step_size
from mbd_sim.simulation.method_choice import choose_method
from mbd_sim.simulation.method_name import require_method
from mbd_sim.simulation.wrenches import require_parts
from mbd_sim.symbolic.symbolic_values import with_forces_alone

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
    methods: tuple[Tableau | Adams, ...]
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

    :param method: an explicit method; by default that of the file.
    :param step: in s; by default that of the file.
    :param parameters: keys of numbers of the file that stay variable, as for live values: `l`, `parts.rod.mass`.
    :param wrenches: parts on which forces can act.
    :raises MechanismError: it has one-sided elements, the method is implicit, or a key cannot be a parameter.
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
) -> tuple[tuple[Tableau | Adams, ...], list[str]]:
    """The chosen method, then those that are always exported.

    :raises MechanismError: the method is implicit.
    """
    name = require_method(mechanism, asked)
    choice = choose_method(mechanism, equations, inputs, name, step)
    method, remarks = choice.method, [choice.remark] if choice.remark else []
    if not isinstance(method, Tableau | Adams):
        message = f"method {method.name} cannot be exported" + (f": {choice.remark}" if choice.remark else "")
        rate = f" with steps of less than {step:g} s" if choice.remark else ""
        raise MechanismError(
            [Problem(message, f"Choose with --method one of {', '.join([*EXPLICIT, *ADAMS])}{rate}.", key="method")]
        )
    others = [METHODS[other] for other in ALWAYS if other != method.name]
    return (method, *(other for other in others if isinstance(other, Tableau))), remarks


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
