"""Accelerations of an open chain by the articulated-body recursion, O(n) (Featherstone, sec. 7.3).

The recursion factorizes the mass matrix once for each position. `FactorizedMassMatrix.solve` then solves with it for
any generalized forces, at a cost proportional to the number of links between them and ground.

The accelerations of the recursion are [ω'; p''] with the accelerations p'' of the links' origins. Those are spatial
accelerations plus [0; ω × v], and so they depend on the angular velocities only. The inertias are the regrouped ones of
`lumped_inertias`.

A matrix (6, 6) that transforms motion vectors has blocks that are products of a rotation and a translation. Here both
are applied one after the other, and inertias are rotated about a coordinate axis without forming products of matrices:
of their blocks (2, 2) across the axis, only the deviatoric parts change (Featherstone, sec. A.4 and table A.1). Motion
vectors are (angular, linear) and wrenches (moment, force), in SI units.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.kinematics.links import Link
from mbd_sim.dynamics.kinematics.poses import LinkMotion, carried_outward
from mbd_sim.dynamics.math.spatial import constant, inlined, motion_cross, skew, sparse, symmetric, zeros
from mbd_sim.dynamics.recursion.eliminated_joints import EliminatedJoint, eliminated
from mbd_sim.dynamics.recursion.lumped_inertias import lumped_inertias


def inboard_force(motion: LinkMotion, forces: ca.SX) -> ca.SX:
    """Wrenches F_L (6, k) on a link as wrenches about the inboard link's origin, in its axes."""
    return _rotated_and_moved(motion.R_PL, motion.cross, forces)


def outboard_motion(motion: LinkMotion, vector: ca.SX, added: ca.SX | None = None) -> ca.SX:
    """A motion vector (6,) of the inboard link as one about the link's origin, in its axes, and what is added there."""
    return carried_outward(motion.R_PL, motion.cross, vector, zeros(6) if added is None else added)


def inboard_inertia(link: Link, motion: LinkMotion, inertia: ca.SX) -> ca.SX:
    """A symmetric inertia (6, 6) of a link as one about the inboard link's origin, in its axes."""
    if (turn := motion.joint.turn) is not None:
        R = constant(link.X_PF.rotation)
        return _TURNED_AND_CARRIED[turn.axis](turn.sine, turn.cosine, R, motion.cross, inertia)
    return _carried(motion.R_PL, motion.cross, inertia)


# In these functions p (3, 3) multiplies a vector by a displacement. It is an argument, rather than the displacement,
# because functions that are inlined must not change signs of their arguments.


@inlined
def _rotated_and_moved(R: ca.SX, p: ca.SX, forces: ca.SX) -> ca.SX:
    force = R @ forces[3:, :]
    return ca.vertcat(R @ forces[:3, :] + p @ force, force)


@inlined
def _carried(R: ca.SX, p: ca.SX, inertia: ca.SX) -> ca.SX:
    return _inboard(R, p, ca.horzcat(inertia[:3, :], inertia[3:, 3:]))


def _turned_and_carried(axis: int, s: ca.SX, c: ca.SX, R: ca.SX, p: ca.SX, inertia: ca.SX) -> ca.SX:
    return _inboard(R, p, _turned(axis, s, c, ca.horzcat(inertia[:3, :], inertia[3:, 3:])))


def _inboard(R: ca.SX, p: ca.SX, blocks: ca.SX) -> ca.SX:
    """The inertia (6, 6) from its rotational, coupling and translational blocks (3, 9) in the link's axes."""
    rotational, coupling, translational = (R @ block @ R.T for block in ca.horzsplit(blocks, 3))
    rotational, translational = symmetric(rotational), symmetric(translational)
    shifted = coupling + p @ translational
    moved = symmetric(rotational + (p @ coupling.T + (p @ shifted.T).T))
    return ca.vertcat(ca.horzcat(moved, shifted), ca.horzcat(shifted.T, translational))


def _turned(axis: int, s: ca.SX, c: ca.SX, blocks: ca.SX) -> ca.SX:
    """R B Rᵀ of blocks B (3, 3), for a rotation R about a coordinate axis by an angle with a sine and a cosine."""
    return ca.horzcat(*(_turned_block(axis, s, c, block) for block in ca.horzsplit(blocks, 3)))


