"""Force elements on the sheet: springs and rods between points, arrows of forces and couples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from mbd_sim.appearance.palette import DISSIPATED
from mbd_sim.drawing.ground_symbols import wall
from mbd_sim.drawing.joint_symbols import turn_arrow
from mbd_sim.drawing.placed_joint import middle
from mbd_sim.drawing.projection import Page
from mbd_sim.drawing.sheet import BODIES, MARKS, Path, arrow_head, dark
from mbd_sim.drawing.spring_symbols import link, spring_and_damper
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import unit_or_zero
from mbd_sim.mechanism.expression import ExpressionError
from mbd_sim.mechanism.force_elements import AppliedForce
from mbd_sim.mechanism.records import GROUND, Attachment, Mechanism

LENGTH = 46.0  # pt, of the arrow of any force
FORCE = dark(DISSIPATED)
MOMENTS = (0.0, 0.05, 0.1, 0.25, 0.5, 1.0)  # s; the first at which a force is not zero is drawn


def between(mechanism: Mechanism) -> Iterator[Any]:
    """All records of the mechanism that connect two points, whatever their kind."""
    for member in fields(mechanism):
        records = getattr(mechanism, member.name)
        records = tuple(records.values()) if isinstance(records, Mapping) else records
        for record in records if isinstance(records, tuple) else ():
            if isinstance(getattr(record, "first", None), Attachment) and isinstance(record.second, Attachment):
                yield record


def between_paths(page: Page, mechanism: Mechanism, poses: Mapping[str, Pose]) -> list[Path]:
    """Springs, dampers, and rods that only keep a distance."""
    paths: list[Path] = []
    for record in between(mechanism):
        first, second = (place(poses, at) for at in (record.first, record.second))
        depth = page.depth((first + second) / 2.0)
        ends = page.at(first), page.at(second)
        elastic, damped = bool(getattr(record, "elastic", 0.0)), bool(getattr(record, "damping", 0.0))
        if elastic or damped:
            paths += spring_and_damper(*ends, elastic, damped, BODIES, depth)
        else:
            paths += link(*ends, BODIES, depth)
        along = unit_or_zero(ends[1] - ends[0])
        for at, end, away in ((record.first, ends[0], -along), (record.second, ends[1], along)):
            paths += wall(end, away) if at.part == GROUND and along.any() else []
    return paths


def force_paths(page: Page, mechanism: Mechanism, poses: Mapping[str, Pose]) -> list[Path]:
    """Arrows of the applied forces and couples, in the direction they have at the start."""
    paths: list[Path] = []
    for element in mechanism.applied:
        pose = poses[element.at.part]
        vector = _vector(element)
        turned = poses[element.axes_of].rotation @ element.axes if element.following else element.axes
        vector = turned @ vector
        if not vector.any():
            continue
        center = pose.position + pose.rotation @ middle(mechanism.parts[element.at.part])
        if element.couple:
            paths += turn_arrow(page, center, vector, 24.0, FORCE)
            continue
        at = place(poses, element.at)
        seen = unit_or_zero(page.seen(unit_or_zero(vector)))
        start = page.at(at)
        if seen @ (page.at(center) - start) > 1e-9:  # it pushes: the tip is at the point
            start = start - (LENGTH + 6.0) * seen
        start = start + 3.0 * seen
        tip = start + LENGTH * seen
        paths += [
            Path(np.array([start, tip - 5.0 * seen]), edge=FORCE, width=1.9, layer=MARKS),
            arrow_head(tip, seen, FORCE, 9.0),
        ]
    return paths


def place(poses: Mapping[str, Pose], at: Attachment) -> Array:
    """A point (3,) in ground's frame."""
    return at.point if at.part == GROUND else poses[at.part].position + poses[at.part].rotation @ at.point


def _vector(element: AppliedForce) -> Array:
    for moment in MOMENTS:
        try:
            vector = np.array([expression.at(moment) for expression in element.vector])
        except ExpressionError:
            continue
        if vector.any():
            return vector
    return np.zeros(3)
