"""Mass, mass center and inertia of bodies and of composites (Huston & Liu, ch. 7), and numbers at a state.

An inertia is a symmetric matrix (3, 3) in kg·m² about the mass center: I = ∫ (r·r 1 - r rᵀ) dm, so its products
are I_xy = -∫ x y dm.

The numbers that the names in an expression stand for at a state are for messages and pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.batch import fsum
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.linear_algebra import product
from mbd_sim.mechanism.contents import commanded_drives
from mbd_sim.mechanism.elements.joint_types import STATES, CommandedDrive
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import TIME, StateName, TimeExpression


@dataclass(frozen=True, eq=False)
class MassProperties:
    """`mass` in kg, `center` (3,) in m, `inertia` (3, 3) in kg·m² about `center`."""

    mass: float
    center: Array
    inertia: Array

    def scaled(self, factor: float) -> MassProperties:
        """The properties of the body with `factor` times the mass."""
        return MassProperties(self.mass * factor, self.center, self.inertia * factor)

    def placed(self, pose: Pose) -> MassProperties:
        """These properties in the outer frame of `pose`."""
        center = pose.position + product(pose.rotation, self.center)
        return MassProperties(self.mass, center, product(product(pose.rotation, self.inertia), pose.rotation.T))

    def about(self, point: Array) -> Array:
        """The inertia (3, 3) about another point: the parallel axis theorem (Huston & Liu, sec. 7.6)."""
        k = rot.skew(self.center - point)
        inertia: Array = self.inertia - self.mass * product(k, k)
        return inertia


def composite(bodies: Sequence[MassProperties]) -> MassProperties:
    """Several bodies as one; holes have negative mass.

    :raises InputError: the holes remove all mass.
    """
    if not any(body.mass for body in bodies):
        return MassProperties(0.0, np.zeros(3), np.zeros((3, 3)))
    mass = fsum([body.mass for body in bodies])
    if mass <= 1e-12 * fsum([abs(body.mass) for body in bodies]):
        raise InputError(f"the holes remove all the mass: {mass:g} kg is left", "Make them smaller or lighter.")
    center = sum((body.mass * body.center for body in bodies), np.zeros(3)) / mass
    inertia = sum((body.about(center) for body in bodies), np.zeros((3, 3)))
    return MassProperties(mass, center, inertia)


def inertia_defect(inertia: Array) -> str | None:
    """Why no rigid body has this inertia (3, 3), or None: moments must be ≥ 0 and satisfy the triangle inequality."""
    if not np.all(np.isfinite(inertia)):
        return None  # the parameters that cause this are reported
    moments = np.linalg.eigvalsh(inertia)
    slack = 1e-9 * np.maximum(np.max(np.abs(moments)), 1e-300)
    defect = None
    if moments[0] < -slack:
        defect = "has a negative principal moment"
    elif moments[0] + moments[1] < moments[2] - slack:
        defect = "violates the triangle inequality: the largest principal moment exceeds the sum of the others"
    if defect is None:
        return None
    return f"{defect} (principal moments {', '.join(f'{moment:.6g}' for moment in moments)} kg·m²)"


DIFFERENCE = 1e-6  # s, for the speeds of driven joints


def state_numbers(mechanism: Mechanism, expression: TimeExpression, time: float, y: Array) -> dict[str, float]:
    """The time and the coordinates and speeds in an expression, by the names that it uses.

    :param y: the state of the mechanism, which begins with its coordinates and speeds.
    """
    found = {TIME: time} if TIME in expression.variables else {}
    for name in expression.state:
        found[name.written] = _number(mechanism, name, time, y)
    return found


def _number(mechanism: Mechanism, name: StateName, time: float, y: Array) -> float:
    moving = [joint for joint in mechanism.joints.values() if not joint.drive]
    owner = next((joint for joint in mechanism.joints.values() if name.coordinate in joint.motion_names), None)
    if owner is None:
        return float("nan")
    index = owner.motion_names.index(name.coordinate)
    drives = list(commanded_drives(mechanism))
    coordinates = sum(joint.kind.nq for joint in moving)
    if isinstance(owner.drive, CommandedDrive):
        return float(y[coordinates + STATES * drives.index(owner.name) + name.speed])
    if owner.drive:
        return _driven(owner.drive[index], name.speed, time)
    before = moving[: moving.index(owner)]
    if name.speed:
        start = coordinates + STATES * len(drives) + sum(joint.kind.nv for joint in before)
    else:
        start = sum(joint.kind.nq for joint in before)
    return float(y[start + index])


def _driven(drive: TimeExpression, speed: bool, time: float) -> float:
    try:
        if not speed:
            return drive.at(time)
        return (drive.at(time + DIFFERENCE) - drive.at(time - DIFFERENCE)) / (2.0 * DIFFERENCE)
    except InputError:
        return float("nan")


def value_at(mechanism: Mechanism, expression: TimeExpression, time: float, y: Array) -> float:
    """The value of an expression of the time and the state.

    :raises InputError: it has no finite value.
    """
    return expression.value(state_numbers(mechanism, expression, time, y))