def _turned_block(axis: int, s: ca.SX, c: ca.SX, block: ca.SX) -> ca.SX:
    k, i, j = axis, (axis + 1) % 3, (axis + 2) % 3
    result = ca.SX(3, 3)
    result[k, k] = block[k, k]
    result[i, k], result[j, k] = c * block[i, k] - s * block[j, k], s * block[i, k] + c * block[j, k]
    result[k, i], result[k, j] = c * block[k, i] - s * block[k, j], s * block[k, i] + c * block[k, j]
    deviation = sparse(s * (block[i, i] - block[j, j]) + c * (block[i, j] + block[j, i]))
    result[i, i], result[j, j] = block[i, i] - s * deviation, block[j, j] + s * deviation
    result[i, j], result[j, i] = c * deviation - block[j, i], c * deviation - block[i, j]
    return result


_TURNED_AND_CARRIED = [inlined(partial(_turned_and_carried, axis)) for axis in range(3)]


@dataclass(frozen=True, eq=False)
class Accelerations:
    """`u_rates` (nv,) = u', and the spatial acceleration (6,) of each of the `links` less that of gravity.

    The spatial accelerations are expressed in the link's frame L at its origin. They are traced when they are first
    read: few mechanisms need them for their motion.
    """

    u_rates: ca.SX
    trace_links: Callable[[], list[ca.SX]]

    @cached_property
    def links(self) -> list[ca.SX]:
        """The accelerations of the links."""
        return self.trace_links()

    def __add__(self, other: Accelerations) -> Accelerations:
        def links() -> list[ca.SX]:
            return [sparse(one + more) for one, more in zip(self.links, other.links, strict=True)]

        return Accelerations(self.u_rates + other.u_rates, links)


