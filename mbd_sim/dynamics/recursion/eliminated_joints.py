"""Joints eliminated from the equations of motion of the links outboard of them (Featherstone, table 7.1).

The net joint force of a joint is u = τ - Sᵀ pᴬ in that table: the generalized forces τ that remain to accelerate the
joint, after the bias force pᴬ of the links outboard of it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TypeAlias

import casadi as ca

from mbd_sim.dynamics.kinematics.joint_motions import JointMotion
from mbd_sim.dynamics.math.spatial import SpdFactors, inlined_results, sparse, symmetric, zeros

Solve: TypeAlias = Callable[[ca.SX], ca.SX]


class EliminatedJoint(ABC):
    """A joint eliminated from the articulated inertia of its outboard link.

    `factors` are those of that inertia in the joint's own coordinates. `projected_inertia` (6, 6) is its contribution
    to the inboard link: Iᵃ in Featherstone's table 7.1.
    """

    factors: SpdFactors
    projected_inertia: ca.SX

    @property
    def pivots(self) -> ca.SX:
        """The pivots (n,) of the inertia, in the order of the joint's coordinates."""
        return self.factors.pivots

    @abstractmethod
    def inward(self, forces: ca.SX, bias: ca.SX, acceleration: ca.SX | None) -> tuple[ca.SX, ca.SX]:
        """The net joint force (., k), and the bias force (6, k) that the joint transmits to the inboard link.

        :param forces: (., k) the joint's generalized forces.
        :param bias: (6, k) the bias force of the outboard link.
        :param acceleration: (6,) across the joint at u' = 0, if k is 1; None if it is zero.
        """

    @abstractmethod
    def outward(self, net_force: ca.SX, carried: ca.SX) -> tuple[ca.SX, ca.SX]:
        """The link's acceleration (6,), and u' (n,) of this joint; `carried` (6,) is the acceleration at u' = 0."""


def eliminated(joint: JointMotion, inertia: ca.SX, added: ca.SX | None) -> EliminatedJoint:
    """The joint, eliminated from an articulated inertia (6, 6).

    :param added: (n,) is added to the diagonal of the inertia in the joint's n coordinates; None adds nothing.
    """
    if joint.inverse is not None and (added is None or not sparse(added).nnz()):
        return _FreeJoint(joint.inverse, inertia)
    coordinates = joint.partial_velocities.size2()
    if coordinates == 0:
        return _FixedJoint(inertia)
    if coordinates == 1:
        return _SimpleJoint(joint.partial_velocities, inertia, zeros(1) if added is None else added)
    return _GeneralJoint(joint.partial_velocities, inertia, added)


class _FixedJoint(EliminatedJoint):
    """A joint without coordinates."""

    def __init__(self, inertia: ca.SX) -> None:
        self.factors = SpdFactors(zeros(0, 0))
        self.projected_inertia = sparse(symmetric(inertia))

    def inward(self, forces: ca.SX, bias: ca.SX, acceleration: ca.SX | None) -> tuple[ca.SX, ca.SX]:
        if acceleration is not None and self.projected_inertia.nnz():
            bias = sparse(bias + self.projected_inertia @ acceleration)
        return forces, bias

    def outward(self, net_force: ca.SX, carried: ca.SX) -> tuple[ca.SX, ca.SX]:
        return carried, net_force


class _FreeJoint(EliminatedJoint):
    """A joint that constrains nothing: it transmits no inertia, and the link is solved for in its own axes."""

    def __init__(self, inverse: ca.SX, inertia: ca.SX) -> None:
        """`inverse` (6, 6) is that of the partial velocities."""
        self._inverse = inverse
        self.factors = SpdFactors(inertia)
        self.projected_inertia = zeros(6, 6)

    @property
    def pivots(self) -> ca.SX:
        return ca.vertcat(self.factors.pivots[3:], self.factors.pivots[:3])

    def inward(self, forces: ca.SX, bias: ca.SX, acceleration: ca.SX | None) -> tuple[ca.SX, ca.SX]:
        wrench = self._inverse.T @ forces
        return sparse(wrench - bias), sparse(wrench)

    def outward(self, net_force: ca.SX, carried: ca.SX) -> tuple[ca.SX, ca.SX]:
        solved = self.factors.solve(net_force)
        return solved, self._inverse @ (solved - carried)


