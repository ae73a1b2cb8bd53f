"""The equations of motion of a mechanism, traced once into functions that the compiler turns into machine code.

The integrated state y is q (nq,), u (nv,), and three energies that the audit needs: the work of the applied forces,
the work of the drives, and the dissipated energy, in J.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.dynamics.articulated import accelerations
from mbd_sim.dynamics.forces import joint_loads
from mbd_sim.dynamics.kinematics import LinkMotion, link_motions, part_poses
from mbd_sim.dynamics.links import Layout, Link, layout, links
from mbd_sim.dynamics.spatial import constant
from mbd_sim.errors import MechanismError, Problem
from mbd_sim.mechanism.model import Array, Mechanism

AUDIT = ("work_applied", "work_drives", "dissipated")
ROUND_OFF = 1e-13  # of an inertia, what its computation may leave of a zero


@dataclass(frozen=True, eq=False)
class Equations:
    """What the compiler turns into machine code.

    `rates(t, y, efforts)` gives y'; `settle(y)`, where there are quaternions, gives y with unit ones;
    `energies(t, y)` gives T and V; `poses(y)` gives (12,) a part: position and rotation, column by column.
    """

    layout: Layout
    rates: ca.Function
    energies: ca.Function
    poses: ca.Function
    settle: ca.Function | None
    start: Array
    part_names: tuple[str, ...]


def derive(mechanism: Mechanism) -> Equations:
    """Trace the equations of a mechanism.

    :raises MechanismError: the mass matrix is singular at the start; the joints that move no inertia are named. Or
        a free joint names the part nearer to ground second.
    """
    _require_forward(mechanism)
    places, chain = layout(mechanism), links(mechanism)
    t, efforts = ca.SX.sym("t"), ca.SX.sym("e", places.nv)
    y = ca.SX.sym("y", places.nq + places.nv + len(AUDIT))
    q, u = y[: places.nq], y[places.nq : places.nq + places.nv]

    motions = link_motions(chain, q, u)
    loads = joint_loads(chain, q, u, efforts)
    u_rates, pivots = accelerations(chain, motions, loads.generalized, mechanism.gravity)
    audit_rates = ca.vertcat(loads.applied_power, ca.SX(1, 1), loads.dissipated_power)
    y_rates = ca.vertcat(_q_rates(chain, motions, places.nq), u_rates, audit_rates)

    poses = part_poses(chain, q)
    kinetic = _kinetic_energy(chain, motions)
    potential = loads.potential + _weight_potential(mechanism, chain, q)
    flat = ca.densify(ca.vertcat(*(ca.vertcat(pose.position, ca.vec(pose.rotation)) for pose in poses)))

    start = start_state(mechanism, places)
    pivots_at, poses_at = ca.Function("at", [y], [pivots, flat])(start)
    _require_definite(mechanism, chain, np.array(pivots_at).ravel(), np.array(poses_at).reshape(-1, 4, 3))
    return Equations(
        layout=places,
        rates=_function("rates", [t, y, efforts], [ca.densify(y_rates)]),
        energies=_function("energies", [t, y], [ca.densify(ca.vertcat(kinetic, potential))]),
        poses=_function("poses", [y], [flat]),
        settle=_settle(chain, y),
        start=start,
        part_names=tuple(link.joint.outboard for link in chain),
    )


def start_state(mechanism: Mechanism, places: Layout) -> Array:
    """Y at the start, from the joints' initial values."""
    y = np.zeros(places.nq + places.nv + len(AUDIT))
    for name, joint in mechanism.joints.items():
        y[places.q[name]] = joint.position
        y[places.nq :][places.u[name]] = joint.velocity
    return y


def _function(name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> ca.Function:
    return ca.Function(name, inputs, outputs, {"cse": True})


def _q_rates(chain: Sequence[Link], motions: Sequence[LinkMotion], nq: int) -> ca.SX:
    rates = ca.SX(nq, 1)
    for link, motion in zip(chain, motions, strict=True):
        rates[link.q] = motion.joint.q_rates
    return rates


def _kinetic_energy(chain: Sequence[Link], motions: Sequence[LinkMotion]) -> ca.SX:
    energy = ca.SX(1, 1)
    for link, motion in zip(chain, motions, strict=True):
        energy += 0.5 * ca.dot(motion.velocity, constant(link.inertia) @ motion.velocity)
    return energy


def _weight_potential(mechanism: Mechanism, chain: Sequence[Link], q: ca.SX) -> ca.SX:
    """-Σ m g·r of the mass centres, zero with all of them at ground's origin."""
    potential = ca.SX(1, 1)
    for link, pose in zip(chain, part_poses(chain, q), strict=True):
        part = mechanism.parts[link.joint.outboard]
        center = pose.position + pose.rotation @ constant(part.center)
        potential -= part.mass * ca.dot(constant(mechanism.gravity), center)
    return potential


def _settle(chain: Sequence[Link], y: ca.SX) -> ca.Function | None:
    settled = ca.SX(y)
    quaternions = [link.q.start + link.type.quaternion for link in chain if link.type.quaternion is not None]
    for first in quaternions:
        p = y[first : first + 4]
        settled[first : first + 4] = p / ca.sqrt(ca.dot(p, p))
    return _function("settle", [y], [settled]) if quaternions else None


def _require_forward(mechanism: Mechanism) -> None:
    """Refuse free joints walked from child to parent: their coordinates place the child, seen from the parent."""
    problems = [
        mechanism.source.problem(
            ("joints", name, "between"),
            f"a free joint names the part nearer to ground first, which is '{joint.child}'",
            "Swap the two; position, orientation and velocities are then those of the other part seen from it.",
        )
        for name, joint in mechanism.joints.items()
        if joint.type == "free" and joint.reversed
    ]
    if problems:
        raise MechanismError(problems)


def _require_definite(mechanism: Mechanism, chain: Sequence[Link], pivots: Array, poses: Array) -> None:
    """Refuse a singular mass matrix, and name the joints to blame.

    A pivot is what a joint moves when all joints beyond it move freely. It counts as zero where it is no more than
    round-off of what the joint carries, so that neither units nor the size of other parts matter.

    :param pivots: (nv,), each joint's in the order of its type's `turns`.
    :param poses: (links, 4, 3) position and axes of each link's part in ground's frame.
    """
    carried = [_Load(0.0, np.zeros(3), 0.0)] * len(chain)
    spoiled = [False] * len(chain)
    problems: list[Problem] = []
    for index in reversed(range(len(chain))):
        link, position, rotation = chain[index], poses[index, 0], poses[index, 1:].T
        part = mechanism.parts[link.joint.outboard]
        carried[index] += _Load(part.mass, position + rotation @ part.center, float(np.trace(part.inertia)))
        if not spoiled[index]:
            origin = position - rotation @ link.part.rotation.T @ link.part.position
            scale = np.where(link.type.turns, carried[index].moment_about(origin), carried[index].mass)
            spoiled[index] = bool(np.any(~(pivots[link.u] > ROUND_OFF * scale)))
            if spoiled[index]:
                message = "this joint moves no inertia of its own: its coordinate has no equation of motion"
                remedy = (
                    "Give what it moves a mass away from the axis, or an inertia about it (a thin rod has none about "
                    "itself); between two joints that move alike there must be a mass as well."
                )
                problems.append(mechanism.source.problem(("joints", link.joint.name), message, remedy))
        if link.parent >= 0:
            carried[link.parent] += carried[index]
            spoiled[link.parent] |= spoiled[index]
    if problems:
        raise MechanismError(sorted(problems, key=lambda problem: problem.line))


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
