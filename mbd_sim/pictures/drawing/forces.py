"""Forces on the sheet: springs, dampers and rods between points, motors, bushings, and arrows.

Arrows show applied forces and couples, and efforts on joints.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import assert_never

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import unit_or_zero
from mbd_sim.mechanism.contents import line_ports
from mbd_sim.mechanism.elements.actuators import LinePort
from mbd_sim.mechanism.elements.constraints import Distance
from mbd_sim.mechanism.elements.forces import AppliedEffort, AppliedForce, AppliedPotential, Bushing, Damper, Spring
from mbd_sim.mechanism.elements.parts import GROUND, Attachment
from mbd_sim.mechanism.mass_properties import value_at
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.drawing.joints import turning_arrow
from mbd_sim.pictures.drawing.sheet import (
    BODIES,
    FRONT,
    INK,
    LINE,
    MARKS,
    STEEL,
    WHITE,
    ScaledView,
    SheetPath,
    arc,
    arrow_head,
    outline_color,
)
from mbd_sim.pictures.drawing.symbols import link, middle, rope_paths, spring_and_damper, wall
from mbd_sim.pictures.shapes.extent import frame_of
from mbd_sim.pictures.shapes.joints import coordinate_frame, driven_coordinates, has_cylinder
from mbd_sim.pictures.shapes.palette import DISSIPATED

LENGTH = 46.0  # pt, of the arrow of any force
FORCE = outline_color(DISSIPATED)
TIMES = (0.0, 0.05, 0.1, 0.25, 0.5, 1.0)  # s; a force is drawn as it is at the first of these at which it is not zero

Connector = Spring | Damper | Distance | LinePort


def connectors_of(mechanism: Mechanism) -> list[Connector]:
    """The force elements, constraints and actuators that act between two points."""
    distances = [constraint for constraint in mechanism.constraints if isinstance(constraint, Distance)]
    return [*mechanism.two_point_elements, *distances, *line_ports(mechanism).values()]


def two_point_paths(page: ScaledView, mechanism: Mechanism, poses: Mapping[str, Pose]) -> list[SheetPath]:
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


def force_paths(page: ScaledView, mechanism: Mechanism, poses: Mapping[str, Pose]) -> list[SheetPath]:
    """Arrows of the applied forces and couples, in the direction they have at the start, and rings of bushings."""
    paths: list[SheetPath] = []
    for element in mechanism.force_elements:
        match element:
            case AppliedForce():
                paths += _applied(page, mechanism, poses, element)
            case Bushing(in_joint=False):
                paths += _bushing(page.project(point_of(poses, element.first)))
            case Bushing():
                pass  # the spring of a joint, which is drawn
            case Spring() | Damper():
                pass  # drawn by `two_point_paths`
            case AppliedEffort():
                pass  # drawn by `drive_paths`
            case AppliedPotential():
                pass  # has no place
            case _:
                assert_never(element)
    return paths


def _applied(
    page: ScaledView, mechanism: Mechanism, poses: Mapping[str, Pose], element: AppliedForce
) -> list[SheetPath]:
    pose = poses[element.at.part]
    axes = poses[element.axes_of].rotation @ element.axes if element.following else element.axes
    vector = axes @ _first_vector(mechanism, element)
    if not vector.any():
        return []
    center = pose.position + pose.rotation @ middle(mechanism.parts[element.at.part])
    if element.couple:
        return turning_arrow(page, center, vector, 24.0, FORCE)
    along = unit_or_zero(page.direction(unit_or_zero(vector)))
    start = page.project(point_of(poses, element.at))
    if along @ (page.project(center) - start) > 1e-9:  # the force pushes: the tip is at the point
        start = start - (LENGTH + 6.0) * along
    start = start + 3.0 * along
    tip = start + LENGTH * along
    return [
        SheetPath(np.array([start, tip - 5.0 * along]), edge=FORCE, width=1.9, layer=MARKS),
        arrow_head(tip, along, FORCE, 9.0),
    ]


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


MOTOR, RUBBER = 8.5, 8.0  # pt, radii
AWAY = np.array([-19.0, 19.0])  # pt, from a joint to its motor
LETTER = np.array([(-3.6, -3.4), (-3.6, 3.6), (0.0, -0.8), (3.6, 3.6), (3.6, -3.4)])  # pt, an M
TURN = -1.3  # rad, from a motor of a joint to the next one
ARROW = 26.0  # pt, of an effort along a line


def drive_paths(page: ScaledView, mechanism: Mechanism, poses: Mapping[str, Pose]) -> list[SheetPath]:
    """A circle with an M beside each joint with a motor, an arrow at each other effort."""
    motors, paths = {actuator.name for actuator in mechanism.actuators}, list[SheetPath]()
    drawn: Counter[tuple[str, bool]] = Counter()  # motors and efforts at each joint
    for name, joint, coordinate in driven_coordinates(mechanism):
        frame = frame_of(poses, *coordinate_frame(joint, coordinate))
        axis, place = frame.rotation[:, 2], frame.position
        if not joint.kind.axial:  # its two frames may be far apart
            place = frame_of(poses, joint.child, joint.child_pose).position
        at, is_motor = page.project(place), name in motors
        others = drawn[joint.name, is_motor]
        drawn[joint.name, is_motor] += 1
        paths += _motor(at, others) if is_motor else _effort(page, at, axis, coordinate.rotation, others)
    return paths


def _motor(at: Array, others: int) -> list[SheetPath]:
    """A motor beside a joint that has others already."""
    turn = TURN * others
    away = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ AWAY
    center = at + away
    start, stop = at + 7.0 * unit_or_zero(away), center - MOTOR * unit_or_zero(away)
    return [
        SheetPath(np.array([start, stop]), width=2.0, layer=MARKS),
        SheetPath(arc(center, MOTOR), fill=WHITE, closed=True, layer=MARKS),
        SheetPath(center + LETTER, width=1.4, layer=MARKS),
    ]


def _effort(page: ScaledView, at: Array, axis: Array, rotation: bool, others: int) -> list[SheetPath]:
    """The positive direction of an effort: an arrow around a joint as seen on the sheet, or along its axis."""
    toward = float(page.depth(axis) - page.depth(np.zeros(3)))
    if rotation:
        first, last = (0.4, 2.6) if toward >= 0.0 else (2.6, 0.4)
        line = arc(at, 15.0 + 5.0 * others, first, last, 31)
    else:
        along = unit_or_zero(page.direction(axis))
        line = at + np.array([0.0, 14.0 + 5.0 * others]) + np.outer(np.linspace(-0.5, 0.5, 7) * ARROW, along)
    head = arrow_head(line[-1] + 2.0 * unit_or_zero(line[-1] - line[-3]), line[-1] - line[-3], FORCE, 7.0)
    return [SheetPath(line[:-1], edge=FORCE, width=1.5, layer=MARKS), head]


def _bushing(at: Array) -> list[SheetPath]:
    """A ring of rubber about a pin."""
    return [
        SheetPath(arc(at, RUBBER), edge=INK, fill=STEEL, width=LINE, closed=True, layer=FRONT),
        SheetPath(arc(at, 0.72 * RUBBER), edge=INK, fill=INK, width=LINE, closed=True, layer=FRONT),
        SheetPath(arc(at, 0.36 * RUBBER), edge=INK, fill=WHITE, width=LINE, closed=True, layer=FRONT),
    ]