class _GeneralJoint(EliminatedJoint):
    """A joint with coordinates."""

    def __init__(self, s: ca.SX, inertia: ca.SX, added: ca.SX | None) -> None:
        """`s` (6, n) are the partial velocities."""
        self._s, self._u = s, sparse(inertia @ s)
        own = symmetric(s.T @ self._u)
        self.factors = SpdFactors(own if added is None else sparse(own + ca.diag(added)))
        self._reduced = self.factors.solve(self._u.T)
        self.projected_inertia = sparse(symmetric(inertia - self._u @ self._reduced))

    def inward(self, forces: ca.SX, bias: ca.SX, acceleration: ca.SX | None) -> tuple[ca.SX, ca.SX]:
        motion = () if acceleration is None else (self.projected_inertia, acceleration)
        net_force, transmitted = _inward(self.factors.solve, self._s, self._u, forces, bias, *motion)
        return sparse(net_force), sparse(transmitted)

    def outward(self, net_force: ca.SX, carried: ca.SX) -> tuple[ca.SX, ca.SX]:
        acceleration, u_rates = _outward(self.factors.solve, self._s, self._reduced, net_force, carried)
        return sparse(acceleration), u_rates


class _SimpleJoint(EliminatedJoint):
    """A joint with one coordinate, as most have: the same as the general one, in one call for each pass."""

    def __init__(self, s: ca.SX, inertia: ca.SX, added: ca.SX) -> None:
        self._s = s
        self._u, self._own, self._reduced, projected = _eliminated(s, inertia, added)
        self.projected_inertia = projected if sparse(added).nnz() else _without_round_off(projected, s)
        self.factors = SpdFactors(self._own)

    def inward(self, forces: ca.SX, bias: ca.SX, acceleration: ca.SX | None) -> tuple[ca.SX, ca.SX]:
        motion = () if acceleration is None else (self.projected_inertia, acceleration)
        net_force, transmitted = _inward_simple(self._own, self._s, self._u, forces, bias, *motion)
        return net_force, transmitted

    def outward(self, net_force: ca.SX, carried: ca.SX) -> tuple[ca.SX, ca.SX]:
        acceleration, u_rates = _outward_simple(self._own, self._s, self._reduced, net_force, carried)
        return acceleration, u_rates


def _inward(solve: Solve, s: ca.SX, u: ca.SX, forces: ca.SX, bias: ca.SX, *motion: ca.SX) -> tuple[ca.SX, ca.SX]:
    """See `EliminatedJoint.inward`; the `motion` is the projected inertia and the acceleration, if that is not zero."""
    net_force = forces - s.T @ bias
    if motion:
        inertia, acceleration = motion
        bias = bias + inertia @ acceleration
    return net_force, bias + u @ solve(net_force)


def _outward(solve: Solve, s: ca.SX, reduced: ca.SX, net_force: ca.SX, carried: ca.SX) -> tuple[ca.SX, ca.SX]:
    u_rates = solve(net_force) - reduced @ carried
    return carried + s @ u_rates, u_rates


def _without_round_off(projected: ca.SX, s: ca.SX) -> ca.SX:
    """A projected inertia without the numbers that are left of its product with `s` (6, 1), which is zero."""
    if s.nnz() != 1:
        return projected
    axis = s.sparsity().row()[0]
    for other in range(6):
        if projected[axis, other].is_constant():
            projected[axis, other] = projected[other, axis] = 0.0
    return sparse(projected)


@inlined_results
def _eliminated(s: ca.SX, inertia: ca.SX, added: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    u = inertia @ s
    own = s.T @ u + added
    reduced = u.T / own
    return u, own, reduced, symmetric(inertia - u @ reduced)


@inlined_results
def _inward_simple(own: ca.SX, *arguments: ca.SX) -> tuple[ca.SX, ca.SX]:
    return _inward(lambda right: right / own, *arguments)


@inlined_results
def _outward_simple(own: ca.SX, *arguments: ca.SX) -> tuple[ca.SX, ca.SX]:
    return _outward(lambda right: right / own, *arguments)
