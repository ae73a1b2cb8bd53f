"""Motion vectors, forces and inertias carried across a joint, in few operations.

A matrix (6, 6) that transforms motion vectors has blocks that are products of a rotation and a translation. Here both
are applied one after the other, and inertias are rotated about a coordinate axis without forming products of matrices:
of their blocks (2, 2) across the axis, only the deviatoric parts change (Featherstone, sec. A.4 and table A.1).

Motion vectors are (angular, linear) and wrenches (moment, force), in SI units.
"""

from __future__ import annotations

from functools import partial

import casadi as ca

from mbd_sim.dynamics.inlining import inlined
from mbd_sim.dynamics.kinematics import LinkMotion
from mbd_sim.dynamics.links import Link
from mbd_sim.dynamics.spatial_algebra import constant, skew, symmetric


def inboard_force(motion: LinkMotion, forces: ca.SX) -> ca.SX:
    """Wrenches F_L (6, k) on a link as wrenches about the inboard link's origin, in its axes."""
    force = ca.sparsify(motion.R_PL @ forces[3:, :])
    moment = ca.sparsify(motion.R_PL @ forces[:3, :]) + skew(motion.p_PL) @ force
    return ca.sparsify(ca.vertcat(moment, force))


def outboard_motion(motion: LinkMotion, vector: ca.SX) -> ca.SX:
    """A motion vector (6,) of the inboard link as one about the link's origin, in its axes."""
    R_LP, linear = motion.R_PL.T, ca.sparsify(vector[3:] - skew(motion.p_PL) @ vector[:3])
    return ca.sparsify(ca.vertcat(R_LP @ vector[:3], R_LP @ linear))


def inboard_inertia(link: Link, motion: LinkMotion, inertia: ca.SX) -> ca.SX:
    """A symmetric inertia (6, 6) of a link as one about the inboard link's origin, in its axes."""
    rotational, coupling, translational = inertia[:3, :3], inertia[:3, 3:], inertia[3:, 3:]
    R, p = motion.R_PL, skew(motion.p_PL)
    if (turn := motion.joint.turn) is not None:
        turned = _TURNED[turn.axis]
        rotational, coupling, translational = (
            turned(turn.sine, turn.cosine, block) for block in (rotational, coupling, translational)
        )
        R = constant(link.X_PF.rotation)
    rotational = symmetric(R @ rotational @ R.T)
    translational = symmetric(R @ translational @ R.T)
    coupling = R @ coupling @ R.T
    shifted = ca.sparsify(coupling + p @ translational)
    crossed = p @ coupling.T + (p @ shifted.T).T
    rotational = symmetric(ca.sparsify(rotational + crossed))
    return ca.sparsify(ca.vertcat(ca.horzcat(rotational, shifted), ca.horzcat(shifted.T, translational)))


def _turned(axis: int, s: ca.SX, c: ca.SX, block: ca.SX) -> ca.SX:
    """R B Rᵀ of a block B (3, 3), for a rotation R about a coordinate axis by an angle with a sine and a cosine."""
    k, i, j = axis, (axis + 1) % 3, (axis + 2) % 3
    result = ca.SX(3, 3)
    result[k, k] = block[k, k]
    result[i, k], result[j, k] = c * block[i, k] - s * block[j, k], s * block[i, k] + c * block[j, k]
    result[k, i], result[k, j] = c * block[k, i] - s * block[k, j], s * block[k, i] + c * block[k, j]
    deviation = ca.sparsify(s * (block[i, i] - block[j, j]) + c * (block[i, j] + block[j, i]))
    result[i, i], result[j, j] = block[i, i] - s * deviation, block[j, j] + s * deviation
    result[i, j], result[j, i] = c * deviation - block[j, i], c * deviation - block[i, j]
    return result


_TURNED = [inlined(partial(_turned, axis)) for axis in range(3)]
