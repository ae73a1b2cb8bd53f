"""The expressions of the equations of motion as functions: those that kernels are compiled from, and joint loads.

One of them projects a state onto unit quaternions and onto the constraints. The loads of joints are traced when they
are first read.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.accelerations import AppliedForces, ConstrainedMotion, coupling_forces, drive_table
from mbd_sim.dynamics.constraints.start import Assembly
from mbd_sim.dynamics.kinematics.links import Link
from mbd_sim.dynamics.kinematics.poses import SymbolicPose, normalized_quaternions
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.math.spatial import constant, inlined, merged_function
from mbd_sim.dynamics.recursion.multipliers import ConstraintSolver
from mbd_sim.dynamics.recursion.reactions import joint_reactions, joint_springs, wrenches_of_multipliers
from mbd_sim.mechanism.mechanism import Mechanism

if TYPE_CHECKING:
    from mbd_sim.dynamics.contact.compliant import ComplianceFunctions


def projected_state(traced: TracedMechanism, solver: ConstraintSolver | None) -> ca.SX | None:
    """The state y after projection: first the coordinates, then the speeds at the new position.

    Returns None where there are neither quaternions nor constraints.
    """
    state = traced.state
    q, u = state.q, state.u
    if solver is not None:
        displacement, u_change = solver.corrections(state)
        q, u = q + ca.jacobian(state.q_rates, state.u) @ displacement, u + u_change
    projected = ca.vertcat(normalized_quaternions(traced.links, q), u, traced.actuator_states, traced.audit)
    return None if ca.is_equal(projected, traced.y) else projected


@dataclass(frozen=True, eq=False)
class KernelFunctions:
    """Functions of (t, y, inputs) or (t, y), as in `Equations`, and the expressions (m,) of all `multipliers`."""

    rates: ca.Function
    energies: ca.Function
    poses: ca.Function
    drives: ca.Function
    project: ca.Function | None
    violation: ca.Function
    multipliers: ca.SX
    trace_multipliers: Callable[[], ca.Function]
    compliances: ComplianceFunctions | None


def with_inputs(traced: TracedMechanism) -> list[ca.SX]:
    """The arguments of functions that depend on commands."""
    return [traced.state.t, traced.y, traced.inputs]


def without_commands(traced: TracedMechanism) -> list[ca.SX]:
    """The arguments of functions that depend on no command: the inputs are among them if they contain parameters."""
    return with_inputs(traced) if len(traced.parameters.base) else [traced.state.t, traced.y]


def kernel_functions(
    traced: TracedMechanism,
    assembly: Assembly,
    forces: AppliedForces,
    solver: ConstraintSolver | None,
    motion: ConstrainedMotion,
    y_rates: ca.SX,
) -> KernelFunctions:
    """The functions of a traced mechanism.

    :param y_rates: y' with everything open; `motion` has the multipliers and the forces of drives.
    """
    commanded, plain, constraints = with_inputs(traced), without_commands(traced), assembly.equations
    two_sided = len(assembly.start.active)
    potential = forces.joints.potential + forces.elements.potential
    potential += gravitational_potential(traced.mechanism, traced.links, traced.poses)
    multipliers = ca.SX(len(constraints.rows), 1)
    multipliers[list(assembly.start.active)] = motion.multipliers[:two_sided, :]
    margin = [] if solver is None or solver.margin is None else [ca.densify(solver.margin)]
    projected = projected_state(traced, solver)
    violation = ca.horzcat(constraints.position, constraints.velocity)
    return KernelFunctions(
        rates=merged_function("rates", commanded, y_rates, *margin),
        energies=merged_function("energies", plain, ca.vertcat(traced.kinetic_energy, potential)),
        poses=merged_function("poses", plain, traced.flat_poses[: 12 * len(traced.part_names)]),
        drives=merged_function("drives", commanded, ca.vec(motion.drives)),
        # "settle" is the function's name in compiled kernels, and so part of their keys in the cache.
        project=None if projected is None else merged_function("settle", plain, projected),
        violation=merged_function("violation", plain, violation),
        multipliers=multipliers,
        trace_multipliers=partial(merged_function, "multipliers", commanded, multipliers),
        compliances=_compliances(commanded, forces),
    )


def _compliances(inputs: list[ca.SX], forces: AppliedForces) -> ComplianceFunctions | None:
    if not forces.elements.compliances:
        return None
    from mbd_sim.dynamics.contact.compliant import compliance_functions

    return compliance_functions(inputs, forces.elements.compliances)


def gravitational_potential(mechanism: Mechanism, links: Sequence[Link], poses: Sequence[SymbolicPose]) -> ca.SX:
    """-Σ m g·r over the centers of mass in J, which is zero with all of them at ground's origin."""
    potential, gravity, bodies = ca.SX(1, 1), constant(mechanism.gravity), mechanism.bodies
    for link, X_WB in zip(links, poses, strict=True):
        part = bodies[link.joint.outboard]
        potential -= _work(ca.SX(part.mass), gravity, X_WB.position, X_WB.rotation, constant(part.center))
    return potential


