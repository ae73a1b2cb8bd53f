"""The part of the linearized equations that comes from the forces within joints: springs, stops, dampers and friction.

These forces are stiff where a joint moves little inertia. They suffice for a Rosenbrock-W method, which keeps its order
with any approximation A of the Jacobian (Hairer & Wanner II, sec. IV.7). With the slopes D and K of the joint forces in
the speeds and coordinates, both diagonal, the linear system (I - g A) U = r becomes

    (M + g D + g² K) U_u + Gᵀ μ = M r_u - g K r_q,    U_q = r_q + g N U_u,

which the articulated-body recursion solves in O(n): D and K are added to the pivots of the joints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.dynamics.accelerations import AppliedForces
from mbd_sim.dynamics.constraints.equations import ConstraintEquations
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.math.spatial import merged_function, separated
from mbd_sim.dynamics.recursion.articulated_body import FactorizedMassMatrix
from mbd_sim.dynamics.recursion.multipliers import ConstraintSolver, TypicalMatrices


@dataclass(frozen=True, eq=False)
class JointLinearization:
    """The functions of that linear system, traced when they are first read.

    `constraints` are the active rows; `typical` and `dependent` as in `ConstraintSolver`.
    """

    traced: TracedMechanism
    mass_matrix: FactorizedMassMatrix
    constraints: ConstraintEquations
    typical: TypicalMatrices
    dependent: NDArray[np.bool_]
    forces: AppliedForces

    @cached_property
    def slopes(self) -> ca.Function:
        """(t, y, inputs) -> D (nv,) and K (nv, nq)."""
        traced, (damping, stiffness) = self.traced, self._slopes
        q = ca.SX.sym("right", traced.layout.nq)
        displaced = stiffness * _own_coordinates(traced, q)
        given = [traced.state.t, traced.y, traced.inputs]
        outputs = [ca.densify(damping), ca.jacobian(displaced, q)]
        return ca.Function("joint_slopes", given, outputs, {"cse": True})

    @cached_property
    def partial_system(self) -> tuple[ca.Function, ca.Function]:
        """`at(t, y, inputs, g)`, which gives the memory (m,) of `solve(memory, r)`, which gives U."""
        return _partial_system(self, *self._slopes)

    @cached_property
    def _slopes(self) -> tuple[ca.SX, ca.SX]:
        return _slopes(self.traced, self.forces)


def _partial_system(system: JointLinearization, damping: ca.SX, stiffness: ca.SX) -> tuple[ca.Function, ca.Function]:
    traced, constraints, forces = system.traced, system.constraints, system.forces
    state, nq, nv = traced.state, traced.layout.nq, traced.layout.nv
    g, right = ca.SX.sym("g"), ca.SX.sym("right", traced.y.shape[0])
    right_q, right_u, right_w = ca.vertsplit(right, [0, nq, nq + nv, right.shape[0]])
    added = g * (damping + g * stiffness)
    if traced.rotor_inertia is not None:
        added += traced.rotor_inertia
    displaced = stiffness * _own_coordinates(traced, right_q)
    mass_matrix = system.mass_matrix.with_added(added)
    if constraints.rows:
        # r already satisfies the constraints, so only its change does not: M a + Gᵀ λ = (D + g K) U_u + K r_q, G a = 0.
        unbiased = replace(constraints, bias=ca.SX(len(constraints.rows), 1))
        solver = ConstraintSolver(mass_matrix, unbiased, system.typical, system.dependent)
        applied = mass_matrix.net_joint_forces((damping + g * stiffness) * right_u + displaced)
        solution = right_u - g * solver.accelerations(applied, solver.multipliers(applied)).u_rates
    else:
        # The same without the difference of two large numbers, where g D is much larger than M.
        momentum = ca.jtimes(traced.momenta, state.u, right_u)
        solution = mass_matrix.solve(mass_matrix.net_joint_forces(momentum - g * displaced)).u_rates
    before = right_q + g * ca.jtimes(state.q_rates, state.u, solution)
    dissipated = g * ca.jtimes(forces.joints.dissipated_power, state.u, solution)
    full = ca.densify(ca.vertcat(before, solution, right_w[:-1], right_w[-1] + dissipated))
    given = [state.t, traced.y, traced.inputs, g]
    memory, values, reduced = separated(full, ca.vertcat(*given), right)
    at = merged_function("linearize_joints", given, values)
    return at, merged_function("solve_joints", [memory, right], reduced)


def _slopes(traced: TracedMechanism, forces: AppliedForces) -> tuple[ca.SX, ca.SX]:
    """-∂Q/∂u and -∂Q/∂q (nv,) of the joint forces in their own coordinates; never negative.

    Of forces that vary with other coordinates as well, these derivatives are left out. The slopes are zero for free
    joints, which the recursion does not eliminate.
    """
    state, varying = traced.state, forces.joints.varying
    found = []
    for symbol in (state.u, state.q):
        slope = -ca.jtimes(forces.joints.own, symbol, ca.SX.ones(symbol.shape[0], 1))
        slope -= _own_slopes(traced, varying, symbol)
        for link in traced.links:
            if link.joint.type == "free":
                slope[link.u] = 0.0
        found.append(ca.fmax(ca.sparsify(slope), 0.0))
    return found[0], found[1]


def _own_slopes(traced: TracedMechanism, varying: ca.SX, symbol: ca.SX) -> ca.SX:
    """The derivative (nv,) of each of the forces in the entry of q or u that belongs to its coordinate."""
    slopes = ca.SX(traced.layout.nv, 1)
    for link in traced.links:
        if link.joint.kind.quaternion is None:
            entries = link.q if symbol is traced.state.q else link.u
            for row, entry in zip(range(link.u.start, link.u.stop), range(entries.start, entries.stop), strict=True):
                if varying[row].nnz():
                    slopes[row] = ca.jacobian(varying[row], symbol[entry])
    return ca.sparsify(slopes)


def _own_coordinates(traced: TracedMechanism, q: ca.SX) -> ca.SX:
    """The entry of q (nq,) that belongs to each speed (nv,); zero for joints with quaternions, which lack springs."""
    found = ca.SX(traced.layout.nv, 1)
    for link in traced.links:
        if link.joint.kind.quaternion is None:
            for offset, row in enumerate(range(link.u.start, link.u.stop)):
                found[row] = q[link.q.start + offset]
    return found
