"""The terms of M u' + c + g = Q + Gᵀ λ, as functions that are traced on request.

c and g are the generalized forces of inertia and of gravity at u' = 0, by the recursive Newton–Euler algorithm
(Featherstone 2008, sec. 5.3). Q are those of everything else but constraints and contacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, assert_never

import casadi as ca

from mbd_sim.dynamics.accelerations import applied_forces
from mbd_sim.dynamics.constraints.equations import ConstraintEquations
from mbd_sim.dynamics.forces.elements import element_forces
from mbd_sim.dynamics.forces.joints import coordinate_forces, joint_forces
from mbd_sim.dynamics.kinematics.state_variables import StateVariables
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.kinematics.wrenches import external_wrenches
from mbd_sim.dynamics.math.spatial import constant, symmetric
from mbd_sim.dynamics.recursion.articulated_body import bias_acceleration
from mbd_sim.dynamics.recursion.reactions import transmitted_wrenches

DynamicsTerm = Literal[
    "mass_matrix",
    "coriolis",
    "gravity",
    "bias",
    "generalized_forces",
    "constraint_jacobian",
    "constraint_bias",
    "tree_efforts",
]


def term_function(traced: TracedMechanism, constraints: ConstraintEquations, term: DynamicsTerm) -> ca.Function:
    """(t, y, inputs, u') -> a term; only `tree_efforts` depends on u' (nv,). Matrices are row by row.

    - `mass_matrix`: M (nv, nv), with the reflected inertia of rotors.
    - `coriolis` c, `gravity` g, and their sum `bias`: (nv,). c includes the inertia forces due to drives.
    - `generalized_forces`: Q (nv,), with efforts and actuators.
    - `constraint_jacobian` G (m, nv) and `constraint_bias` γ (m,): G u' + γ = 0, for all rows.
    - `tree_efforts`: see `tree_efforts`.
    """
    u_rates, zero = ca.SX.sym("u'", traced.layout.nv), ca.SX(traced.layout.nv, 1)
    match term:
        case "mass_matrix":
            output = mass_matrix(traced)
        case "bias":
            output = _inertia_forces(traced, zero, weight(traced))
        case "coriolis":
            output = _inertia_forces(traced, zero, ca.SX(6, 1))
        case "gravity":
            output = _inertia_forces(traced, zero, weight(traced)) - _inertia_forces(traced, zero, ca.SX(6, 1))
        case "generalized_forces":
            forces = applied_forces(traced)
            output = forces.joints.generalized - along_joints(traced, [-one for one in forces.elements.wrenches])
        case "constraint_jacobian":
            output = constraints.gradient.T
        case "constraint_bias":
            output = constraints.bias
        case "tree_efforts":
            output = tree_efforts(traced, u_rates)
        case _:
            assert_never(term)
    inputs = [traced.state.t, traced.y, traced.inputs, u_rates]
    return ca.Function(term, inputs, [ca.densify(output)], {"cse": True})


def mass_matrix(traced: TracedMechanism) -> ca.SX:
    """M (nv, nv) by the composite-rigid-body algorithm (Featherstone 2008, sec. 6.2)."""
    links, motions, matrix = traced.links, traced.motions, ca.SX(traced.layout.nv, traced.layout.nv)
    inertias = [constant(link.inertia) for link in links]
    for index in reversed(range(len(links))):
        link, transform = links[index], motions[index].transform
        force = ca.sparsify(inertias[index] @ motions[index].joint.partial_velocities)
        matrix[link.u, link.u] = motions[index].joint.partial_velocities.T @ force
        if link.parent >= 0:
            inertias[link.parent] += symmetric(transform.T @ inertias[index] @ transform)
        carrier = index
        while (parent := links[carrier].parent) >= 0:
            force = ca.sparsify(motions[carrier].transform.T @ force)
            coupling = motions[parent].joint.partial_velocities.T @ force
            matrix[links[parent].u, link.u], matrix[link.u, links[parent].u] = coupling, coupling.T
            carrier = parent
    return matrix if traced.rotor_inertia is None else matrix + ca.diag(traced.rotor_inertia)


def tree_efforts(traced: TracedMechanism, u_rates: ca.SX) -> ca.SX:
    """The efforts (nv,) of the spanning tree with its loops open, for accelerations u' (nv,).

    They are those that actuators and commanded efforts exert together: the efforts among the inputs have no effect.
    """
    chain, state = traced.links, traced.state
    external = external_wrenches(traced.input_layout, traced.inputs)
    variables = StateVariables(chain, state.t, state.q, state.u)
    elements = element_forces(traced.mechanism, chain, traced.motions, traced.poses, variables, external)
    along = coordinate_forces(traced.mechanism, variables, state.q, state.q_rates, state.u)
    joints = joint_forces(chain, state.q, state.u, ca.SX(traced.layout.nv, 1), variables, along)
    accelerations = link_accelerations(traced, u_rates, weight(traced))
    wrenches = transmitted_wrenches(chain, traced.motions, accelerations, elements.wrenches)
    rotors = ca.SX(traced.layout.nv, 1) if traced.rotor_inertia is None else traced.rotor_inertia
    return rotors * u_rates - joints.generalized + _projected(traced, wrenches)


def along_joints(traced: TracedMechanism, wrenches: Sequence[ca.SX]) -> ca.SX:
    """The generalized forces (nv,) of wrenches F_L (6,) on the links."""
    carried = list(wrenches)
    for index in reversed(range(len(traced.links))):
        if (parent := traced.links[index].parent) >= 0:
            carried[parent] = ca.sparsify(carried[parent] + traced.motions[index].transform.T @ carried[index])
    return _projected(traced, carried)


def _inertia_forces(traced: TracedMechanism, u_rates: ca.SX, base: ca.SX) -> ca.SX:
    accelerations = link_accelerations(traced, u_rates, base)
    nothing = [ca.SX(6, 1)] * len(traced.links)
    return _projected(traced, transmitted_wrenches(traced.links, traced.motions, accelerations, nothing))


def link_accelerations(traced: TracedMechanism, u_rates: ca.SX, base: ca.SX) -> list[ca.SX]:
    """The spatial acceleration (6,) of each link in L, less that of gravity, with that of ground as `base`."""
    accelerations: list[ca.SX] = []
    for link, motion in zip(traced.links, traced.motions, strict=True):
        inboard = accelerations[link.parent] if link.parent >= 0 else base
        carried = motion.transform @ inboard + bias_acceleration(motion)
        accelerations.append(ca.sparsify(carried + motion.joint.partial_velocities @ u_rates[link.u, :]))
    return accelerations


def weight(traced: TracedMechanism) -> ca.SX:
    """The spatial acceleration (6,) of ground that stands for gravity."""
    return ca.sparsify(ca.vertcat(ca.SX(3, 1), -constant(traced.mechanism.gravity)))


def _projected(traced: TracedMechanism, wrenches: Sequence[ca.SX]) -> ca.SX:
    """The components (nv,) along the joints of the wrench F_L (6,) through each of them."""
    found = ca.SX(traced.layout.nv, 1)
    for link, motion, wrench in zip(traced.links, traced.motions, wrenches, strict=True):
        found[link.u, :] = motion.joint.partial_velocities.T @ wrench
    return found
