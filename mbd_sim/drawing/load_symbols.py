"""Force elements: springs, dampers and rods between points, and the arrows of applied forces and couples."""

from __future__ import annotations

from collections.abc import Mapping
from typing import assert_never

import numpy as np

from mbd_sim.appearance.drives import has_cylinder
from mbd_sim.appearance.palette import DISSIPATED
from mbd_sim.drawing.ground_symbols import wall
from mbd_sim.drawing.joint_symbols import turning_arrow
from mbd_sim.drawing.placed_joint import middle
from mbd_sim.drawing.projection import Page
from mbd_sim.drawing.rope_symbols import rope_paths
from mbd_sim.drawing.sheet import BODIES, MARKS, SheetPath, arrow_head, outline_color
from mbd_sim.drawing.spring_symbols import link, spring_and_damper
from mbd_sim.errors import InputError
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import unit_or_zero
from mbd_sim.mechanism.actuators import LinePort, line_ports
from mbd_sim.mechanism.constraints import Distance
from mbd_sim.mechanism.force_elements import AppliedForce, Damper, Spring
from mbd_sim.mechanism.records import GROUND, Attachment, Mechanism
from mbd_sim.mechanism.state_numbers import value_at

LENGTH = 46.0  # pt, of the arrow of any force
FORCE = outline_color(DISSIPATED)
TIMES = (0.0, 0.05, 0.1, 0.25, 0.5, 1.0)  # s; a force is drawn as it is at the first of these at which it is not zero

Connector = Spring | Damper | Distance | LinePort


def connectors_of(mechanism: Mechanism) -> list[Connector]:
    """The force elements, constraints and actuators that act between two points."""
    distances = [constraint for constraint in mechanism.constraints if isinstance(constraint, Distance)]
    return [*mechanism.two_point_elements, *distances, *line_ports(mechanism).values()]


def two_point_paths(page: Page, mechanism: Mechanism, poses: Mapping[str, Pose]) -> list[SheetPath]:
    """Springs, dampers, cylinders, massless rods that keep a distance, and ropes."""
    paths: list[SheetPath] = []
    for element in connectors_of(mechanism):
        first, second = (point_of(poses, attachment) for attachment in (element.first, element.second))
        depth = page.depth((first + second) / 2.0)
        ends = page.project(first), page.project(second)
        elastic, damped = _elastic_and_damped(element)
        if elastic or damped:
            paths += spring_and_damper(*ends, elastic, damped, BODIES, depth)
        elif isinstance(element, Distance) and element.bound == "at_most":
            paths += rope_paths(page, mechanism, np.array([first, second]), element.length)
        else:
            paths += link(*ends, BODIES, depth)
        along = unit_or_zero(ends[1] - ends[0])
        for attachment, end, away in ((element.first, ends[0], -along), (element.second, ends[1], along)):
            paths += wall(end, away) if attachment.part == GROUND and along.any() else []
    return paths


def _elastic_and_damped(element: Connector) -> tuple[bool, bool]:
    match element:
        case Spring() | Damper():
            return element.elastic, has_cylinder(element)
        case LinePort():  # a cylinder
            return False, True
        case Distance():
            return False, False
        case _:
            assert_never(element)


def force_paths(page: Page, mechanism: Mechanism, poses: Mapping[str, Pose]) -> list[SheetPath]:
    """Arrows of the applied forces and couples, in the direction they have at the start."""
    paths: list[SheetPath] = []
    for element in mechanism.applied:
        pose = poses[element.at.part]
        axes = poses[element.axes_of].rotation @ element.axes if element.following else element.axes
        vector = axes @ _first_vector(mechanism, element)
        if not vector.any():
            continue
        center = pose.position + pose.rotation @ middle(mechanism.parts[element.at.part])
        if element.couple:
            paths += turning_arrow(page, center, vector, 24.0, FORCE)
            continue
        along = unit_or_zero(page.direction(unit_or_zero(vector)))
        start = page.project(point_of(poses, element.at))
        if along @ (page.project(center) - start) > 1e-9:  # the force pushes: the tip is at the point
            start = start - (LENGTH + 6.0) * along
        start = start + 3.0 * along
        tip = start + LENGTH * along
        paths += [
            SheetPath(np.array([start, tip - 5.0 * along]), edge=FORCE, width=1.9, layer=MARKS),
            arrow_head(tip, along, FORCE, 9.0),
        ]
    return paths


def point_of(poses: Mapping[str, Pose], at: Attachment) -> Array:
    """A point of a part in ground's frame, (3,)."""
    return at.point if at.part == GROUND else poses[at.part].position + poses[at.part].rotation @ at.point


def _first_vector(mechanism: Mechanism, element: AppliedForce) -> Array:
    """The value (3,) of a force in the start state, at the first of `TIMES` at which it is not zero, or zero."""
    moving = [joint for joint in mechanism.joints.values() if not joint.drive]
    start = np.concatenate([np.zeros(0), *(joint.position for joint in moving), *(joint.velocity for joint in moving)])
    for time in TIMES:
        try:
            vector = np.array([value_at(mechanism, expression, time, start) for expression in element.vector])
        except InputError:
            continue
        if vector.any():
            return vector
    return np.zeros(3)
