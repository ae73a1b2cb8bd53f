"""The equations of motion of a mechanism, traced once into functions that the compiler turns into machine code.

The integrated state y is q (nq,), u (nv,), and three energies that the audit needs: the work of the applied forces,
the work of the drives, and the dissipated energy, in J.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.dynamics.articulated import Accelerations, accelerations
from mbd_sim.dynamics.definite import require_definite
from mbd_sim.dynamics.elements import element_loads, require_lines
from mbd_sim.dynamics.forces import joint_loads
from mbd_sim.dynamics.kinematics import LinkMotion, WorldPose, link_motions, part_poses
from mbd_sim.dynamics.links import Layout, Link, layout, links
from mbd_sim.dynamics.spatial import constant
from mbd_sim.dynamics.time import require_smooth, time_functions
from mbd_sim.mechanism.model import Array, Mechanism

AUDIT = ("work_applied", "work_drives", "dissipated")


@dataclass(frozen=True, eq=False)
class Equations:
    """What the compiler turns into machine code.

    `rates(t, y, efforts)` gives y'; `settle(y)`, where there are quaternions, gives y with unit ones;
    `energies(t, y)` gives T and V; `poses(t, y)` gives (12,) a part: position and rotation, column by column;
    `drives(t, y, efforts)` gives the coordinates (n,) of driven joints in declared order, their speeds, and the
    forces that the drives exert.
    """

    layout: Layout
    rates: ca.Function
    energies: ca.Function
    poses: ca.Function
    drives: ca.Function
    settle: ca.Function | None
    start: Array
    part_names: tuple[str, ...]


def derive(mechanism: Mechanism) -> Equations:
    """Trace the equations of a mechanism.

    :raises MechanismError: the mass matrix is singular at the start, a spring has no direction there, or a drive no
        velocity or acceleration; the joints and springs are named.
    """
    require_smooth(mechanism)
    places, chain = layout(mechanism), links(mechanism)
    t, efforts = ca.SX.sym("t"), ca.SX.sym("e", places.nv)
    y = ca.SX.sym("y", places.nq + places.nv + len(AUDIT))
    q, u = y[: places.nq], y[places.nq : places.nq + places.nv]

    motions = link_motions(chain, t, q, u)
    poses = part_poses(chain, t, q)
    loads = joint_loads(chain, q, u, efforts)
    elements = element_loads(mechanism, chain, motions, poses, t)
    moving = accelerations(chain, motions, loads.generalized, elements.wrenches, mechanism.gravity)
    drives = _drives(mechanism, chain, motions, moving, t)
    audit_rates = ca.vertcat(
        loads.applied_power + elements.applied_power,
        ca.dot(drives[:, 1], drives[:, 2]),
        loads.dissipated_power + elements.dissipated_power,
    )
    y_rates = ca.vertcat(_q_rates(chain, motions, places.nq), moving.u_rates, audit_rates)

    kinetic = _kinetic_energy(chain, motions)
    potential = loads.potential + elements.potential + _weight_potential(mechanism, chain, poses)
    flat = ca.densify(ca.vertcat(*(ca.vertcat(pose.position, ca.vec(pose.rotation)) for pose in poses)))

    start = start_state(mechanism, places)
    pivots, poses_at, lengths = ca.Function("at", [t, y], [moving.pivots, flat, elements.lengths])(0.0, start)
    require_lines(mechanism, np.array(lengths).ravel())
    require_definite(mechanism, chain, np.array(pivots).ravel(), np.array(poses_at).reshape(-1, 4, 3))
    return Equations(
        layout=places,
        rates=_function("rates", [t, y, efforts], [ca.densify(y_rates)]),
        energies=_function("energies", [t, y], [ca.densify(ca.vertcat(kinetic, potential))]),
        poses=_function("poses", [t, y], [flat]),
        drives=_function("drives", [t, y, efforts], [ca.densify(ca.vec(drives))]),
        settle=_settle(chain, y),
        start=start,
        part_names=tuple(link.joint.outboard for link in chain),
    )


def start_state(mechanism: Mechanism, places: Layout) -> Array:
    """y at the start, from the joints' initial values."""
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


def _drives(
    mechanism: Mechanism, chain: Sequence[Link], motions: Sequence[LinkMotion], moving: Accelerations, t: ca.SX
) -> ca.SX:
    """(n, 3): coordinates, speeds and forces of the drives, in declared order."""
    driven = {
        link.joint.name: ca.horzcat(
            time_functions(link.joint.drive, t)[0], motion.joint.drive.speeds, moving.drive_forces[link.joint.name]
        )
        for link, motion in zip(chain, motions, strict=True)
        if motion.joint.drive is not None
    }
    return ca.vertcat(ca.SX(0, 3), *(driven[name] for name in mechanism.joints if name in driven))


def _kinetic_energy(chain: Sequence[Link], motions: Sequence[LinkMotion]) -> ca.SX:
    energy = ca.SX(1, 1)
    for link, motion in zip(chain, motions, strict=True):
        energy += 0.5 * ca.dot(motion.velocity, constant(link.inertia) @ motion.velocity)
    return energy


def _weight_potential(mechanism: Mechanism, chain: Sequence[Link], poses: Sequence[WorldPose]) -> ca.SX:
    """-Σ m g·r of the mass centres, zero with all of them at ground's origin."""
    potential = ca.SX(1, 1)
    for link, pose in zip(chain, poses, strict=True):
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
