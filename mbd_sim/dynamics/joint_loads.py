"""The forces that joints transmit across their axes, on which their friction depends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.dynamics.links import Link
from mbd_sim.dynamics.spatial_algebra import constant
from mbd_sim.geometry.rotation import aligning_z
from mbd_sim.mechanism.records import Joint


@dataclass(frozen=True, eq=False)
class JointLoad:
    """The force across a joint's axis in N, affine in the contact forces λ (rows,): `unloaded` (k,) + `by_force` λ.

    The k = 1, 2 or 3 components are those that do not vanish in every motion. `factor` is k_s μ while the joint slides
    in the direction k_s = ±1, and 0 otherwise; `sign` is the stored sign of a single component.
    """

    row: int
    unloaded: ca.SX
    by_force: ca.SX
    factor: ca.SX
    sign: ca.SX

    @property
    def components(self) -> int:
        """k."""
        return int(self.unloaded.shape[0])

    def size(self, forces: ca.SX) -> ca.SX:
        """|N| in N."""
        components = self.unloaded + self.by_force @ forces
        return ca.fabs(components[0]) if self.components == 1 else ca.sqrt(ca.dot(components, components))

    @property
    def start(self) -> ca.SX:
        """A direction (k,) near that of the force, from which it is iterated."""
        if self.components == 1:
            return self.sign
        size = ca.sqrt(ca.dot(self.unloaded, self.unloaded))
        first = ca.SX(ca.DM([1.0] + [0.0] * (self.components - 1)))
        return ca.if_else(size > 0.0, self.unloaded / ca.fmax(size, 1e-300), first)


def transmitted_force(links: Sequence[Link], joint: Joint, transmitted: Sequence[ca.SX]) -> ca.SX:
    """The force (k,) that a joint transmits: across the axis of a slider, and in all directions of a hinge.

    :param transmitted: F_L (6,) on each link through its joint.
    """
    index = next(number for number, link in enumerate(links) if link.joint.name == joint.name)
    force = transmitted[index][3:]
    if joint.type == "prismatic":
        axis = links[index].axes.axis
        force = constant(aligning_z(axis)[:, :2].T if np.count_nonzero(axis) > 1 else _others(axis)) @ force
    return ca.sparsify(force)


def _others(axis: np.ndarray) -> np.ndarray:
    """The coordinate directions (2, 3) other than that of an axis."""
    return np.delete(np.eye(3), int(np.argmax(np.abs(axis))), axis=0)
