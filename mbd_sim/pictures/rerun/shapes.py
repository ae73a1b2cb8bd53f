"""Solids as archetypes of Rerun, in the frame of their part."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, assert_never

import numpy as np
import rerun as rr

from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.mechanism.elements.parts import Shape
from mbd_sim.pictures.shapes.palette import Color, mixed
from mbd_sim.pictures.shapes.solids import Ball, Box, Cylinder, Ring, Rod, diameters, meridian, solid_of

MARK_COLOR: Color = (18, 20, 26)


def solid(shape: Shape, color: Color) -> Any:
    """The shape filled with its color, or as a wireframe where it is a hole."""
    fill = rr.components.FillMode.MajorWireframe if shape.hole else rr.components.FillMode.Solid
    match solid_of(shape):
        case Rod(length, radius):
            start = shape.pose.position - shape.pose.rotation[:, 2] * length / 2.0
            return rr.Capsules3D(
                lengths=[length],
                radii=[radius],
                translations=[start],
                quaternions=[xyzw(shape.pose.rotation)],
                colors=[color],
                fill_mode=fill,
            )
        case Cylinder(length, radius):
            return cylinder(shape.pose, length, radius, color, fill)
        case Ring(radius, tube):
            return torus(shape.pose, radius, tube, color)
        case Box(size):
            return _box(shape.pose, size, color, fill)
        case Ball(radius):
            return sphere(shape.pose.position, radius, color, fill)
        case _ as unknown:
            assert_never(unknown)


def placed(pose: Pose, scale: Sequence[float]) -> rr.Transform3D:
    """The transform of an object that is scaled along its axes and then placed."""
    turned = xyzw(pose.rotation)
    return rr.Transform3D(translation=pose.position, quaternion=rr.Quaternion(xyzw=turned), scale=list(scale))


def mark(shape: Shape, color: Color) -> Any | None:
    """Lines on a round shape that make its rotation visible; None for shapes that do not need them."""
    match solid_of(shape):
        case Cylinder(radius=radius, disc=disc) as cylinder_:
            height = cylinder_.mark_height
            lines = diameters(radius, (-height, height), crossed=disc)
        case Ring(radius):
            lines = diameters(radius, (0.0,))
        case Ball(radius, particle=False):
            lines = [meridian(radius)]
        case Ball() | Rod() | Box():
            return None
        case _ as unknown:
            assert_never(unknown)
    strips = [shape.pose.position + line @ shape.pose.rotation.T for line in lines]
    return rr.LineStrips3D(strips, radii=0.015 * radius, colors=[mixed(color, MARK_COLOR, 0.55)])


def cylinder(pose: Pose, length: float, radius: float, color: Color, fill: Any = None) -> Any:
    """A cylinder about z of `pose`, which is its center."""
    return cylinders([pose], length, radius, color, fill)


def cylinders(poses: Sequence[Pose], length: float, radius: float, color: Color, fill: Any = None) -> Any:
    """Several cylinders of the same size."""
    return rr.Cylinders3D(
        lengths=[length] * len(poses),
        radii=[radius] * len(poses),
        centers=[pose.position for pose in poses],
        quaternions=[xyzw(pose.rotation) for pose in poses],
        colors=[color],
        fill_mode=fill or rr.components.FillMode.Solid,
    )


def sphere(center: Array, radius: float, color: Color, fill: Any = None) -> Any:
    """A sphere about `center` (3,)."""
    return rr.Ellipsoids3D(
        half_sizes=[[radius] * 3], centers=[center], colors=[color], fill_mode=fill or rr.components.FillMode.Solid
    )


def xyzw(rotation: Array) -> Array:
    """The quaternion of a rotation matrix in Rerun's order (x, y, z, w)."""
    return np.roll(rot.to_quaternion(rotation), -1)


def _box(pose: Pose, size: tuple[float, float, float], color: Color, fill: Any) -> Any:
    return rr.Boxes3D(
        sizes=[size], centers=[pose.position], quaternions=[xyzw(pose.rotation)], colors=[color], fill_mode=fill
    )


def torus(pose: Pose, radius: float, tube: float, color: Color, around: int = 64, across: int = 12) -> Any:
    """A torus about z of `pose`, as a mesh of `around` times `across` quadrilaterals."""
    u, v = np.meshgrid(np.arange(around) * 2 * np.pi / around, np.arange(across) * 2 * np.pi / across, indexing="ij")
    normals = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=-1).reshape(-1, 3)
    tube_centers = np.stack([np.cos(u), np.sin(u), 0.0 * u], axis=-1).reshape(-1, 3) * radius
    i, j = (index.ravel() for index in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))
    corner, next_around = i * across + j, (i + 1) % around * across + j
    next_across, opposite = i * across + (j + 1) % across, (i + 1) % around * across + (j + 1) % across
    triangles = np.vstack(
        [np.column_stack([corner, next_around, opposite]), np.column_stack([corner, opposite, next_across])]
    )
    return rr.Mesh3D(
        vertex_positions=pose.position + (tube_centers + tube * normals) @ pose.rotation.T,
        vertex_normals=normals @ pose.rotation.T,
        triangle_indices=triangles,
        albedo_factor=color,
    )
