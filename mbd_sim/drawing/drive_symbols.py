"""Motors, efforts on joints, and bushings on the sheet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np

from mbd_sim.appearance.drives import coordinate_frame, driven_coordinates, shown_bushings
from mbd_sim.drawing.load_symbols import FORCE, point_of
from mbd_sim.drawing.projection import Page, frame_of
from mbd_sim.drawing.sheet import FRONT, INK, LINE, MARKS, STEEL, WHITE, SheetPath, arc, arrow_head
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import unit_or_zero
from mbd_sim.mechanism.records import Mechanism

MOTOR, RUBBER = 8.5, 8.0  # pt, radii
AWAY = np.array([-19.0, 19.0])  # pt, from a joint to its motor
LETTER = np.array([(-3.6, -3.4), (-3.6, 3.6), (0.0, -0.8), (3.6, 3.6), (3.6, -3.4)])  # pt, an M
TURN = -1.3  # rad, from a motor of a joint to the next one
ARROW = 26.0  # pt, of an effort along a line


def drive_paths(page: Page, mechanism: Mechanism, poses: Mapping[str, Pose]) -> list[SheetPath]:
    """A circle with an M beside each joint with a motor, an arrow at each other effort, a ring for each bushing."""
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
    for bushing in shown_bushings(mechanism):
        paths += _bushing(page.project(point_of(poses, bushing.first)))
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


def _effort(page: Page, at: Array, axis: Array, rotation: bool, others: int) -> list[SheetPath]:
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
