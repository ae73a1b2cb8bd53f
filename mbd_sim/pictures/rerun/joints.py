"""Joints as pins, rails and balls, motors on them, and bushings.

Joints are yellow where they are driven, and pink where they close a loop.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import assert_never

import numpy as np
import rerun as rr

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import aligning_z
from mbd_sim.mechanism.elements.parts import GROUND, Joint
from mbd_sim.pictures.rerun import scene as entity_paths
from mbd_sim.pictures.rerun import shapes
from mbd_sim.pictures.rerun.rows import Rows
from mbd_sim.pictures.rerun.scene import Entity, LoggedItems, PartPoses, SceneDescription
from mbd_sim.pictures.shapes import palette
from mbd_sim.pictures.shapes.joints import (
    Housing,
    axis_frame,
    bushing_ring,
    driven_coordinates,
    joint_radius,
    motor_housing,
    shown_bushings,
)
from mbd_sim.pictures.shapes.palette import Color
from mbd_sim.pictures.shapes.solids import circle, is_invisible, spiral

AXIS_HALF_LENGTH = 9.0  # relative to the joint's radius


def joint_entities(scene: SceneDescription) -> Iterator[Entity]:
    """All joints that restrict a motion, except slides that connect an invisible part."""
    for joint in scene.mechanism.all_joints.values():
        if joint.kind.connects and not (joint.kind.slides and _connects_invisible_part(scene, joint)):
            yield _JointEntity(scene, joint)


def color_of(scene: SceneDescription, joint: Joint) -> Color:
    """The color of a joint, by whether it is driven, closes a loop, is on ground, or connects two parts."""
    if joint.drive:
        return palette.DRIVEN
    if joint.name in scene.mechanism.closures:
        return palette.CLOSING
    return palette.STEEL if joint.parent == GROUND else palette.JOINT


def _connects_invisible_part(scene: SceneDescription, joint: Joint) -> bool:
    parts = [scene.mechanism.parts[name] for name in (joint.parent, joint.child) if name != GROUND]
    return any(is_invisible(part) for part in parts)


class _JointEntity:
    """A joint in the frame of its parent, which carries it along: only the parent moves."""

    def __init__(self, scene: SceneDescription, joint: Joint) -> None:
        self._scene, self._joint = scene, joint
        self._path = f"{entity_paths.part(joint.parent)}/joints/{entity_paths.word(joint.name)}"
        self._size = scene.extent.size
        self._radius = joint_radius(scene.mechanism, joint, self._size)
        self._color = color_of(scene, joint)

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        yield from ()

    def static(self) -> LoggedItems:
        joint, radius = self._joint, self._radius
        frame = axis_frame(joint)
        match joint.type:
            case "revolute":
                yield from self._pin(frame)
            case "screw":
                yield from self._pin(frame)
                yield f"{self._path}/thread", self._thread(frame)
            case "prismatic" | "cylindrical":
                yield from self._rail(frame)
            case "universal":
                second = Pose(frame.position, joint.parent_pose.rotation @ aligning_z(joint.second))
                yield self._path, shapes.cylinder(frame, 4.0 * radius, 0.8 * radius, self._color)
                yield f"{self._path}/second", shapes.cylinder(second, 4.0 * radius, 0.8 * radius, self._color)
            case "planar":
                yield self._path, self._square(frame)
            case "spherical":
                yield self._path, shapes.sphere(frame.position, 1.4 * radius, self._color)
                dark = palette.mixed(self._color, (0, 0, 0), 0.4)
                socket = shapes.torus(joint.parent_pose, 1.5 * radius, 0.25 * radius, dark)
                yield f"{self._path}/socket", socket
            case "fixed" | "free":
                return
            case _:
                assert_never(joint.type)

    def _pin(self, frame: Pose) -> LoggedItems:
        """A pin with its axis; on ground with a bearing on both sides, and with a collar where it is driven."""
        radius, joint = self._radius, self._joint
        yield self._path, shapes.cylinder(frame, 4.4 * radius, radius, self._color)
        ends = [frame.position + side * AXIS_HALF_LENGTH * radius * frame.rotation[:, 2] for side in (-1.0, 1.0)]
        color = palette.mixed(self._color, palette.BACKGROUND, 0.35)
        yield f"{self._path}/axis", rr.LineStrips3D([ends], radii=[-0.6], colors=[color])
        if joint.parent == GROUND:
            sides = [
                Pose(frame.position + side * 1.9 * radius * frame.rotation[:, 2], frame.rotation)
                for side in (-1.0, 1.0)
            ]
            yield f"{self._path}/bearing", shapes.cylinders(sides, 0.6 * radius, 2.1 * radius, self._color)
        if joint.drive:
            yield f"{self._path}/motor", shapes.torus(frame, 2.0 * radius, 0.55 * radius, self._color)
        if np.any(joint.stiffness) or joint.spring is not None:
            windings = radius * spiral(1.6, 4.0, 2.5)
            line = _placed(frame, np.column_stack([windings, np.full(len(windings), 2.4 * radius)]))
            yield f"{self._path}/spring", rr.LineStrips3D([line], radii=[-1.2], colors=[palette.SPRING])

    def _rail(self, frame: Pose) -> LoggedItems:
        """A rail as long as the travel, with stops at its ends."""
        low, high = self._scene.extent.travel.get(self._joint.name, (-0.25 * self._size, 0.25 * self._size))
        margin = 0.12 * self._size
        low, high = low - margin, high + margin
        axis = frame.rotation[:, 2]
        center = Pose(frame.position + 0.5 * (low + high) * axis, frame.rotation)
        radius = 0.35 * self._radius
        yield self._path, shapes.cylinder(center, high - low, radius, self._color)
        ends = [Pose(frame.position + position * axis, frame.rotation) for position in (low, high)]
        yield f"{self._path}/ends", shapes.cylinders(ends, radius, 2.5 * radius, self._color)

    def _thread(self, frame: Pose) -> rr.LineStrips3D:
        around = self._radius * circle(np.linspace(0.0, 20.0 * np.pi, 400))
        helix = np.column_stack([around, np.linspace(-6.0, 6.0, 400) * self._radius])
        return rr.LineStrips3D([_placed(frame, helix)], radii=[-1.0], colors=[self._color])

    def _square(self, frame: Pose) -> rr.LineStrips3D:
        corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (-1, -1, 0)], dtype=float)
        return rr.LineStrips3D([_placed(frame, 0.3 * self._size * corners)], radii=[-1.0], colors=[self._color])


def _placed(frame: Pose, points: Array) -> Array:
    """Points (n, 3) of a frame in the outer frame."""
    return np.asarray(frame.position + points @ frame.rotation.T)


def drive_entities(scene: SceneDescription) -> Iterator[Entity]:
    """A housing on the axis of each coordinate with a motor or an effort, and a ring for each bushing."""
    mechanism, size = scene.mechanism, scene.extent.size
    for name, joint, coordinate in driven_coordinates(mechanism):
        yield _HousingEntity("actuators", name, motor_housing(mechanism, joint, coordinate, size), palette.DRIVEN)
    for bushing in shown_bushings(mechanism):
        yield _HousingEntity("bushings", bushing.name, bushing_ring(bushing, size), palette.DAMPER)


class _HousingEntity:
    """A cylinder in the frame of the part that carries it: only the part moves."""

    def __init__(self, kind: str, name: str, housing: Housing, color: palette.Color) -> None:
        self._path = f"{entity_paths.part(housing.part)}/{kind}/{entity_paths.word(name)}"
        self._housing, self._color = housing, color

    def static(self) -> LoggedItems:
        housing = self._housing
        yield self._path, shapes.cylinder(housing.pose, housing.length, housing.radius, self._color)

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        yield from ()