class FactorizedMassMatrix:
    """The mass matrix M (nv, nv) of a chain, factorized joint by joint.

    `pivots` (nv,) are positive where M is definite.
    """

    def __init__(
        self,
        links: Sequence[Link],
        motions: Sequence[LinkMotion],
        nv: int,
        added: ca.SX | None = None,
        inertias: Sequence[ca.SX] | None = None,
    ) -> None:
        """Factorize M, or M + diag(`added`) with `added` (nv,).

        :param inertias: the `lumped_inertias` of the links, if they are known.
        """
        self._links, self._motions, self._nv = links, motions, nv
        self._inertias = lumped_inertias(links) if inertias is None else inertias
        inertias = list(self._inertias)
        self._joints: dict[int, EliminatedJoint] = {}
        self.pivots = ca.SX(nv, 1)
        for index in reversed(range(len(links))):
            link, motion = links[index], motions[index]
            joint = eliminated(motion.joint, inertias[index], None if added is None else added[link.u])
            self._joints[index] = joint
            self.pivots[link.u] = joint.pivots
            if link.parent >= 0 and joint.projected_inertia.nnz():
                inertias[link.parent] += inboard_inertia(link, motion, joint.projected_inertia)

    @cached_property
    def _squares(self) -> list[ca.SX]:
        return [_square(motion.V_WL[:3]) for motion in self._motions]

    def with_added(self, added: ca.SX) -> FactorizedMassMatrix:
        """The factors of M + diag(`added`) with `added` (nv,) in place of what was added before."""
        return FactorizedMassMatrix(self._links, self._motions, self._nv, added, self._inertias)

    def accelerations(self, forces: ca.SX, wrenches: Sequence[ca.SX], gravity: Array | ca.SX) -> Accelerations:
        """The accelerations under all forces.

        :param forces: (nv,) generalized forces in N or N·m.
        :param wrenches: F_L (6,) = [moment; force] on each link.
        :param gravity: (3,) in m/s², in ground's frame.
        """
        biases = [sparse(bias - wrench) for bias, wrench in zip(self._bias_forces(), wrenches, strict=True)]
        bias_accelerations = self._bias_accelerations()
        net_forces = self._inward(forces, biases, bias_accelerations)
        motion = self._outward(net_forces, bias_accelerations, -gravity)
        return Accelerations(motion.u_rates, lambda: self._spatial(motion.links))

    def applied(
        self, forces: ca.SX, wrenches: Sequence[ca.SX], gravity: Array | ca.SX
    ) -> tuple[list[ca.SX], list[ca.SX]]:
        """The net joint forces (., 1) of all applied forces, and the links' accelerations (6,) at u' = 0.

        The accelerations are less that of gravity. Added to the result of `solve` for the net forces, they equal the
        result of `accelerations`. If constraint forces are added first, this saves one pass outward and inward.
        """
        accelerations: list[ca.SX] = []
        base = _base_acceleration(-gravity)
        for link, motion, bias in zip(self._links, self._motions, self._bias_accelerations(), strict=True):
            inboard = accelerations[link.parent] if link.parent >= 0 else base
            accelerations.append(outboard_motion(motion, inboard, bias))
        biases = [
            sparse(inertia @ acceleration + bias - wrench)
            for inertia, acceleration, bias, wrench in zip(
                self._inertias, accelerations, self._bias_forces(), wrenches, strict=True
            )
        ]
        return self._inward(forces, biases, None), self._spatial(accelerations)

    def net_joint_forces(self, forces: ca.SX) -> list[ca.SX]:
        """The net joint forces F of generalized forces (nv, k): Σ Fᵀ D⁻¹ F = forcesᵀ M⁻¹ forces."""
        return self._inward(forces, [ca.SX(6, forces.shape[1])] * len(self._links), None)

    def product(self, net_forces: Sequence[ca.SX], others: Sequence[ca.SX]) -> ca.SX:
        """forcesᵀ M⁻¹ others (k, l) for forces (nv, k) and others (nv, l), from the net joint forces of both."""
        total = ca.SX(net_forces[0].shape[1], others[0].shape[1])
        for index, (force, other) in enumerate(zip(net_forces, others, strict=True)):
            if force.shape[0]:
                total += sparse(force.T @ self._joints[index].factors.solve(other))
        return sparse(total)

    def factors(self, net_forces: Sequence[ca.SX]) -> tuple[ca.SX, ca.SX]:
        """F and D⁻¹ F (nv, k) of net joint forces F: the product of the transpose and the latter is `product`."""
        pairs = [(force, self._joints[index].factors.solve(force)) for index, force in enumerate(net_forces)]
        forces, solved = zip(*pairs, strict=True)
        return ca.sparsify(ca.vertcat(*forces)), ca.sparsify(ca.vertcat(*solved))

    def solve(self, net_forces: Sequence[ca.SX]) -> Accelerations:
        """M⁻¹ forces (nv,) from their net joint forces (., 1), and the accelerations of the links that follow."""
        return self._outward(net_forces, None, np.zeros(3))

    def _bias_forces(self) -> list[ca.SX]:
        """The wrenches (6,) that the links need at their velocities without acceleration: ω × J ω and ω × (ω × m c)."""
        return [_bias_force(inertia, square) for inertia, square in zip(self._inertias, self._squares, strict=True)]

    def _bias_accelerations(self) -> list[ca.SX]:
        """The accelerations [ω'; p''] (6,) of the links' origins across their joints at u' = 0.

        They are those of the points, unlike spatial accelerations, and so independent of the velocity of any origin.
        """
        found = []
        for link, motion in zip(self._links, self._motions, strict=True):
            bias = ca.vertcat(motion.joint.bias[:3], motion.joint.origin_bias)
            if link.parent >= 0:
                omega, square = self._motions[link.parent].V_WL[:3], self._squares[link.parent]
                bias = _carried_bias(motion.R_PL, motion.p_PL, omega, square, motion.joint.V_FM, bias)
            found.append(sparse(bias))
        return found

    def _spatial(self, accelerations: Sequence[ca.SX]) -> list[ca.SX]:
        """The spatial accelerations (6,) of the links, from those of their origins."""
        return [
            sparse(ca.vertcat(one[:3], one[3:] - skew(motion.V_WL[:3]) @ motion.V_WL[3:]))
            for one, motion in zip(accelerations, self._motions, strict=True)
        ]

    def _inward(
        self, forces: ca.SX, biases: Sequence[ca.SX], bias_accelerations: Sequence[ca.SX] | None
    ) -> list[ca.SX]:
        """The net joint forces, from the outermost links to ground."""
        biases = list(biases)
        net_forces: dict[int, ca.SX] = {}
        for index in reversed(range(len(self._links))):
            link, joint = self._links[index], self._joints[index]
            acceleration = None if bias_accelerations is None else bias_accelerations[index]
            net_forces[index], transmitted = joint.inward(forces[link.u, :], biases[index], acceleration)
            if link.parent >= 0 and transmitted.nnz():
                biases[link.parent] = biases[link.parent] + inboard_force(self._motions[index], transmitted)
        return [net_forces[index] for index in range(len(self._links))]

    def _outward(
        self, net_forces: Sequence[ca.SX], bias_accelerations: Sequence[ca.SX] | None, base: Array | ca.SX
    ) -> Accelerations:
        """The accelerations, from ground to the outermost links; `base` (3,) is that of ground's origin."""
        accelerations: list[ca.SX] = []
        result = ca.SX(self._nv, 1)
        for index, link in enumerate(self._links):
            motion, joint = self._motions[index], self._joints[index]
            inboard = accelerations[link.parent] if link.parent >= 0 else _base_acceleration(base)
            bias = None if bias_accelerations is None else bias_accelerations[index]
            carried = outboard_motion(motion, inboard, bias)
            acceleration, result[link.u] = joint.outward(net_forces[index], carried)
            accelerations.append(acceleration)
        return Accelerations(result, lambda: accelerations)


