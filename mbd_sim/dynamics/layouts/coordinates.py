"""Where the coordinates and speeds of each joint are in q and u, and which energies the state has for the audit."""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.base.short_repr import short_repr
from mbd_sim.mechanism.contents import commanded_drives, has_one_sided
from mbd_sim.mechanism.elements.joint_types import STATES
from mbd_sim.mechanism.mechanism import Mechanism


@dataclass(frozen=True, eq=False)
class CoordinateLayout:
    """The slices of each joint's coordinates in q (nq,) and speeds in u (nv,), in declared order.

    The states of commanded `drives`, by the names of their joints, are the last coordinates in q.
    """

    q: dict[str, slice]
    u: dict[str, slice]
    nq: int
    nv: int
    drives: dict[str, slice]

    __repr__ = short_repr


def coordinate_layout(mechanism: Mechanism) -> CoordinateLayout:
    """Assign slices of q and u to the joints of the tree; driven joints get empty ones."""
    q: dict[str, slice] = {}
    u: dict[str, slice] = {}
    nq = nv = 0
    for joint in mechanism.joints.values():
        joint_nq, joint_nv = (0, 0) if joint.drive else (joint.kind.nq, joint.kind.nv)
        q[joint.name], u[joint.name] = slice(nq, nq + joint_nq), slice(nv, nv + joint_nv)
        nq, nv = nq + joint_nq, nv + joint_nv
    drives = {name: slice(nq + STATES * i, nq + STATES * (i + 1)) for i, name in enumerate(commanded_drives(mechanism))}
    return CoordinateLayout(q, u, nq + STATES * len(drives), nv, drives)


AUDIT_STATES = ("work_applied", "work_drives", "dissipated")  # J, at the end of the integrated state y in this order
LOSS_STATES = ("impact_loss", "friction_loss")  # J, parts of the dissipated energy, before them if there are contacts


def audit_states(mechanism: Mechanism) -> tuple[str, ...]:
    """The energies in J that are integrated with the state: its last components, in their order."""
    return (*LOSS_STATES, *AUDIT_STATES) if has_one_sided(mechanism) else AUDIT_STATES
