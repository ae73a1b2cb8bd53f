"""Constraints as relative velocities that must be zero, in numpy, for Kane's equations.

The velocities of each constraint are expressed in the axes of the part that carries it. They are jets of which only the
value and the first derivative are used. The rows may be redundant, and their scales may differ from the engine's.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from mbd_sim.mechanism.elements import constraints as c
from test.oracles.jets import Jet, expression_jet

GROUND = "ground"


def _frame(moving, part, point, axes=None):
    """The jets of a point (3,) of a part and of axes (3, 3) there, in ground's frame."""
    axes = np.eye(3) if axes is None else axes
    if part == GROUND:
        return Jet(point), Jet(axes)
    motion = moving[part]
    return motion.origin + motion.rotation @ Jet(point), motion.rotation @ Jet(axes)


class Relative:
    """The motion of a frame relative to a base frame, in the base's axes: `position`, `rotation` and `omega`."""

    def __init__(self, base, frame):
        to_base = base[1].transposed
        self.position, self.rotation = to_base @ (frame[0] - base[0]), to_base @ frame[1]
        r, r1, r2 = self.rotation.d
        self.omega = Jet(_vector(r1 @ r.T), _vector(r2 @ r.T))


def _vector(spin):
    return 0.5 * np.array([spin[2, 1] - spin[1, 2], spin[0, 2] - spin[2, 0], spin[1, 0] - spin[0, 1]])


def _perpendiculars(axis):
    """Two unit vectors (2, 3) perpendicular to an axis."""
    return np.linalg.svd(axis[None, :])[2][1:]


def _loop(joint, moving):
    base = _frame(moving, joint.parent, joint.parent_pose.position, joint.parent_pose.rotation)
    frame = _frame(moving, joint.child, joint.child_pose.position, joint.child_pose.rotation)
    relative = Relative(base, frame)
    velocity, omega, axis = relative.position.rate, relative.omega, joint.axis
    match joint.type:
        case "spherical":
            return [velocity]
        case "universal":
            normal = Jet(axis).cross(relative.rotation @ joint.second)
            return [velocity, normal.dot(omega)]
        case "revolute":
            return [velocity, Jet(_perpendiculars(axis)) @ omega]
        case "fixed":
            return [velocity, omega]
        case "prismatic":
            return [Jet(_perpendiculars(axis)) @ velocity, omega]
        case "cylindrical":
            return [Jet(_perpendiculars(axis)) @ velocity, Jet(_perpendiculars(axis)) @ omega]
        case "screw":
            advance = Jet(axis).dot(velocity) - Jet(axis).dot(omega) * (joint.lead / (2.0 * np.pi))
            return [Jet(_perpendiculars(axis)) @ velocity, Jet(_perpendiculars(axis)) @ omega, advance]
        case "planar":
            return [Jet(axis).dot(velocity), Jet(_perpendiculars(axis)) @ omega]
    raise AssertionError(joint.type)


def _relative(moving, base, place, axes=None):
    return Relative(_frame(moving, base.part, base.point, axes), _frame(moving, place.part, place.point))


def _length(moving, points):
    frames = [_frame(moving, at.part, at.point)[0] for at in points]
    return sum((other - one).norm for one, other in pairwise(frames))


def constrained_velocities(mechanism, moving, coordinates, t):
    """The velocities that the loops and constraints keep at zero, as jets of any size.

    :param coordinates: the jets of all joint coordinates, by name.
    """
    time = Jet(t, 1.0)
    found = [row for joint in mechanism.closing.values() for row in _loop(joint, moving)]
    for record in mechanism.constraints:
        match record:
            case c.Distance():
                found.append(
                    (_length(moving, (record.first, record.second)) - expression_jet(record.length, t=time)).rate
                )
            case c.Cable():
                found.append((_length(moving, record.points) - expression_jet(record.length, t=time)).rate)
            case c.Flat():
                found.append(Jet(record.normals) @ _relative(moving, record.base, record.point).position.rate)
            case c.Surface():
                place = _relative(moving, record.base, record.point, record.axes).position
                names = dict(zip("xyz", (place[0], place[1], place[2]), strict=True))
                found += [expression_jet(equation, t=time, **names).rate for equation in record.equations]
            case c.Coupling():
                named = {name.written: coordinates[name.coordinate] for name in record.value.state}
                total = -expression_jet(record.value, t=time, **named)
                for name, factor in record.factors.items():
                    total = total + coordinates[name] * factor
                found.append(total.rate)
            case c.Rolling():
                found.append(_slip(record, moving))
            case c.KnifeEdge():
                relative = _relative(moving, record.plane, record.point)
                sideways = Jet(record.normal).cross(relative.rotation @ record.direction)
                found.append(sideways.dot(relative.position.rate))
            case _:
                raise AssertionError(record)
    return found


def _slip(record, moving):
    """The velocity (3,) of the wheel's contact point relative to the plane."""
    relative, normal = _relative(moving, record.plane, record.center), Jet(record.normal)
    arm = normal * -record.radius
    if record.axis is not None:
        axis = relative.rotation @ record.axis
        steepest = normal - axis * axis.dot(normal)
        arm = steepest / steepest.norm * -record.radius
    return relative.position.rate + relative.omega.cross(arm)