def _base_acceleration(acceleration: Array | ca.SX) -> ca.SX:
    """The acceleration (6,) of ground, which does not rotate, and whose origin has this acceleration (3,)."""
    return sparse(ca.vertcat(ca.SX(3, 1), constant(acceleration)))


@inlined
def _square(omega: ca.SX) -> ca.SX:
    """S (3, 3) with S @ r = ω × (ω × r), as ω ωᵀ less its trace."""
    x, y, z = omega[0], omega[1], omega[2]
    products = symmetric(sparse(omega @ omega.T))
    products[0, 0], products[1, 1], products[2, 2] = -(y * y + z * z), -(x * x + z * z), -(x * x + y * y)
    return products


@inlined
def _carried_bias(R_PL: ca.SX, p_PL: ca.SX, omega: ca.SX, square: ca.SX, V_FM: ca.SX, bias: ca.SX) -> ca.SX:
    """The acceleration [ω'; p''] (6,) across a joint on a link that rotates, from that on a link that does not."""
    turning = skew(R_PL.T @ omega)
    angular = turning @ V_FM[:3] + bias[:3]
    return ca.vertcat(angular, R_PL.T @ (square @ p_PL) + 2.0 * (turning @ V_FM[3:]) + bias[3:])


@inlined
def _bias_force(inertia: ca.SX, square: ca.SX) -> ca.SX:
    """[ω × J ω; ω × (ω × m c)] (6,) in N·m and N, from the products of ω in `_square`."""
    rows = []
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        moment = (inertia[k, k] - inertia[j, j]) * square[j, k]
        moment += inertia[j, k] * (square[j, j] - square[k, k])
        rows.append(moment + inertia[i, k] * square[i, j] - inertia[i, j] * square[i, k])
    mass_moment = ca.vertcat(inertia[2, 4], inertia[0, 5], inertia[1, 3])
    return ca.vertcat(*rows, square @ mass_moment)


def bias_acceleration(motion: LinkMotion) -> ca.SX:
    """The spatial acceleration (6,) across a link's joint at u' = 0."""
    return sparse(motion_cross(motion.V_WL) @ motion.joint.V_FM + motion.joint.bias)


def bias_force(link: Link, motion: LinkMotion) -> ca.SX:
    """The wrench (6,) that a link needs at its velocity without acceleration: v ×* I v."""
    return -motion_cross(motion.V_WL).T @ (constant(link.inertia) @ motion.V_WL)
