"""Springs and dampers between two points.

A coil is logged once, one meter long; after that only the transform that stretches it is sent.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import assert_never

import numpy as np
import rerun as rr

from mbd_sim.appearance import palette, polylines
from mbd_sim.appearance.drives import has_cylinder
from mbd_sim.geometry.pose import Array, identity_pose
from mbd_sim.mechanism.actuators import line_ports
from mbd_sim.mechanism.force_elements import Damper, Spring
from mbd_sim.mechanism.laws import Linear
from mbd_sim.mechanism.records import Attachment, Joint
from mbd_sim.viewer import entity_paths, rerun_shapes
from mbd_sim.viewer.entity import Entity, LoggedItems
from mbd_sim.viewer.part_poses import MIN_LENGTH, PartPoses, line_transforms, transverse_direction
from mbd_sim.viewer.sample_rows import Rows
from mbd_sim.viewer.scene_description import SceneDescription

LINE_RADIUS = -1.6  # negative: in points on the screen, which no transform stretches
ANCHOR_DISTANCE = 0.35  # from the range of a slide to the far end of its spring, relative to the mechanism's size


def spring_entities(scene: SceneDescription) -> Iterator[Entity]:
    """All springs, dampers and actuators between points, and the springs of prismatic joints."""
    mechanism = scene.mechanism
    for element in mechanism.two_point_elements:
        spring_path = entity_paths.in_world("springs", element.name)
        damper_path = entity_paths.in_world("dampers", element.name)
        match element:
            case Spring(first=first, second=second, elastic=elastic):
                if elastic:
                    yield _SpringEntity(scene, spring_path, first, second)
                if has_cylinder(element):
                    yield _DamperEntity(scene, damper_path, first, second)
            case Damper(first=first, second=second):
                if has_cylinder(element):
                    yield _DamperEntity(scene, damper_path, first, second)
            case _:
                assert_never(element)
    for name, port in line_ports(mechanism).items():
        yield _DamperEntity(scene, entity_paths.in_world("actuators", name), port.first, port.second)
    for joint in mechanism.joints.values():
        if joint.type == "prismatic" and (np.any(joint.stiffness) or joint.spring not in (None, Linear(0.0))):
            anchor, end = _joint_spring_ends(scene, joint)
            yield _SpringEntity(scene, entity_paths.in_world("springs", joint.name), anchor, end)


def _joint_spring_ends(scene: SceneDescription, joint: Joint) -> tuple[Attachment, Attachment]:
    """The ends of a prismatic joint's spring: a point beyond the lower end of its travel, and the joint's child."""
    lowest = scene.extent.travel.get(joint.name, (0.0, 0.0))[0]
    axis = joint.parent_pose.rotation @ joint.axis
    anchor = joint.parent_pose.position + (lowest - ANCHOR_DISTANCE * scene.extent.size) * axis
    return Attachment(joint.parent, anchor), Attachment(joint.child, joint.child_pose.position)


class _TwoPointEntity:
    """An element between two points, drawn along z and stretched by a transform."""

    def __init__(self, scene: SceneDescription, path: str, first: Attachment, second: Attachment) -> None:
        self.path, self._first, self._second = path, first, second
        line = scene.at_start(second) - scene.at_start(first)
        self._transverse = transverse_direction(scene, line)
        self._size = scene.extent.size
        self._start_length = float(np.linalg.norm(line))

    def _line(self, poses: PartPoses) -> tuple[Array, Array, Array]:
        """The starts (n, 3), and the lengths (n,) and quaternions (n, 4) of `line_transforms`."""
        starts, stops = poses.point(self._first), poses.point(self._second)
        return starts, *line_transforms(starts, stops, self._transverse)

    def _stretched(self, path: str, starts: Array, lengths: Array, quaternions: Array) -> LoggedItems:
        """The transforms that stretch an object along z from 0 to 1 m to these lengths."""
        scale = np.column_stack([np.ones_like(lengths), np.ones_like(lengths), np.maximum(lengths, MIN_LENGTH)])
        yield path, rr.Transform3D.columns(translation=starts, quaternion=quaternions, scale=scale)

    def _radius(self, factor: float) -> float:
        """`factor` times the mechanism's size, and at most 0.16 of the element's length at the start, m."""
        limit = factor * self._size
        return min(limit, 0.16 * self._start_length) if self._start_length > MIN_LENGTH else limit


class _SpringEntity(_TwoPointEntity):
    """A coil."""

    def static(self) -> LoggedItems:
        coil = polylines.coil(self._radius(0.032))
        yield f"{self.path}/coil", rr.LineStrips3D([coil], radii=[LINE_RADIUS], colors=[palette.SPRING])

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        yield from self._stretched(self.path, *self._line(poses))


class _DamperEntity(_TwoPointEntity):
    """A rod through a cylinder of constant length."""

    def static(self) -> LoggedItems:
        rod = rr.LineStrips3D([[(0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]], radii=[LINE_RADIUS], colors=[palette.SPRING])
        yield f"{self.path}/rod/line", rod
        radius, half = self._radius(0.02), 0.5 * min(0.3 * (self._start_length or self._size), 0.12 * self._size)
        cylinder = rerun_shapes.cylinder(identity_pose(), 2.0 * half, radius, palette.DAMPER)
        yield f"{self.path}/cylinder/body", cylinder

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        starts, lengths, quaternions = self._line(poses)
        yield from self._stretched(f"{self.path}/rod", starts, lengths, quaternions)
        middle = 0.5 * (starts + poses.point(self._second))
        yield f"{self.path}/cylinder", rr.Transform3D.columns(translation=middle, quaternion=quaternions)
