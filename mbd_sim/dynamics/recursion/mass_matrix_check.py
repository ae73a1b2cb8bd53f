"""Whether the mass matrix is positive definite, and which joints make it singular if it is not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.base.errors import NoInertiaError, Problem, listed
from mbd_sim.base.geometry.pose import Array, unpack_poses
from mbd_sim.dynamics.kinematics.links import Link
from mbd_sim.mechanism.elements.parts import Joint, Part
from mbd_sim.mechanism.mechanism import Mechanism

ROUND_OFF = 1e-13  # relative to an inertia: the largest pivot, or eigenvalue, that counts as zero
INVOLVED = 0.1  # the smallest share of a coordinate in a motion without inertia, relative to the largest share


def require_definite(mechanism: Mechanism, links: Sequence[Link], pivots: Array, poses: Array) -> None:
    """Refuse a singular mass matrix.

    A pivot is the inertia that a joint moves while all joints outboard of it move freely. It counts as zero if it is
    no more than round-off of the inertia that the joint carries. So neither units nor the size of other parts matter.

    :param pivots: (nv,) in kg or kg·m², in the order of the coordinates.
    :param poses: the pose rows (links, 12) of each link's part in ground's frame, see `unpack_poses`.
    :raises NoInertiaError: the joints that make it singular are named.
    """
    positions, rotations = unpack_poses(poses)
    bodies = mechanism.bodies
    carried = [_CarriedInertia(0.0, np.zeros(3), 0.0)] * len(links)
    refused = [False] * len(links)  # the link's joint, or one outboard of it
    problems: list[Problem] = []
    for index in reversed(range(len(links))):
        link, p_WB, R_WB = links[index], positions[index], rotations[index]
        part = bodies[link.joint.outboard]
        carried[index] += _CarriedInertia(part.mass, p_WB + R_WB @ part.center, float(np.trace(part.inertia)))
        moves = link.u.stop > link.u.start
        if moves and carried[index].mass == 0.0 and carried[index].trace == 0.0:
            refused[index] = True
            problems.append(_massless(mechanism, link))
        if moves and not refused[index]:
            p_WL = p_WB - R_WB @ link.X_LB.rotation.T @ link.X_LB.position
            scale = np.where(_is_moment(link.joint), carried[index].moment_about(p_WL), carried[index].mass)
            refused[index] = bool(np.any(~(pivots[link.u] > ROUND_OFF * scale)))
            if refused[index]:
                problems.append(_no_inertia(mechanism, link))
        if link.parent >= 0:
            carried[link.parent] += carried[index]
            refused[link.parent] |= refused[index]
    if problems:
        raise NoInertiaError(sorted(problems, key=lambda problem: problem.line))


def require_independent(mechanism: Mechanism, links: Sequence[Link], mass_matrix: Array) -> None:
    """Refuse joints that together can move without moving any inertia, though each of them alone cannot.

    An example is a particle that three joints turn about one point. The mass matrix counts as singular if its smallest
    eigenvalue is no more than round-off, after each coordinate is scaled to an inertia of 1.

    :param mass_matrix: (nv, nv), definite according to `require_definite`.
    :raises NoInertiaError: the joints and the parts without an inertia of their own are named.
    """
    sizes = np.sqrt(np.diag(mass_matrix))
    scaled = mass_matrix / np.outer(sizes, sizes)
    if not len(scaled) or np.linalg.eigvalsh(scaled)[0] > ROUND_OFF:
        return
    shares = np.abs(np.linalg.eigh(scaled).eigenvectors[:, 0])
    joints = [index for index, link in enumerate(links) if np.any(shares[link.u] > INVOLVED * np.max(shares))]
    names = [f"'{links[index].joint.name}'" for index in joints]
    moved: set[int] = set()
    for index, link in enumerate(links):
        if index in joints or link.parent in moved:
            moved.add(index)
    bodies = mechanism.bodies
    parts = [bodies[links[index].joint.outboard] for index in sorted(moved)]
    points = [f"'{part.name}'" for part in parts if part.mass > 0.0 and _is_particle(part)]
    message = f"the joints {listed(names)} together can move without moving any inertia"
    remedy = "Give the parts that they move an inertia, or fix or drive one of the joints."
    if points:
        remedy += f" These parts have none: {listed(points)}."
    raise NoInertiaError([mechanism.source.problem(("joints", links[joints[-1]].joint.name), message, remedy)])


def _is_particle(part: Part) -> bool:
    """Whether the inertia of a part about its center is round-off of that of its mass at 1 m."""
    return float(np.trace(part.inertia)) <= ROUND_OFF * part.mass


def _is_moment(joint: Joint) -> list[bool]:
    """Whether each pivot of a joint is a moment of inertia rather than a mass."""
    return [coordinate.rotation for coordinate in joint.kind.coordinates]


def _massless(mechanism: Mechanism, link: Link) -> Problem:
    message = f"nothing that this joint moves has mass: '{link.joint.outboard}' is a massless chain end"
    remedy = "Give the part a mass, fix it to a part that has one, or give the joint a drive."
    if mechanism.closures:
        remedy += " In place of a massless rod between two parts of a loop, write the constraint 'distance'."
    return mechanism.source.problem(("joints", link.joint.name), message, remedy)


def _no_inertia(mechanism: Mechanism, link: Link) -> Problem:
    message = "this joint moves no inertia of its own: its coordinate has no equation of motion"
    remedy = (
        "Give the part that it moves a mass away from the axis, or an inertia about it (a thin rod has none about "
        "itself). Two joints with the same motion also need a mass between them. In a loop, 'cut: true' at "
        "another joint may help."
    )
    return mechanism.source.problem(("joints", link.joint.name), message, remedy)


@dataclass(frozen=True, eq=False)
class _CarriedInertia:
    """Parts that move together: `mass` in kg, `center` (3,) of mass in ground's frame in m, `trace` in kg·m².

    The trace is that of the inertia matrix about the center of mass.
    """

    mass: float
    center: Array
    trace: float

    def __add__(self, other: _CarriedInertia) -> _CarriedInertia:
        mass = self.mass + other.mass
        if mass == 0.0:
            return self
        arm = other.center - self.center
        share = other.mass / mass
        trace = self.trace + other.trace + 2.0 * self.mass * share * float(arm @ arm)
        return _CarriedInertia(mass, self.center + share * arm, trace)

    def moment_about(self, point: Array) -> float:
        """The trace of the inertia matrix about a point (3,), an upper bound of its moments of inertia, kg·m²."""
        arm = self.center - point
        return self.trace + 2.0 * self.mass * float(arm @ arm)
