"""Accelerations of an open chain by the articulated-body recursion, O(n) (Featherstone, sec. 7.3).

The recursion factorizes the mass matrix once for a position; `respond` then solves with it for any generalized
forces, at a cost that grows with the links between them and ground.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.dynamics.kinematics import LinkMotion
from mbd_sim.dynamics.links import Link
from mbd_sim.dynamics.motion import Motion
from mbd_sim.dynamics.spatial_algebra import (
    SpdFactors,
    constant,
    motion_cross,
    symmetric,
)
from mbd_sim.geometry.pose import Array


@dataclass(frozen=True, eq=False)
class Accelerations:
    """`u_rates` (nv,) and the spatial acceleration (6,) of each `links`, own frame, less that of gravity."""

    u_rates: ca.SX
    links: list[ca.SX]

    def __add__(self, other: Accelerations) -> Accelerations:
        links = [ca.sparsify(one + more) for one, more in zip(self.links, other.links, strict=True)]
        return Accelerations(self.u_rates + other.u_rates, links)


class Articulated:
    """The mass matrix of a chain, factorized joint by joint.

    `pivots` (nv,) are positive where it is definite; a joint's stand in the order of its type's `turns`.
    """

    def __init__(self, links: Sequence[Link], motions: Sequence[LinkMotion], size: int) -> None:
        self._links, self._motions = links, motions
        inertias = [constant(link.inertia) for link in links]
        self._joints: dict[int, _Elimination] = {}
        self.pivots = ca.SX(size, 1)
        for index in reversed(range(len(links))):
            link, motion = links[index], motions[index]
            joint = _Elimination(motion.joint, inertias[index])
            self._joints[index] = joint
            self.pivots[link.u] = joint.factors.pivots
            if link.parent >= 0:
                inertias[link.parent] += symmetric(motion.transform.T @ joint.outlook @ motion.transform)

    def accelerations(self, forces: ca.SX, wrenches: Sequence[ca.SX], gravity: Array | ca.SX) -> Accelerations:
        """u' for generalized forces and gravity.

        :param forces: (nv,) generalized forces.
        :param wrenches: (6,) [moment; force] on each link, in its frame at its origin.
        :param gravity: (3,) m/s², in ground's frame.
        """
        biases = [
            ca.sparsify(bias_force(link, motion) - wrench)
            for link, motion, wrench in zip(self._links, self._motions, wrenches, strict=True)
        ]
        coriolis = [bias_acceleration(motion) for motion in self._motions]
        shares = self._inward(forces, biases, coriolis)
        return self._outward(shares, coriolis, -gravity, forces.shape[0])

    def acting(
        self, forces: ca.SX, wrenches: Sequence[ca.SX], gravity: Array | ca.SX
    ) -> tuple[list[ca.SX], list[ca.SX]]:
        """The shares (., 1) of all that acts, with the links' accelerations (6,) at u' = 0, less that of gravity.

        What `respond` makes of the shares, and adds to these accelerations, is the same as `accelerations`. Where
        constraint forces are to be added first, this saves one way out and back along the chain.
        """
        still: list[ca.SX] = []
        biases: list[ca.SX] = []
        base = _falling(-gravity)
        for link, motion, wrench in zip(self._links, self._motions, wrenches, strict=True):
            inboard = still[link.parent] if link.parent >= 0 else base
            still.append(ca.sparsify(motion.transform @ inboard + bias_acceleration(motion)))
            biases.append(ca.sparsify(constant(link.inertia) @ still[-1] + bias_force(link, motion) - wrench))
        return self._inward(forces, biases, None), still

    def shares(self, forces: ca.SX) -> list[ca.SX]:
        """What each joint takes up of generalized forces (nv, k): F with Σ Fᵀ D⁻¹ F = forcesᵀ M⁻¹ forces."""
        return self._inward(forces, [ca.SX(6, forces.shape[1])] * len(self._links), None)

    def product(self, shares: Sequence[ca.SX], others: Sequence[ca.SX]) -> ca.SX:
        """One set of forcesᵀ (k, nv) times M⁻¹ times another (nv, l), of the shares of both."""
        total = ca.SX(shares[0].shape[1], others[0].shape[1])
        for index, (share, other) in enumerate(zip(shares, others, strict=True)):
            if share.shape[0]:
                total += ca.sparsify(share.T @ self._joints[index].factors.solve(other))
        return ca.sparsify(total)

    def respond(self, shares: Sequence[ca.SX], size: int) -> Accelerations:
        """M⁻¹ `forces`, of the shares (., 1) of forces (nv,), and the links' accelerations that it makes."""
        return self._outward(shares, None, np.zeros(3), size)

    def _inward(self, forces: ca.SX, biases: Sequence[ca.SX], coriolis: Sequence[ca.SX] | None) -> list[ca.SX]:
        biases = list(biases)
        shares: dict[int, ca.SX] = {}
        for index in reversed(range(len(self._links))):
            link, joint = self._links[index], self._joints[index]
            along = forces[link.u, :]
            shares[index] = joint.share(along, biases[index])
            if link.parent >= 0:
                carried = None if coriolis is None else coriolis[index]
                transmitted = joint.transmitted(along, shares[index], biases[index], carried)
                biases[link.parent] = biases[link.parent] + self._motions[index].transform.T @ transmitted
        return [shares[index] for index in range(len(self._links))]

    def _outward(
        self, shares: Sequence[ca.SX], coriolis: Sequence[ca.SX] | None, base: Array | ca.SX, size: int
    ) -> Accelerations:
        accelerations: list[ca.SX] = []
        result = ca.SX(size, 1)
        for index, link in enumerate(self._links):
            motion, joint = self._motions[index], self._joints[index]
            inboard = accelerations[link.parent] if link.parent >= 0 else _falling(base)
            carried = motion.transform @ inboard
            if coriolis is not None:
                carried = carried + coriolis[index]
            speeds = joint.speed_rates(shares[index], carried)
            accelerations.append(ca.sparsify(carried + motion.joint.partial_velocities @ speeds))
            result[link.u] = speeds
        return Accelerations(result, accelerations)


