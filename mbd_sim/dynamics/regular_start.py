"""The start of a mechanism as a state, at which its equations must be regular."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.accelerations import AppliedForces
from mbd_sim.dynamics.constraints.errors import undefined_constraints
from mbd_sim.dynamics.constraints.start import AssembledStart, Assembly
from mbd_sim.dynamics.forces.undefined import StartOfForces, require_defined_forces
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.math.evaluation import evaluated
from mbd_sim.dynamics.recursion.articulated_body import FactorizedMassMatrix
from mbd_sim.dynamics.recursion.mass_matrix_check import require_definite, require_independent

if TYPE_CHECKING:
    from mbd_sim.dynamics.actuators.functions import ActuatorFunctions


def _start_state(traced: TracedMechanism, start: AssembledStart) -> Array:
    return np.concatenate([start.q, start.u, np.zeros(traced.y.shape[0] - len(start.q) - len(start.u))])


def start_with_actuators(
    traced: TracedMechanism, start: AssembledStart, forces: AppliedForces
) -> tuple[Array, ActuatorFunctions | None]:
    """The start state, with the states of the actuators, and their functions."""
    y = _start_state(traced, start)
    if forces.actuators is None:
        return y, None
    from mbd_sim.dynamics.actuators.functions import actuator_functions, require_within_strokes

    functions = actuator_functions(traced, forces.actuators)
    functions.hold(traced.numeric.actuators, y)
    require_within_strokes(traced.numeric, functions, y)
    return y, functions


def require_regular_start(
    traced: TracedMechanism, assembly: Assembly, forces: AppliedForces, mass_matrix: FactorizedMassMatrix
) -> None:
    """Refuse a start at which a constraint or a force is undefined, or the mass matrix singular.

    :raises MechanismError: it names what is undefined, or the parts that can move without inertia.
    """
    elements = [ca.densify(forces.elements.lengths), ca.densify(forces.elements.rates)]
    outputs = [ca.densify(assembly.equations.bias), *elements, mass_matrix.pivots, traced.flat_poses]
    symbols = [traced.state.t, traced.y, traced.parameters.symbols]
    at_start = ca.Function("at_start", symbols, outputs)
    values = at_start(0.0, _start_state(traced, assembly.start), traced.parameters.base)
    bias, lengths, rates, pivots, poses = (np.array(value).ravel() for value in values)
    if not np.all(finite := np.isfinite(bias)):
        raise undefined_constraints(traced.numeric, assembly.equations.rows, ~finite)
    start = StartOfForces(assembly.start.q, assembly.start.u, lengths, rates)
    require_defined_forces(traced.numeric, start)
    links = traced.numeric_links
    require_definite(traced.numeric, links, pivots, poses.reshape(-1, 12))
    if traced.layout.nv:
        require_independent(traced.numeric, links, start_mass_matrix(traced, assembly.start.q))


def start_mass_matrix(traced: TracedMechanism, q: Array) -> Array:
    """The mass matrix (nv, nv) at t = 0, a column for each speed: M e = ∂/∂u (∂T/∂u) e.

    For a hundred joints that takes a tenth of the time of an expression of all its entries.
    """
    u, direction = traced.state.u, ca.SX.sym("e", traced.layout.nv)
    column = ca.jtimes(traced.momenta, u, direction)
    column = ca.substitute(column, u, ca.SX.zeros(u.shape[0], 1))  # which are left in terms that cancel
    symbols = [traced.state.t, traced.state.q, direction, traced.parameters.symbols]
    function = ca.Function("column", symbols, [ca.densify(column)])
    directions = np.eye(traced.layout.nv)
    return np.column_stack([evaluated(function, 0.0, q, each, traced.parameters.base).ravel() for each in directions])
