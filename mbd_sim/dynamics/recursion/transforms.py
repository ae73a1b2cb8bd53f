"""Motion vectors, forces and inertias carried across a joint, in few operations.

A matrix (6, 6) that transforms motion vectors has blocks that are products of a rotation and a translation. Here both
are applied one after the other, and inertias are rotated about a coordinate axis without forming products of matrices:
of their blocks (2, 2) across the axis, only the deviatoric parts change (Featherstone, sec. A.4 and table A.1).

Motion vectors are (angular, linear) and wrenches (moment, force), in SI units.
"""

from __future__ import annotations

from functools import partial

import casadi as ca

from mbd_sim.dynamics.kinematics.links import Link
from mbd_sim.dynamics.kinematics.poses import LinkMotion, carried_outward
from mbd_sim.dynamics.math.spatial import constant, inlined, sparse, symmetric, zeros


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
