"""Springs and dampers between two points.

A coil is logged once, one metre long; after that only its transform is sent, which stretches it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import rerun as rr

from mbd_sim.appearance import palette
from mbd_sim.appearance.palette import Color
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.force_elements import Spring
from mbd_sim.mechanism.laws import Linear
from mbd_sim.mechanism.records import Attachment, Joint
from mbd_sim.viewer import entity_paths, rerun_shapes
from mbd_sim.viewer.entity import Entity, LoggedItems
from mbd_sim.viewer.part_poses import MIN_LENGTH, PartPoses, line_transforms, transverse_direction
from mbd_sim.viewer.sample_rows import Rows
from mbd_sim.viewer.scene_description import SceneDescription

TURNS = 9
END_LENGTH = 0.08  # of the length, at each end of a coil
LINE = -1.6  # points on the screen, which no transform stretches
ANCHOR_DISTANCE = 0.35  # of the mechanism's size: from the joint of a spring on a slide to the spring's other end


def spring_entities(scene: SceneDescription) -> Iterator[Entity]:
    """All springs and dampers of a mechanism, those in sliding joints too."""
    mechanism = scene.mechanism
    for tie in mechanism.ties:
        if isinstance(tie, Spring) and tie.elastic:
            yield _Spring(scene, f"{entity_paths.WORLD}/springs/{tie.name}", tie.first, tie.second)
        if tie.damping:
            yield _Damper(scene, f"{entity_paths.WORLD}/dampers/{tie.name}", tie.first, tie.second)
    for joint in mechanism.joints.values():
        if joint.type == "prismatic" and (np.any(joint.stiffness) or joint.spring not in (None, Linear(0.0))):
            anchor, end = _ends(scene, joint)
            yield _Spring(scene, f"{entity_paths.WORLD}/springs/{joint.name}", anchor, end)


def _ends(scene: SceneDescription, joint: Joint) -> tuple[Attachment, Attachment]:
    """Where the spring of a slide is drawn: from a point behind all that it reaches to the joint's child."""
    lowest = scene.extent.travel.get(joint.name, (0.0, 0.0))[0]
    axis = joint.parent_pose.rotation @ joint.axis
    behind = joint.parent_pose.position + (lowest - ANCHOR_DISTANCE * scene.extent.size) * axis
    return Attachment(joint.parent, behind), Attachment(joint.child, joint.child_pose.position)


class _TwoPointElement:
    def __init__(self, scene: SceneDescription, path: str, first: Attachment, second: Attachment) -> None:
        self.path, self._first, self._second = path, first, second
        way = scene.at_start(second) - scene.at_start(first)
        self._across = transverse_direction(scene, way)
        self._size = scene.extent.size
        self._start = float(np.linalg.norm(way))

    def _line(self, poses: PartPoses) -> tuple[Array, Array, Array]:
        starts, stops = poses.point(self._first), poses.point(self._second)
        return starts, *line_transforms(starts, stops, self._across)

    def _radius(self, share: float) -> float:
        limit = share * self._size
        return min(limit, 0.16 * self._start) if self._start > MIN_LENGTH else limit


class _Spring(_TwoPointElement):
    def static(self) -> LoggedItems:
        lines = rr.LineStrips3D([coil(self._radius(0.032))], radii=[LINE], colors=[palette.SPRING])
        yield f"{self.path}/coil", lines

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        starts, length, quaternion = self._line(poses)
        scale = np.column_stack([np.ones_like(length), np.ones_like(length), np.maximum(length, MIN_LENGTH)])
        yield self.path, rr.Transform3D.columns(translation=starts, quaternion=quaternion, scale=scale)


class _Damper(_TwoPointElement):
    """A rod through a cylinder that stays as long as it is."""

    def static(self) -> LoggedItems:
        rod = rr.LineStrips3D([[(0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]], radii=[LINE], colors=[palette.SPRING])
        yield f"{self.path}/rod/line", rod
        radius, half = self._radius(0.02), 0.5 * min(0.3 * (self._start or self._size), 0.12 * self._size)
        pose = rerun_shapes.at(np.zeros(3))
        color: Color = palette.DAMPER
        yield f"{self.path}/cylinder/body", rerun_shapes.cylinder(pose, 2.0 * half, radius, color)

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        starts, length, quaternion = self._line(poses)
        scale = np.column_stack([np.ones_like(length), np.ones_like(length), np.maximum(length, MIN_LENGTH)])
        yield f"{self.path}/rod", rr.Transform3D.columns(translation=starts, quaternion=quaternion, scale=scale)
        middle = 0.5 * (starts + poses.point(self._second))
        yield f"{self.path}/cylinder", rr.Transform3D.columns(translation=middle, quaternion=quaternion)


def coil(radius: float) -> Array:
    """(n, 3): a coil spring along z from 0 to 1, with straight ends."""
    turn = np.linspace(0.0, 2.0 * np.pi * TURNS, 24 * TURNS + 1)
    grown = radius * np.minimum(1.0, np.minimum(turn, turn[-1] - turn) / np.pi)  # from the axis and back to it
    wound = np.column_stack(
        [grown * np.cos(turn), grown * np.sin(turn), END_LENGTH + (1.0 - 2.0 * END_LENGTH) * turn / turn[-1]]
    )
    return np.vstack([[0.0, 0.0, 0.0], wound, [0.0, 0.0, 1.0]])