def _falling(acceleration: Array | ca.SX) -> ca.SX:
    """The spatial acceleration (6,) of ground, of that of its origin."""
    return ca.sparsify(ca.vertcat(ca.SX(3, 1), constant(acceleration)))


def bias_acceleration(motion: LinkMotion) -> ca.SX:
    """The acceleration (6,) across a link's joint at u' = 0."""
    return ca.sparsify(motion_cross(motion.velocity) @ motion.joint.velocity + motion.joint.bias)


def bias_force(link: Link, motion: LinkMotion) -> ca.SX:
    """The force (6,) that a link at its velocity needs without acceleration: v ×* I v."""
    return -motion_cross(motion.velocity).T @ (constant(link.inertia) @ motion.velocity)


class _Elimination:
    """One link's joint eliminated from its articulated `inertia` (6, 6); `outlook` is what its inboard link feels.

    A joint that constrains nothing has no outlook: its link is solved by itself, in its own axes.
    """

    def __init__(self, joint: Motion, inertia: ca.SX) -> None:
        self._joint = joint
        if joint.inverse is not None:
            self.factors = SpdFactors(inertia)
            self.outlook = ca.SX(6, 6)
            return
        s = joint.partial_velocities
        self._u = ca.sparsify(inertia @ s)
        self.factors = SpdFactors(symmetric(s.T @ self._u))
        self._reduced = self.factors.solve(self._u.T)
        self.outlook = ca.sparsify(symmetric(inertia - self._u @ self._reduced))

    def share(self, forces: ca.SX, bias: ca.SX) -> ca.SX:
        """What is left to accelerate this joint (nv, k), of forces (nv, k) and a bias (6, k)."""
        if self._joint.inverse is not None:
            return ca.sparsify(self._joint.inverse.T @ forces - bias)
        return ca.sparsify(forces - self._joint.partial_velocities.T @ bias)

    def transmitted(self, forces: ca.SX, share: ca.SX, bias: ca.SX, coriolis: ca.SX | None) -> ca.SX:
        """The bias force (6, k) across the joint."""
        if self._joint.inverse is not None:
            return ca.sparsify(self._joint.inverse.T @ forces)
        if coriolis is not None:
            bias = bias + self.outlook @ coriolis
        return ca.sparsify(bias + self._u @ self.factors.solve(share))

    def speed_rates(self, share: ca.SX, carried: ca.SX) -> ca.SX:
        """u' of this joint for the acceleration (6,) that the link has at u' = 0."""
        if self._joint.inverse is not None:
            return self._joint.inverse @ (self.factors.solve(share) - carried)
        return self.factors.solve(share) - self._reduced @ carried
