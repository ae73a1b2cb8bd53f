"""Accelerations of an open chain by the articulated-body recursion, O(n) (Featherstone, sec. 7.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.dynamics.kinematics import LinkMotion
from mbd_sim.dynamics.links import Link
from mbd_sim.dynamics.spatial import constant, motion_cross, solve_spd, symmetric
from mbd_sim.mechanism.model import Array


@dataclass(frozen=True, eq=False)
class Accelerations:
    """`u_rates` (nv,), the `pivots` (nv,) of the factorization, and by joint what the drives exert, N or N·m.

    The pivots are positive where the mass matrix is definite; a joint's stand in the order of its type's `turns`.
    """

    u_rates: ca.SX
    pivots: ca.SX
    drive_forces: Mapping[str, ca.SX]


def accelerations(
    links: Sequence[Link],
    motions: Sequence[LinkMotion],
    forces: ca.SX,
    wrenches: Sequence[ca.SX],
    gravity: Array,
) -> Accelerations:
    """u' for generalized forces and gravity.

    :param forces: (nv,) generalized forces.
    :param wrenches: (6,) [moment; force] on each link, in its frame at its origin.
    :param gravity: (3,) m/s², in ground's frame.
    """
    inertias = [constant(link.inertia) for link in links]
    biases = [
        -motion_cross(motion.velocity).T @ (inertia @ motion.velocity) - wrench
        for inertia, motion, wrench in zip(inertias, motions, wrenches, strict=True)
    ]
    coriolis = [ca.sparsify(motion_cross(m.velocity) @ m.joint.velocity + m.joint.bias) for m in motions]
    solvers: dict[int, _Elimination] = {}
    for index in reversed(range(len(links))):
        link, motion = links[index], motions[index]
        along = forces[link.u, :]  # with one index, nothing out of a single force would be a row
        solver = _Elimination(motion, inertias[index], ca.sparsify(biases[index]), along)
        solvers[index] = solver
        if link.parent >= 0:
            inertia, bias = solver.outlook(coriolis[index])
            inertias[link.parent] += symmetric(motion.transform.T @ inertia @ motion.transform)
            biases[link.parent] += motion.transform.T @ bias

    base = constant(np.concatenate([np.zeros(3), -gravity]))
    linear: list[ca.SX] = []
    result, pivots = ca.SX(forces.shape[0], 1), ca.SX(forces.shape[0], 1)
    drive_forces: dict[str, ca.SX] = {}
    for index, link in enumerate(links):
        inboard = linear[link.parent] if link.parent >= 0 else base
        carried = motions[index].transform @ inboard + coriolis[index]
        speeds = solvers[index].speed_rates(carried)
        linear.append(ca.sparsify(carried + motions[index].joint.partial_velocities @ speeds))
        result[link.u], pivots[link.u] = speeds, solvers[index].pivots
        if (drive := motions[index].joint.drive) is not None:
            wrench = inertias[index] @ linear[index] + biases[index]
            drive_forces[link.joint.name] = drive.partial_velocities.T @ wrench
    return Accelerations(result, pivots, drive_forces)


class _Elimination:
    """One link's joint eliminated: the articulated inertia and bias that its inboard link feels."""

    def __init__(self, motion: LinkMotion, inertia: ca.SX, bias: ca.SX, forces: ca.SX) -> None:
        self.joint, self.inertia, self.bias, self.forces = motion.joint, inertia, bias, forces
        if self.joint.inverse is not None:
            wrench = ca.sparsify(self.joint.inverse.T @ forces)
            self.acceleration, self.pivots = solve_spd(inertia, wrench - bias)
            self.wrench = wrench
            return
        s = self.joint.partial_velocities
        self.u = ca.sparsify(inertia @ s)
        self.excess = forces - s.T @ bias
        if s.shape[1]:
            self.shares, self.pivots = solve_spd(symmetric(s.T @ self.u), ca.horzcat(self.u.T, self.excess))
        else:
            self.shares, self.pivots = ca.SX(0, 7), ca.SX(0, 1)

    def outlook(self, coriolis: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Articulated inertia (6, 6) and bias force (6,) across the joint."""
        if self.joint.inverse is not None:
            return ca.SX(6, 6), self.wrench
        inertia = ca.sparsify(symmetric(self.inertia - self.u @ self.shares[:, :6]))
        return inertia, ca.sparsify(self.bias + inertia @ coriolis + self.u @ self.shares[:, 6])

    def speed_rates(self, carried: ca.SX) -> ca.SX:
        """u' of this joint for the acceleration (6,) that the link has at u' = 0."""
        if self.joint.inverse is not None:
            return self.joint.inverse @ (self.acceleration - carried)
        return self.shares[:, 6] - self.shares[:, :6] @ carried
