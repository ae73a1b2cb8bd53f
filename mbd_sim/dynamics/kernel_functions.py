"""The expressions of the equations of motion as the functions that kernels are compiled from.

One of them projects a state onto unit quaternions and onto the constraints.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import casadi as ca

from mbd_sim.dynamics.accelerations import AppliedForces, ConstrainedMotion
from mbd_sim.dynamics.constraints.start import Assembly
from mbd_sim.dynamics.kinematics.links import Link
from mbd_sim.dynamics.kinematics.poses import SymbolicPose, normalized_quaternions
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.math.spatial import constant, inlined, merged_function
from mbd_sim.dynamics.recursion.multipliers import ConstraintSolver
from mbd_sim.mechanism.mechanism import Mechanism

if TYPE_CHECKING:
    from mbd_sim.dynamics.contact.compliant import CushionFunctions


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
    cushions: CushionFunctions | None


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
        cushions=_cushions(commanded, forces),
    )


def _cushions(inputs: list[ca.SX], forces: AppliedForces) -> CushionFunctions | None:
    if not forces.elements.cushions:
        return None
    from mbd_sim.dynamics.contact.compliant import cushion_functions

    return cushion_functions(inputs, forces.elements.cushions)


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
