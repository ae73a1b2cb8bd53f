"""The wrenches on each link: the sum of the forces and couples on its parts, and those given as inputs.

The wrenches that a caller applies to parts are symbols among the inputs. The powers of forces are added up here too, as
the energy audit counts them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.base.linear_algebra import product
from mbd_sim.dynamics.kinematics.links import Link
from mbd_sim.dynamics.kinematics.poses import LinkMotion, SymbolicPose, rotation_of_link
from mbd_sim.dynamics.layouts.vectors import InputLayout
from mbd_sim.dynamics.math.spatial import constant, is_symbolic, skew
from mbd_sim.mechanism.elements.parts import GROUND, Attachment
from mbd_sim.mechanism.values.expression import TIME, TimeExpression


@dataclass(frozen=True, eq=False)
class AttachmentMotion:
    """A point Q of a part, in ground's axes: p_WQ (3,) in m, its velocity (3,) in m/s, and its part's ω (3,)."""

    position: ca.SX
    velocity: ca.SX
    omega: ca.SX


class AppliedWrenches:
    """Collects the wrenches F_L (6,) = [moment; force] on all links."""

    def __init__(self, links: Sequence[Link], motions: Sequence[LinkMotion], poses: Sequence[SymbolicPose]) -> None:
        self._links, self._motions, self._poses = links, motions, poses
        self._index = {link.joint.outboard: index for index, link in enumerate(links)}
        self.wrenches = [ca.SX(6, 1) for _ in links]

    def motion_of(self, at: Attachment) -> AttachmentMotion:
        """The position and velocity of a point of a part."""
        if at.part == GROUND:
            return AttachmentMotion(constant(at.point), ca.SX(3, 1), ca.SX(3, 1))
        index = self._index[at.part]
        X_WB, V_WL, R_WL = self._poses[index], self._motions[index].V_WL, self._R_WL(index)
        return AttachmentMotion(
            position=X_WB.position + X_WB.rotation @ constant(at.point),
            velocity=R_WL @ (V_WL[3:] - skew(self._p_LQ(index, at)) @ V_WL[:3]),
            omega=R_WL @ V_WL[:3],
        )

    def rotation(self, part: str) -> ca.SX:
        """R_WB (3, 3) of a part, or the identity for ground."""
        return constant(np.eye(3)) if part == GROUND else self._poses[self._index[part]].rotation

    def add_force(self, at: Attachment, force: ca.SX) -> None:
        """Apply a force (3,) in N, in ground's axes, at a point."""
        if at.part != GROUND:
            index = self._index[at.part]
            f_L = self._R_WL(index).T @ force
            self.wrenches[index] += ca.vertcat(skew(self._p_LQ(index, at)) @ f_L, f_L)

    def add_couple(self, at: Attachment, couple: ca.SX) -> None:
        """Apply a couple (3,) in N·m, in ground's axes, to a part."""
        index = self._index[at.part]
        self.wrenches[index] += ca.vertcat(self._R_WL(index).T @ couple, ca.SX(3, 1))

    def add_in_own_axes(self, at: Attachment, vector: ca.SX, couple: bool) -> ca.SX:
        """Apply a force or a couple (3,) in the part's own axes, and return its power in W.

        Rotating it to ground's axes and back would cost forty instructions, because nothing cancels there.
        """
        index = self._index[at.part]
        own = ca.sparsify(constant(self._links[index].X_LB.rotation) @ vector)
        moment, force = (own, ca.SX(3, 1)) if couple else (skew(self._p_LQ(index, at)) @ own, own)
        F_L = ca.sparsify(ca.vertcat(moment, force))
        self.wrenches[index] += F_L
        return ca.dot(F_L, self._motions[index].V_WL)

    def _R_WL(self, index: int) -> ca.SX:
        return rotation_of_link(self._links[index], self._poses[index])

    def _p_LQ(self, index: int, at: Attachment) -> ca.SX:
        X_LB = self._links[index].X_LB
        if is_symbolic(at.point, X_LB.position, X_LB.rotation):
            return ca.sparsify(constant(X_LB.position) + constant(X_LB.rotation) @ constant(at.point))
        return constant(X_LB.position + product(X_LB.rotation, at.point))


@dataclass(frozen=True, eq=False)
class ExternalWrench:
    """A wrench on a part, in the order in which the inputs hold it.

    `force` (3,) in N and `couple` (3,) in N·m are expressed in ground's axes, `own_force` (3,) and `own_couple` (3,)
    in the part's axes, with which they rotate. Both forces act at the `point` (3,) in m in the part's frame.
    """

    force: ca.SX
    couple: ca.SX
    own_force: ca.SX
    own_couple: ca.SX
    point: ca.SX


def external_wrenches(layout: InputLayout, inputs: ca.SX) -> Mapping[str, ExternalWrench]:
    """The symbols of the wrench on each loaded part."""
    return {part: ExternalWrench(*ca.vertsplit(inputs[span], 3)) for part, span in layout.wrenches.items()}


class PowerSplit:
    """Adds up powers in W as `applied` and as `dissipated`.

    A force that depends on nothing but the time comes from outside: all of its work is applied, with its sign. A force
    that depends on the motion is part of the mechanism. At each instant its power is applied where it is positive, and
    dissipated where it is negative. The difference of the two is the power itself, so that the audit closes as exactly
    as without the split.
    """

    def __init__(self) -> None:
        self.applied, self.dissipated = ca.SX(1, 1), ca.SX(1, 1)

    def add(self, expressions: Sequence[TimeExpression], power: ca.SX) -> None:
        """Add the power of one force, which these expressions give."""
        if any(expression.variables - {TIME} for expression in expressions):
            self.applied += ca.fmax(power, 0.0)
            self.dissipated += ca.fmax(-power, 0.0)
        else:
            self.applied += power
