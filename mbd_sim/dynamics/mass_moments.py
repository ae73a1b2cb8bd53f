"""Mass, first and second moments of parts, which are polynomials in masses and lengths also for composite parts."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.dynamics.spatial_algebra import constant, skew
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.mechanism.records import Mechanism, Part


@dataclass(frozen=True, eq=False)
class MassMoments:
    """Of a part about the origin of its frame, in its axes.

    `mass` in kg, `first` (3,) = m c in kg·m with the center of mass c, and `second` (3, 3), the inertia tensor, in
    kg·m².
    """

    mass: float | ca.SX
    first: Array | ca.SX
    second: Array | ca.SX


def mass_moments(part: Part) -> MassMoments:
    """Those of a part in numbers (Huston & Liu, sec. 7.6: the parallel axis theorem)."""
    c = part.center
    return MassMoments(part.mass, part.mass * c, part.inertia + part.mass * (c @ c * np.eye(3) - np.outer(c, c)))


def with_springs(mechanism: Mechanism, part: str, moments: MassMoments) -> MassMoments:
    """The moments of a part with those of springs with mass between it and ground: m/3 at the end of each spring."""
    mass, first, second = ca.SX(moments.mass), constant(moments.first), constant(moments.second)
    for spring in mechanism.springs:
        for end in (spring.first, spring.second):
            if end.part == part:
                point, third = constant(end.point), spring.mass / 3.0
                mass, first = mass + third, first + third * point
                second += third * (ca.dot(point, point) * ca.SX.eye(3) - point @ point.T)
    return MassMoments(mass, first, second)


def spatial_inertia(moments: MassMoments, X_LB: Pose) -> ca.SX:
    """The spatial inertia (6, 6) about the origin of a frame L, in its axes (Featherstone, eq. 2.63).

    :param X_LB: the pose in L of the frame B whose moments are given.
    """
    p, rotation = constant(X_LB.position), constant(X_LB.rotation)
    mass, first = ca.SX(moments.mass), rotation @ constant(moments.first)
    own = rotation @ constant(moments.second) @ rotation.T
    both = p @ first.T + first @ p.T
    across = mass * (ca.dot(p, p) * ca.SX.eye(3) - p @ p.T) + 2.0 * ca.dot(p, first) * ca.SX.eye(3) - both
    s = skew(mass * p + first)
    return ca.sparsify(ca.vertcat(ca.horzcat(own + across, s), ca.horzcat(-s, mass * ca.SX.eye(3))))
