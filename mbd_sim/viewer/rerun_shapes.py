"""One shape of a part as something Rerun draws, in the part's frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from mbd_sim.appearance.palette import Color, mixed
from mbd_sim.geometry import rotation as rot
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.mechanism.records import Shape

DARK: Color = (18, 20, 26)


def solid(shape: Shape, color: Color) -> Any:
    """The shape filled with its colour, or as wires where it is a hole."""
    fill = rr.components.FillMode.MajorWireframe if shape.hole else rr.components.FillMode.Solid
    match shape.kind, shape.size:
        case "rod", (length, radius):
            start = Pose(shape.pose.position - shape.pose.rotation[:, 2] * length / 2.0, shape.pose.rotation)
            return rr.Capsules3D(
                lengths=[length],
                radii=[radius],
                translations=[start.position],
                quaternions=[xyzw(start.rotation)],
                colors=[color],
                fill_mode=fill,
            )
        case "cylinder", (length, radius):
            return cylinder(shape.pose, length, radius, color, fill)
        case "disc", (radius,):
            return cylinder(shape.pose, 0.08 * radius, radius, color, fill)
        case "ring", (radius,):
            return torus(shape.pose, radius, 0.04 * radius, color)
        case "plate", (x, y):
            return _box(shape.pose, (x, y, 0.02 * min(x, y)), color, fill)
        case "block", (x, y, z):
            return _box(shape.pose, (x, y, z), color, fill)
    return sphere(shape.pose.position, shape.size[0], color, fill)


def mark(shape: Shape, color: Color) -> Any | None:
    """Lines on a round shape that show how it turns; None for shapes whose turning is seen anyway."""
    match shape.kind, shape.size:
        case "disc", (radius,):
            height = 0.042 * radius
            lines = [[(-radius, 0.0, z), (radius, 0.0, z)] for z in (-height, height)]
            lines += [[(0.0, -radius, z), (0.0, radius, z)] for z in (-height, height)]
        case "cylinder", (length, radius):
            height = 0.505 * length
            lines = [[(-radius, 0.0, z), (radius, 0.0, z)] for z in (-height, height)]
        case "ring", (radius,):
            lines = [[(-radius, 0.0, 0.0), (radius, 0.0, 0.0)]]
        case "sphere", (radius,):
            turn = np.linspace(0.0, 2.0 * np.pi, 33)
            arc = 1.005 * radius * np.column_stack([np.cos(turn), 0.0 * turn, np.sin(turn)])
            lines = [list(map(tuple, arc))]
        case _:
            return None
    strips = [shape.pose.position + np.array(line) @ shape.pose.rotation.T for line in lines]
    return rr.LineStrips3D(strips, radii=0.015 * radius, colors=[mixed(color, DARK, 0.55)])


def cylinder(pose: Pose, length: float, radius: float, color: Color, fill: Any = None) -> Any:
    """A cylinder about z of `pose`, which is its centre."""
    return cylinders([pose], length, radius, color, fill)


def cylinders(poses: Sequence[Pose], length: float, radius: float, color: Color, fill: Any = None) -> Any:
    """Several of one size."""
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


def at(position: Array) -> Pose:
    """A frame at a point (3,), not turned."""
    return Pose(position, np.eye(3))


def xyzw(rotation: Array) -> Array:
    """The quaternion of a rotation matrix in Rerun's order (x, y, z, w)."""
    return np.roll(rot.to_quaternion(rotation), -1)


def _box(pose: Pose, size: tuple[float, float, float], color: Color, fill: Any) -> Any:
    return rr.Boxes3D(
        sizes=[size], centers=[pose.position], quaternions=[xyzw(pose.rotation)], colors=[color], fill_mode=fill
    )


def torus(pose: Pose, radius: float, tube: float, color: Color, around: int = 64, across: int = 12) -> Any:
    """A ring about z of `pose`."""
    u, v = np.meshgrid(np.arange(around) * 2 * np.pi / around, np.arange(across) * 2 * np.pi / across, indexing="ij")
    normals = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=-1).reshape(-1, 3)
    middle = np.stack([np.cos(u), np.sin(u), 0.0 * u], axis=-1).reshape(-1, 3) * radius
    i, j = (index.ravel() for index in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))
    here, right = i * across + j, (i + 1) % around * across + j
    up, both = i * across + (j + 1) % across, (i + 1) % around * across + (j + 1) % across
    return rr.Mesh3D(
        vertex_positions=pose.position + (middle + tube * normals) @ pose.rotation.T,
        vertex_normals=normals @ pose.rotation.T,
        triangle_indices=np.vstack([np.column_stack([here, right, both]), np.column_stack([here, both, up])]),
        albedo_factor=color,
    )
