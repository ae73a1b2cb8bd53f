"""What the errors of a state are compared with besides its components: numbers with the units of the mechanism.

An angle is compared with 1 rad, a length with the size of the mechanism, a speed with these in a thousand steps, and an
energy with that of the mass at such a speed. So the same motion is computed alike in mm and in km, in µs and in days.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mbd_sim.dynamics.actuator_layout import PRESSURES, ActuatorLayout
from mbd_sim.dynamics.coordinate_layout import CoordinateLayout
from mbd_sim.integrators.estimate import UNIT_OF_TIME
from mbd_sim.mechanism.actuators import Actuator
from mbd_sim.mechanism.cylinders import Cylinder
from mbd_sim.mechanism.drives import STATES
from mbd_sim.mechanism.records import Mechanism

# Lengths and masses are rounded to powers of this number, so that mechanisms of similar sizes have the same code, such
# as those from 5 mm to 5 m, or from 5 µm to 5 mm.
BASE, MIDDLE = 1024.0, 0.16


class Scale(NamedTuple):
    """The scale of a component of a state: `size` divided by `times` powers of the unit of time."""

    size: float = 1.0
    times: int = 0


def state_scales(
    mechanism: Mechanism, layout: CoordinateLayout, actuators: ActuatorLayout, step: float, core: int, size: int
) -> tuple[Scale, ...]:
    """The scales (size,) of the components of y.

    :param step: in s.
    :param core: the number of components before the energies.
    """
    length, mass = _rounded(_length(mechanism, step) / MIDDLE), 0.0
    q, u = list[Scale](), list[Scale]()
    for joint in mechanism.joints.values():
        lengths = [1.0 if coordinate.rotation else length for coordinate in joint.kind.coordinates]
        if joint.drive:
            continue
        u += [Scale(value, 1) for value in lengths]
        plain = joint.kind.nv if joint.kind.quaternion is None else joint.kind.quaternion
        q += [Scale(value) for value in lengths[:plain]] + [Scale()] * (joint.kind.nq - plain)
    for name in layout.drives:
        rotation = mechanism.joints[name].kind.coordinates[0].rotation
        q += [Scale(1.0 if rotation else length, times) for times in range(STATES)]
    for part in mechanism.parts.values():
        mass += part.mass + float(np.trace(part.inertia)) / length**2
    energy = _rounded(mass) * length**2
    result = [*q, *u, *[Scale()] * (core - len(q) - len(u)), *[Scale(energy, 2)] * (size - core)]
    for actuator, slots in zip(mechanism.actuators, actuators.slots, strict=True):
        for name, index in slots.states.items():
            if index < core:
                result[index] = _of_actuator(actuator, name)
    return tuple(result)


def _of_actuator(actuator: Actuator, state: str) -> Scale:
    """The scale of a pressure, of the integral of a servo, or of a current, which is compared with 1 A."""
    if state in PRESSURES and isinstance(actuator.motor, Cylinder):
        return Scale(_rounded(actuator.motor.supply))
    return Scale(_rounded(actuator.output_limit)) if state == "integral" else Scale()


def _rounded(value: float) -> float:
    return BASE ** round(math.log(value, BASE)) if math.isfinite(value) and value > 0.0 else 1.0


def _length(mechanism: Mechanism, step: float) -> float:
    """A length in m that is typical of a mechanism; 0 if nothing shows one."""
    poses = [pose for joint in mechanism.all_joints.values() for pose in (joint.parent_pose, joint.child_pose)]
    points = [*(pose.position for pose in poses), *(part.center for part in mechanism.parts.values())]
    points += [pose.position for part in mechanism.parts.values() for pose in part.points.values()]
    if found := max((float(np.linalg.norm(point)) for point in points), default=0.0):
        return found
    bodies = [part for part in mechanism.parts.values() if part.mass > 0.0]
    if found := max((math.sqrt(float(np.trace(part.inertia)) / part.mass) for part in bodies), default=0.0):
        return found
    positions, speeds = list[float](), list[float]()
    for joint in mechanism.joints.values():
        for index, coordinate in enumerate(joint.kind.coordinates):
            if not coordinate.rotation and not joint.drive:
                positions.append(abs(float(joint.position[index])))
                speeds.append(abs(float(joint.velocity[index])))
    time = UNIT_OF_TIME * step
    gravity = float(np.linalg.norm(mechanism.gravity))
    return max(positions, default=0.0) or max(speeds, default=0.0) * time or gravity * time**2
