"""What joints look like: pins, rails, balls; yellow where they are driven, pink where they close a loop."""

from __future__ import annotations

from collections.abc import Iterator
from typing import assert_never

import numpy as np
import rerun as rr

from mbd_sim.appearance import palette
from mbd_sim.appearance.extent import joint_radius
from mbd_sim.appearance.palette import Color
from mbd_sim.geometry.pose import Pose
from mbd_sim.geometry.rotation import aligning_z
from mbd_sim.mechanism.records import GROUND, Joint
from mbd_sim.viewer import entity_paths, rerun_shapes
from mbd_sim.viewer.entity import Entity, LoggedItems
from mbd_sim.viewer.part_poses import PartPoses
from mbd_sim.viewer.sample_rows import Rows
from mbd_sim.viewer.scene_description import SceneDescription

AXIS = 9.0  # radii, half the length of the line along an axis


def joint_entities(scene: SceneDescription) -> Iterator[Entity]:
    """All joints that hold something: not fixed and free ones, nor those of parts that cannot be seen."""
    for joint in scene.mechanism.all_joints.values():
        if joint.kind.connects and not (joint.kind.slides and _phantom(scene, joint)):
            yield _JointEntity(scene, joint)


def color_of(scene: SceneDescription, joint: Joint) -> Color:
    """Told apart: driven, closing a loop, on ground, and between parts."""
    if joint.drive:
        return palette.DRIVEN
    if joint.name in scene.mechanism.closing:
        return palette.CLOSING
    return palette.STEEL if joint.parent == GROUND else palette.JOINT


def _phantom(scene: SceneDescription, joint: Joint) -> bool:
    """Whether a part of a slide has neither mass nor shape: it only carries coordinates."""
    parts = [scene.mechanism.parts[name] for name in (joint.parent, joint.child) if name != GROUND]
    return any(part.mass == 0.0 and not part.shapes for part in parts)


class _JointEntity:
    def __init__(self, scene: SceneDescription, joint: Joint) -> None:
        self._scene, self._joint = scene, joint
        self._path = f"{entity_paths.part(joint.parent)}/joints/{joint.name}"
        self._size = scene.extent.size
        self._radius = joint_radius(scene.mechanism, joint, self._size)
        self._color = color_of(scene, joint)

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        yield from ()

    def static(self) -> LoggedItems:
        joint, radius = self._joint, self._radius
        along = (
            Pose(joint.parent_pose.position, joint.parent_pose.rotation @ aligning_z(joint.axis))
            if np.any(joint.axis)
            else joint.parent_pose
        )
        match joint.type:
            case "revolute":
                yield from self._pin(along)
            case "screw":
                yield from self._pin(along)
                yield f"{self._path}/thread", self._thread(along)
            case "prismatic" | "cylindrical":
                yield from self._rail(along)
            case "universal":
                second = Pose(along.position, joint.parent_pose.rotation @ aligning_z(joint.second))
                yield self._path, rerun_shapes.cylinder(along, 4.0 * radius, 0.8 * radius, self._color)
                yield f"{self._path}/second", rerun_shapes.cylinder(second, 4.0 * radius, 0.8 * radius, self._color)
            case "planar":
                yield self._path, self._square(along)
            case "spherical":
                yield self._path, rerun_shapes.sphere(along.position, 1.4 * radius, self._color)
                ring = rerun_shapes.torus(
                    joint.parent_pose, 1.5 * radius, 0.25 * radius, palette.mixed(self._color, (0, 0, 0), 0.4)
                )
                yield f"{self._path}/socket", ring
            case "fixed" | "free":
                return
            case _:
                assert_never(joint.type)

    def _pin(self, along: Pose) -> LoggedItems:
        """A pin with its axis; on ground between two cheeks, and with a collar where it is driven."""
        radius, joint = self._radius, self._joint
        yield self._path, rerun_shapes.cylinder(along, 4.4 * radius, radius, self._color)
        ends = [along.position + side * AXIS * radius * along.rotation[:, 2] for side in (-1.0, 1.0)]
        color = palette.mixed(self._color, palette.BACKGROUND, 0.35)
        yield f"{self._path}/axis", rr.LineStrips3D([ends], radii=[-0.6], colors=[color])
        if joint.parent == GROUND:
            cheeks = [
                Pose(along.position + side * 1.9 * radius * along.rotation[:, 2], along.rotation)
                for side in (-1.0, 1.0)
            ]
            yield f"{self._path}/bearing", rerun_shapes.cylinders(cheeks, 0.6 * radius, 2.1 * radius, self._color)
        if joint.drive:
            yield f"{self._path}/motor", rerun_shapes.torus(along, 2.0 * radius, 0.55 * radius, self._color)
        if np.any(joint.stiffness) or joint.spring is not None:
            turn = np.linspace(0.0, 5.0 * np.pi, 120)
            grown = np.linspace(1.6, 4.0, 120) * radius
            flat = np.column_stack([grown * np.cos(turn), grown * np.sin(turn), np.full(120, 2.4 * radius)])
            spiral = along.position + flat @ along.rotation.T
            yield f"{self._path}/spring", rr.LineStrips3D([spiral], radii=[-1.2], colors=[palette.SPRING])

    def _rail(self, along: Pose) -> LoggedItems:
        """A rail as long as the travel, with its ends."""
        low, high = self._scene.extent.travel.get(self._joint.name, (-0.25 * self._size, 0.25 * self._size))
        margin = 0.12 * self._size
        low, high = low - margin, high + margin
        z = along.rotation[:, 2]
        middle = Pose(along.position + 0.5 * (low + high) * z, along.rotation)
        thin = 0.35 * self._radius
        yield self._path, rerun_shapes.cylinder(middle, high - low, thin, self._color)
        ends = [Pose(along.position + at * z, along.rotation) for at in (low, high)]
        yield f"{self._path}/ends", rerun_shapes.cylinders(ends, thin, 2.5 * thin, self._color)

    def _thread(self, along: Pose) -> rr.LineStrips3D:
        turn = np.linspace(0.0, 20.0 * np.pi, 400)
        wound = np.column_stack(
            [self._radius * np.cos(turn), self._radius * np.sin(turn), np.linspace(-6.0, 6.0, 400) * self._radius]
        )
        return rr.LineStrips3D([along.position + wound @ along.rotation.T], radii=[-1.0], colors=[self._color])

    def _square(self, along: Pose) -> rr.LineStrips3D:
        half = 0.3 * self._size
        corners = half * np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (-1, -1, 0)], dtype=float)
        return rr.LineStrips3D([along.position + corners @ along.rotation.T], radii=[-1.0], colors=[self._color])
