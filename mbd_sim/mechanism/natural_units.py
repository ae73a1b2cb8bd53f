"""The natural units of a mechanism: what its lengths, rates, masses and energies are compared with.

So the same motion is computed alike in mm and in km, in µs and in days.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mbd_sim.base.linear_algebra import added, norm
from mbd_sim.mechanism.mechanism import Mechanism

STEPS = 1000.0  # in the unit of time
# Lengths, times and masses are rounded to powers of this number, so that similar mechanisms have the same code: their
# unit is 1 m from 5 mm to 5 m, 1 s for steps from 0.1 ms to 0.1 s, and so on.
BASE, LENGTH, TIME = 1024.0, 0.16, 3.2
FALL = 0.125  # of g t²: the height of a fall in half of a time t


@dataclass(frozen=True)
class NaturalUnits:
    """What lengths in m, rates in 1/s and masses in kg of a mechanism are compared with: powers of 1024."""

    length: float
    rate: float
    mass: float

    @property
    def speed(self) -> float:
        """In m/s."""
        return self.length * self.rate

    @property
    def force(self) -> float:
        """In N."""
        return self.mass * self.speed * self.rate


def natural_units(mechanism: Mechanism, step: float) -> NaturalUnits:
    """The natural units of a mechanism; all are 1 for some 5 mm to 5 m, 0.1 ms to 0.1 s, and 30 g to 30 kg.

    :param step: in s.
    """
    length, rate = rounded(_length(mechanism, step) / LENGTH), 1.0 / rounded(STEPS * step / TIME)
    mass = added(part.mass + float(np.trace(part.inertia)) / length**2 for part in mechanism.parts.values())
    return NaturalUnits(length, rate, rounded(mass))


def coordinate_sizes(mechanism: Mechanism, step: float) -> list[float]:
    """A natural size of each undriven coordinate: 1 rad, or the size of the mechanism in m.

    :param step: in s.
    """
    length = _length(mechanism, step) or 1.0
    free = (joint for joint in mechanism.joints.values() if not joint.drive)
    return [1.0 if coordinate.rotation else length for joint in free for coordinate in joint.kind.coordinates]


def energy_size(mechanism: Mechanism, step: float) -> float:
    """A natural size of the potential energy in J, whose terms may cancel: the weight times the size of the mechanism.

    :param step: in s.
    """
    mass = added(part.mass for part in mechanism.parts.values())
    return mass * norm(mechanism.gravity) * _length(mechanism, step)


def rounded(value: float) -> float:
    """The power of 1024 that is nearest to a positive number; 1 for others."""
    return BASE ** round(math.log(value, BASE)) if math.isfinite(value) and value > 0.0 else 1.0


def _length(mechanism: Mechanism, step: float) -> float:
    """A length in m that is typical of a mechanism; 0 if nothing shows one."""
    poses = [pose for joint in mechanism.all_joints.values() for pose in (joint.parent_pose, joint.child_pose)]
    points = [*(pose.position for pose in poses), *(part.center for part in mechanism.parts.values())]
    points += [pose.position for part in mechanism.parts.values() for pose in part.points.values()]
    sizes = [norm(point) for point in points]
    if mass := added(part.mass for part in mechanism.parts.values()):  # the radius of gyration of all parts
        sizes.append(math.sqrt(added(float(np.trace(part.inertia)) for part in mechanism.parts.values()) / mass))
    if found := max(sizes, default=0.0):
        return found
    positions, speeds = list[float](), list[float]()
    for joint in mechanism.joints.values():
        for index, coordinate in enumerate(joint.kind.coordinates):
            if not coordinate.rotation and not joint.drive:
                positions.append(abs(float(joint.position[index])))
                speeds.append(abs(float(joint.velocity[index])))
    time = STEPS * step
    gravity = norm(mechanism.gravity)
    return max(positions, default=0.0) or max(speeds, default=0.0) * time or FALL * gravity * time**2
