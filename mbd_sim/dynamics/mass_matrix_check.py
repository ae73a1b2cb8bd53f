"""Whether the mass matrix is positive definite, and which joints are to blame where it is not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.dynamics.links import Link
from mbd_sim.errors import MechanismError, Problem
from mbd_sim.geometry.pose import Array, unpack_poses
from mbd_sim.mechanism.records import Joint, Mechanism

ROUND_OFF = 1e-13  # of an inertia, what its computation may leave of a zero


def require_definite(mechanism: Mechanism, chain: Sequence[Link], pivots: Array, poses: Array) -> None:
    """Refuse a singular mass matrix.

    A pivot is what a joint moves when all joints beyond it move freely. It counts as zero where it is no more than
    round-off of what the joint carries, so that neither units nor the size of other parts matter.

    :raises MechanismError: the joints to blame are named.
    :param pivots: (nv,), each joint's in the order of its coordinates, a free joint's rotations first.
    :param poses: the pose rows (links, 12) of each link's part in ground's frame, see `unpack_poses`.
    """
    positions, rotations = unpack_poses(poses)
    carried = [_Load(0.0, np.zeros(3), 0.0)] * len(chain)
    spoiled = [False] * len(chain)
    problems: list[Problem] = []
    for index in reversed(range(len(chain))):
        link, position, rotation = chain[index], positions[index], rotations[index]
        part = mechanism.parts[link.joint.outboard]
        carried[index] += _Load(part.mass, position + rotation @ part.center, float(np.trace(part.inertia)))
        if not spoiled[index] and link.u.stop > link.u.start:
            origin = position - rotation @ link.part.rotation.T @ link.part.position
            scale = np.where(_is_moment(link.joint), carried[index].moment_about(origin), carried[index].mass)
            spoiled[index] = bool(np.any(~(pivots[link.u] > ROUND_OFF * scale)))
            if spoiled[index]:
                message = "this joint moves no inertia of its own: its coordinate has no equation of motion"
                remedy = (
                    "Give what it moves a mass away from the axis, or an inertia about it (a thin rod has none about "
                    "itself); between two joints that move alike there must be a mass as well. In a loop, "
                    "'cut: true' at another joint may help."
                )
                problems.append(mechanism.source.problem(("joints", link.joint.name), message, remedy))
        if link.parent >= 0:
            carried[link.parent] += carried[index]
            spoiled[link.parent] |= spoiled[index]
    if problems:
        raise MechanismError(sorted(problems, key=lambda problem: problem.line))


def _is_moment(joint: Joint) -> list[bool]:
    """Whether each pivot of a joint is a moment of inertia rather than a mass."""
    rotations = [coordinate.rotation for coordinate in joint.kind.coordinates]
    # A free joint is not eliminated by the recursion: its pivots are in the order [ω; v] of motion vectors.
    return sorted(rotations, reverse=True) if joint.type == "free" else rotations


@dataclass(frozen=True, eq=False)
class _Load:
    """Parts that move together: `mass` in kg, `center` (3,) of mass, and the trace of the inertia about it in kg·m²."""

    mass: float
    center: Array
    trace: float

    def __add__(self, other: _Load) -> _Load:
        mass = self.mass + other.mass
        if mass == 0.0:
            return self
        arm = other.center - self.center
        share = other.mass / mass
        trace = self.trace + other.trace + 2.0 * self.mass * share * float(arm @ arm)
        return _Load(mass, self.center + share * arm, trace)

    def moment_about(self, point: Array) -> float:
        """The trace of the inertia about a point: no moment of inertia about an axis through it is larger."""
        arm = self.center - point
        return self.trace + 2.0 * self.mass * float(arm @ arm)
