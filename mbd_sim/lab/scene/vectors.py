"""Forces, couples and velocities of a bench that pages can show, as `Vectors` in ground's frame."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.lab.session.bench import Bench
from mbd_sim.mechanism.elements.actuators import LinePort
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.shapes import palette
from mbd_sim.pictures.shapes.joints import coordinate_frame, default_traces, driven_coordinates, weight
from mbd_sim.pictures.shapes.palette import Color

ARM = 0.25  # of a full couple: a full force at this distance, relative to the mechanism's size


@dataclass
class Vectors:
    """Pairs of a point (3,) and a vector (3,): those drawn as `straight` arrows, and those drawn as `turning` arcs."""

    straight: list[tuple[Array, Array]] = field(default_factory=list)
    turning: list[tuple[Array, Array]] = field(default_factory=list)

    def add(self, rotation: bool, point: Array, vector: Array) -> None:
        """Add an arc for a rotation, else an arrow."""
        (self.turning if rotation else self.straight).append((point, vector))


@dataclass(frozen=True)
class View:
    """What a check box of a page shows.

    `full` gives the magnitudes that arrows and arcs of full length stand for, for a mechanism of a size in m.
    """

    key: str
    label: str
    colors: tuple[Color, Color]  # on light and on dark ground
    read: Callable[[Bench], Vectors]
    full: Callable[[Mechanism, float], tuple[float, float]]


def reactions(bench: Bench) -> Vectors:
    """The force and the moment that each joint transmits to its child, at its point there."""
    simulation, found = bench.simulation, Vectors()
    for name, reaction in simulation.reactions().items():
        joint = simulation.live_mechanism.all_joints[name]
        frame = simulation.frame(joint.child)
        point = frame.position + frame.rotation @ joint.child_pose.position
        found.add(False, point, reaction.force.copy())
        found.add(True, point, reaction.moment.copy())
    return found


def efforts(bench: Bench) -> Vectors:
    """The efforts that are commanded, and those of actuators, as they act on the child or along a line."""
    simulation, found = bench.simulation, Vectors()
    mechanism = simulation.live_mechanism
    sums = dict(zip(simulation.coordinate_names, simulation.efforts.tolist(), strict=True))
    states = simulation.actuators() if mechanism.actuators else {}
    drives = {name: (joint, coordinate) for name, joint, coordinate in driven_coordinates(mechanism)}
    for joint in mechanism.joints.values():
        for name, coordinate in zip(joint.coordinate_names, joint.kind.coordinates, strict=True):
            at = [one for one, target in drives.items() if target == (joint, coordinate) and one in states]
            total = sums.get(name, 0.0) + sum(states[one].effort for one in at)
            part, pose = coordinate_frame(joint, coordinate)
            frame = simulation.frame(part)
            point, axis = frame.position + frame.rotation @ pose.position, frame.rotation @ pose.rotation[:, 2]
            found.add(coordinate.rotation, point, total * axis)
    for actuator in mechanism.actuators:
        if isinstance(actuator.port, LinePort):
            first, second = (_place(bench, end.part, end.point) for end in (actuator.port.first, actuator.port.second))
            along = (second - first) / (float(np.linalg.norm(second - first)) or 1.0)
            found.add(False, second, states[actuator.name].effort * along)
    return found


def velocities(bench: Bench) -> Vectors:
    """The velocities of the mass centers, and of the tips that leave traces."""
    simulation, found = bench.simulation, Vectors()
    mechanism = simulation.live_mechanism
    tips = default_traces(mechanism)
    for name, part in mechanism.parts.items():
        frame = simulation.frame(name)
        points = [part.center] if part.mass else []
        if name in tips and not (points and np.allclose(points[0], tips[name].point)):
            points.append(tips[name].point)
        for point in points:
            arm = frame.rotation @ point
            found.add(False, frame.position + arm, frame.velocity + np.cross(frame.angular_velocity, arm))
    return found


def _place(bench: Bench, part: str, point: Array) -> Array:
    frame = bench.simulation.frame(part)
    return np.asarray(frame.position + frame.rotation @ point)


def _loads(mechanism: Mechanism, size: float) -> tuple[float, float]:
    force = weight(mechanism, size)
    return force, ARM * force * size


def _speed(mechanism: Mechanism, size: float) -> tuple[float, float]:
    """The speed after a fall through the size of the mechanism, or without gravity its size in a second."""
    speed = math.sqrt(2.0 * float(np.linalg.norm(mechanism.gravity)) * size) or size
    return speed, 1.0


VIEWS = (
    View("efforts", "Efforts and torques", ((20, 150, 60), palette.COMMANDED), efforts, _loads),
    View("reactions", "Forces through joints", ((0, 120, 190), palette.REACTION), reactions, _loads),
    View("velocities", "Velocities", ((150, 60, 180), (206, 147, 255)), velocities, _speed),
)
