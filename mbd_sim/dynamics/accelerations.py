"""The accelerations of a mechanism under all forces, with the multipliers, and the energies that they transfer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import casadi as ca

from mbd_sim.dynamics.constraints.equations import ConstraintEquations
from mbd_sim.dynamics.forces.elements import ElementForces, element_forces
from mbd_sim.dynamics.forces.joints import JointForces, coordinate_forces, joint_forces
from mbd_sim.dynamics.kinematics.drives import driven_motion
from mbd_sim.dynamics.kinematics.state_variables import StateVariables
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.kinematics.wrenches import external_wrenches
from mbd_sim.dynamics.recursion.articulated_body import Accelerations, FactorizedMassMatrix
from mbd_sim.dynamics.recursion.multipliers import ConstraintSolver
from mbd_sim.dynamics.recursion.reactions import transmitted_wrenches

if TYPE_CHECKING:
    from mbd_sim.dynamics.actuators.forces import ActuatorForces


@dataclass(frozen=True, eq=False)
class AppliedForces:
    """All forces except gravity and the constraint forces; those of joints and elements include the actuators'."""

    joints: JointForces
    elements: ElementForces
    actuators: ActuatorForces | None

    @property
    def actuator_rates(self) -> ca.SX:
        """The derivatives of the states of the actuators."""
        return ca.SX(0, 1) if self.actuators is None else self.actuators.rates


@dataclass(frozen=True, eq=False)
class ConstrainedMotion:
    """The accelerations of a mechanism and the forces that belong to them.

    `multipliers` (m,) are λ of the active constraints. `u_rates` (nv,) are u'. `transmitted()` are the wrenches
    F_L (6,) on each link through its joint, traced when they are first needed. `drives` (n, 3) are described in
    `drive_table`. `links` are the spatial accelerations (6,) of the links less that of gravity, see `Accelerations`.
    """

    multipliers: ca.SX
    accelerations: Accelerations
    transmitted: Callable[[], Sequence[ca.SX]]
    drives: ca.SX

    @property
    def u_rates(self) -> ca.SX:
        """The derivatives of the speeds."""
        return self.accelerations.u_rates

    @property
    def links(self) -> Sequence[ca.SX]:
        """The accelerations of the links."""
        return self.accelerations.links


def applied_forces(traced: TracedMechanism) -> AppliedForces:
    """The forces of joints, force elements, actuators and external wrenches."""
    state, external = traced.state, external_wrenches(traced.input_layout, traced.inputs)
    mechanism, links = traced.mechanism, traced.links
    variables = StateVariables(links, state.t, state.q, state.u)
    along = coordinate_forces(mechanism, variables, state.q, state.q_rates, state.u)
    joints = joint_forces(links, state.q, state.u, traced.efforts, variables, along)
    elements = element_forces(mechanism, links, traced.motions, traced.poses, variables, external)
    if not mechanism.actuators:
        return AppliedForces(joints, elements, None)
    # What few mechanisms need is imported only for these.
    from mbd_sim.dynamics.actuators.forces import actuator_forces, with_actuators

    actuators = actuator_forces(traced)
    return AppliedForces(*with_actuators(traced, joints, elements, actuators), actuators)


def solve_accelerations(
    traced: TracedMechanism,
    mass_matrix: FactorizedMassMatrix,
    constraints: ConstraintEquations,
    solver: ConstraintSolver | None,
    forces: AppliedForces,
) -> ConstrainedMotion:
    """Solve M u' + h = Q + Gᵀ λ with G u' = -γ.

    :param constraints: the active rows.
    :param solver: None where there are no constraints.
    """
    wrenches, gravity = forces.elements.wrenches, traced.mechanism.gravity
    if solver is None:
        multipliers = ca.SX(0, 1)
        motion = mass_matrix.accelerations(forces.joints.generalized, wrenches, gravity)
    else:
        applied, bias_accelerations = mass_matrix.applied(forces.joints.generalized, wrenches, gravity)
        multipliers = solver.multipliers(applied)
        at_rest = Accelerations(ca.SX(traced.layout.nv, 1), lambda: bias_accelerations)
        motion = solver.accelerations(applied, multipliers) + at_rest
        wrenches = [own + unit @ multipliers for own, unit in zip(wrenches, constraints.wrenches, strict=True)]
    transmitted = cache(lambda: transmitted_wrenches(traced.links, traced.motions, motion.links, wrenches))
    drives = drive_table(traced, transmitted, coupling_forces(constraints, multipliers, forces))
    return ConstrainedMotion(multipliers, motion, transmitted, drives)


def coupling_forces(
    constraints: ConstraintEquations, multipliers: ca.SX, forces: AppliedForces | None = None
) -> dict[str, ca.SX]:
    """The forces that constraints of coordinates, and forces of the file, exert on driven coordinates, by name."""
    found = {name: ca.dot(factors, multipliers) for name, factors in constraints.driven_factors.items()}
    for name, force in forces.joints.on_driven.items() if forces is not None else ():
        found[name] = found.get(name, ca.SX(1, 1)) + force
    return found


def drive_table(
    traced: TracedMechanism, transmitted: Callable[[], Sequence[ca.SX]], coupling: Mapping[str, ca.SX]
) -> ca.SX:
    """The coordinates, speeds and forces of the driven coordinates (n, 3), in declared order and SI units.

    :param transmitted: gives F_L (6,) on each link through its joint; not called without driven coordinates.
    :param coupling: the forces that constraints of coordinates exert on driven ones, by name.
    """
    if all(motion.joint.prescribed is None for motion in traced.motions):
        return ca.SX(0, 3)
    driven = {}
    for link, motion, wrench in zip(traced.links, traced.motions, transmitted(), strict=True):
        if (prescribed := motion.joint.prescribed) is not None:
            given = ca.vertcat(*(coupling.get(name, ca.SX(1, 1)) for name in link.joint.motion_names))
            force = prescribed.partial_velocities.T @ wrench - given
            coordinates = driven_motion(link, traced.state.t, traced.state.q)[0]
            driven[link.joint.name] = ca.horzcat(coordinates, prescribed.speeds, force)
    return ca.vertcat(ca.SX(0, 3), *(driven[name] for name in traced.mechanism.joints if name in driven))


def audit_rates(constraints: ConstraintEquations, forces: AppliedForces, motion: ConstrainedMotion) -> ca.SX:
    """The powers in W whose integrals are the audit's energies, in the order of `AUDIT_STATES`."""
    return ca.vertcat(
        forces.joints.applied_power + forces.elements.applied_power,
        ca.dot(motion.drives[:, 1], motion.drives[:, 2]) - ca.dot(constraints.own_rate, motion.multipliers),
        forces.joints.dissipated_power + forces.elements.dissipated_power,
    )
