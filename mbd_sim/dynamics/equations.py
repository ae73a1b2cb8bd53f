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


@dataclass(frozen=True, eq=False)
class Equations:
    """`rates(t, y, efforts)` gives y'; `settle(y)`, where there are quaternions, gives y with unit ones;
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

    :raises MechanismError: the mass matrix is singular at the start; the joints that move no inertia are named.
    """
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
    flat = [ca.vertcat(pose.position, ca.vec(pose.rotation)) for pose in poses]

    start = start_state(mechanism, places)
    _require_definite(mechanism, places, ca.Function("pivots", [y], [pivots]), start)
    return Equations(
        layout=places,
        rates=_function("rates", [t, y, efforts], [ca.densify(y_rates)]),
        energies=_function("energies", [t, y], [ca.densify(ca.vertcat(kinetic, potential))]),
        poses=_function("poses", [y], [ca.densify(ca.vertcat(*flat))]),
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


def _require_definite(mechanism: Mechanism, places: Layout, pivots: ca.Function, start: Array) -> None:
    values = np.array(pivots(start)).ravel()
    largest = float(np.max(values, initial=0.0))
    problems: list[Problem] = []
    for name, where in places.u.items():
        if np.any(~(values[where] > 1e-13 * largest)):
            message = "this joint moves no inertia: its coordinate has no equation of motion"
            remedy = "Give what it moves a mass away from the axis, or an inertia about it (a thin rod has none about itself)."
            problems.append(mechanism.source.problem(("joints", name), message, remedy))
    if problems:
        raise MechanismError(problems)