@inlined
def _work(mass: ca.SX, gravity: ca.SX, position: ca.SX, rotation: ca.SX, center: ca.SX) -> ca.SX:
    """The work of gravity on a part in J, from ground's origin to the part's center of mass."""
    return mass * ca.dot(gravity, position + rotation @ center)


def reactions_at(traced: TracedMechanism, assembly: Assembly, motion: ConstrainedMotion, multipliers: ca.SX) -> ca.SX:
    """The wrenches (6, joints) across the joints, see `joint_reactions`, with the springs of all joints."""
    return joint_reactions(traced, motion.transmitted(), assembly.equations, multipliers) + joint_springs(traced)


def reaction_function(
    traced: TracedMechanism, assembly: Assembly, motion: ConstrainedMotion, multipliers: ca.SX
) -> ca.Function:
    """(t, y, inputs) -> the wrenches across the joints."""
    wrenches = reactions_at(traced, assembly, motion, multipliers)
    inputs = [traced.state.t, traced.y, traced.inputs]
    return ca.Function("reactions", inputs, [ca.densify(wrenches)], {"cse": True})


@dataclass(frozen=True, slots=True)
class Loads:
    """Loads of a state, and their derivatives by the multipliers λ (m,) at fixed u'.

    `reactions` (6 joints,) joint by joint and `multipliers` (m,) are those that the equations of motion give;
    `of_reactions` (6 joints, m) and `of_drives` (n, m) are the derivatives of the reactions and of the drives' forces;
    `gradient` (m, nv) is G.
    """

    reactions: Array
    multipliers: Array
    of_reactions: Array
    of_drives: Array
    gradient: Array


@dataclass(frozen=True, eq=False)
class LoadPaths:
    """How multipliers become loads.

    `function(t, y, inputs)` is one vector of all `Loads`, matrices column by column, so that it is compiled as one
    function; `loads` takes it apart. `idle` are the rows of constraints whose gradient is zero in all states and for
    all parameters, by the structure of the expressions, as those across the plane of a plane linkage. `idle_unloaded`
    says that, likewise, their multipliers are zero, and that each component of a reaction that they affect is zero.
    """

    function: ca.Function
    shapes: Sequence[tuple[int, int]]
    idle: Sequence[int]
    idle_unloaded: bool

    def values(self, t: float, y: Array, inputs: Array) -> Array:
        """The output (size,) of the function, evaluated by CasADi."""
        return np.array(self.function(t, y, inputs), dtype=float).ravel()

    def loads(self, values: Array) -> Loads:
        """The loads (views) in the output (size,) of the function."""
        first, found = 0, []
        for rows, columns in self.shapes:
            found.append(values[first : first + rows * columns].reshape(columns, rows).T)
            first += rows * columns
        reactions, multipliers, *matrices = found
        return Loads(reactions[:, 0], multipliers[:, 0], *matrices)


def load_paths(traced: TracedMechanism, assembly: Assembly, motion: ConstrainedMotion, multipliers: ca.SX) -> LoadPaths:
    """See `LoadPaths`."""
    constraints = assembly.equations
    units = ca.SX.sym("multipliers", len(constraints.rows))
    transmitted = wrenches_of_multipliers(traced, constraints, units)
    by_units = ca.vec(joint_reactions(traced, transmitted, constraints, units))
    drives = drive_table(traced, lambda: transmitted, coupling_forces(constraints, units))[:, 2]
    reactions = ca.sparsify(ca.vec(reactions_at(traced, assembly, motion, multipliers)))
    of_reactions, gradient = ca.sparsify(ca.jacobian(by_units, units)), ca.sparsify(constraints.gradient)
    outputs = [reactions, ca.sparsify(multipliers), of_reactions, ca.jacobian(drives, units), gradient]
    idle = [row for row in range(gradient.size1()) if not gradient[row, :].nnz()]
    of_idle = of_reactions[:, idle].T @ reactions
    function = ca.Function(
        "load_paths",
        [traced.state.t, traced.y, traced.inputs],
        [ca.densify(ca.vertcat(*(ca.vec(output) for output in outputs)))],
        {"cse": True},
    )
    return LoadPaths(
        function,
        shapes=[output.shape for output in outputs],
        idle=idle,
        idle_unloaded=not of_idle.nnz() and not outputs[1][idle].nnz(),
    )
