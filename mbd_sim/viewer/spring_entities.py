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
from mbd_sim.viewer.entity import Logged, Prop
from mbd_sim.viewer.placement import LEAST, Placement, across, along
from mbd_sim.viewer.sample_rows import Rows
from mbd_sim.viewer.scene_description import Stage

TURNS = 9
STUB = 0.08  # of the length, at each end of a coil
LINE = -1.6  # points on the screen, which no transform stretches
TO_ANCHOR = 0.35  # of the mechanism's size: from the joint of a spring on a slide to the spring's other end


def ties(stage: Stage) -> Iterator[Prop]:
    """All springs and dampers of a mechanism, those in sliding joints too."""
    mechanism = stage.mechanism
    for tie in mechanism.ties:
        if isinstance(tie, Spring) and tie.elastic:
            yield _Coil(stage, f"{entity_paths.WORLD}/springs/{tie.name}", tie.first, tie.second)
        if tie.damping:
            yield _Dashpot(stage, f"{entity_paths.WORLD}/dampers/{tie.name}", tie.first, tie.second)
    for joint in mechanism.joints.values():
        if joint.type == "prismatic" and (np.any(joint.stiffness) or joint.spring not in (None, Linear(0.0))):
            anchor, end = _ends(stage, joint)
            yield _Coil(stage, f"{entity_paths.WORLD}/springs/{joint.name}", anchor, end)


def _ends(stage: Stage, joint: Joint) -> tuple[Attachment, Attachment]:
    """Where the spring of a slide is drawn: from a point behind all that it reaches to the joint's child."""
    lowest = stage.extent.travel.get(joint.name, (0.0, 0.0))[0]
    axis = joint.parent_pose.rotation @ joint.axis
    behind = joint.parent_pose.position + (lowest - TO_ANCHOR * stage.extent.size) * axis
    return Attachment(joint.parent, behind), Attachment(joint.child, joint.child_pose.position)


class _Tie:
    def __init__(self, stage: Stage, entity: str, first: Attachment, second: Attachment) -> None:
        self.entity, self._first, self._second = entity, first, second
        way = stage.at_start(second) - stage.at_start(first)
        self._across = across(stage, way)
        self._size = stage.extent.size
        self._start = float(np.linalg.norm(way))

    def _line(self, placement: Placement) -> tuple[Array, Array, Array]:
        starts, stops = placement.point(self._first), placement.point(self._second)
        return starts, *along(starts, stops, self._across)

    def _radius(self, share: float) -> float:
        most = share * self._size
        return min(most, 0.16 * self._start) if self._start > LEAST else most


class _Coil(_Tie):
    def static(self) -> Logged:
        lines = rr.LineStrips3D([coil(self._radius(0.032))], radii=[LINE], colors=[palette.SPRING])
        yield f"{self.entity}/coil", lines

    def columns(self, rows: Rows, placement: Placement) -> Logged:
        starts, length, quaternion = self._line(placement)
        scale = np.column_stack([np.ones_like(length), np.ones_like(length), np.maximum(length, LEAST)])
        yield self.entity, rr.Transform3D.columns(translation=starts, quaternion=quaternion, scale=scale)


class _Dashpot(_Tie):
    """A rod through a cylinder that stays as long as it is."""

    def static(self) -> Logged:
        rod = rr.LineStrips3D([[(0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]], radii=[LINE], colors=[palette.SPRING])
        yield f"{self.entity}/rod/line", rod
        radius, half = self._radius(0.02), 0.5 * min(0.3 * (self._start or self._size), 0.12 * self._size)
        pose = rerun_shapes.at(np.zeros(3))
        color: Color = palette.DAMPER
        yield f"{self.entity}/cylinder/body", rerun_shapes.cylinder(pose, 2.0 * half, radius, color)

    def columns(self, rows: Rows, placement: Placement) -> Logged:
        starts, length, quaternion = self._line(placement)
        scale = np.column_stack([np.ones_like(length), np.ones_like(length), np.maximum(length, LEAST)])
        yield f"{self.entity}/rod", rr.Transform3D.columns(translation=starts, quaternion=quaternion, scale=scale)
        middle = 0.5 * (starts + placement.point(self._second))
        yield f"{self.entity}/cylinder", rr.Transform3D.columns(translation=middle, quaternion=quaternion)


def coil(radius: float) -> Array:
    """(n, 3): a coil spring along z from 0 to 1, with straight ends."""
    turn = np.linspace(0.0, 2.0 * np.pi * TURNS, 24 * TURNS + 1)
    grown = radius * np.minimum(1.0, np.minimum(turn, turn[-1] - turn) / np.pi)  # from the axis and back to it
    wound = np.column_stack([grown * np.cos(turn), grown * np.sin(turn), STUB + (1.0 - 2.0 * STUB) * turn / turn[-1]])
    return np.vstack([[0.0, 0.0, 0.0], wound, [0.0, 0.0, 1.0]])
