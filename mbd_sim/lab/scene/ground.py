"""What does not move: a grid behind or below the mechanism, and the planes of ground that bodies touch."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import to_quaternion
from mbd_sim.mechanism.elements.constraints import Flat
from mbd_sim.mechanism.elements.contacts import Face
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.shapes.extent import Extent

THICK, DEEP = 0.01, 0.4  # of a plane, relative to the mechanism's size; deep is across a plane of motion
NEAR = 1e-9  # relative to the size, between planes that are the same


def add_ground(scene: Any, mechanism: Mechanism, extent: Extent, *, dark: bool) -> None:
    """Add the grid and the planes to the scene of viser."""
    _add_grid(scene, extent, dark)
    side = 1.3 * float(np.max(extent.upper - extent.lower))
    for number, (point, normal) in enumerate(planes(mechanism, extent.size)):
        middle = extent.center - normal * float(normal @ (extent.center - point))
        x = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
        depth = side
        if extent.normal is not None and abs(float(normal @ extent.normal)) < 0.5:
            x, depth = np.cross(extent.normal, normal), DEEP * extent.size
        x = x / np.linalg.norm(x)
        scene.add_box(
            f"/planes/{number}",
            dimensions=(side, depth, THICK * extent.size),
            position=middle - 0.5 * THICK * extent.size * normal,
            wxyz=to_quaternion(np.column_stack([x, np.cross(normal, x), normal])),
            color=(96, 104, 116) if dark else (170, 178, 188),
            opacity=0.4,
        )


def planes(mechanism: Mechanism, size: float) -> list[tuple[Array, Array]]:
    """A point (3,) and the normal (3,) of each plane of ground on which something lies or which it touches."""
    found: list[tuple[Array, Array]] = []
    for point, normal in _all_planes(mechanism):
        known = [np.allclose(normal, n) and abs(normal @ (point - p)) < NEAR * size for p, n in found]
        if not any(known):
            found.append((point, normal))
    return found


def _all_planes(mechanism: Mechanism) -> Iterator[tuple[Array, Array]]:
    for contact in mechanism.contacts:
        for body in (contact.first, contact.second):
            if isinstance(body, Face) and body.at.part == GROUND:
                yield body.at.point, body.normal
    for constraint in mechanism.constraints:
        if isinstance(constraint, Flat) and len(constraint.normals) == 1 and constraint.base.part == GROUND:
            yield constraint.base.point, np.asarray(constraint.normals[0])


def _add_grid(scene: Any, extent: Extent, dark: bool) -> None:
    """The plane behind a mechanism that moves in a plane, otherwise the floor below it."""
    toward = extent.toward
    side = 2.5 * float(np.max(extent.upper - extent.lower))
    position, front = extent.center.copy(), extent.up if toward is None else toward
    axis = int(np.argmax(np.abs(front)))
    plane, sign = ("yz", "xz", "xy")[axis], float(np.sign(front[axis]))
    if toward is None or axis == 2:
        behind = extent.lower if sign > 0.0 else extent.upper
        position[axis] = behind[axis] - 0.02 * sign * extent.size
    else:
        position[axis] -= 0.15 * sign * extent.size
    cell = 10.0 ** np.floor(np.log10(side / 4.0))
    scene.add_grid(
        "/grid",
        width=side,
        height=side,
        plane=plane,
        position=position,
        cell_size=cell,
        section_size=5.0 * cell,
        cell_color=(52, 58, 68) if dark else (226, 229, 234),
        section_color=(74, 82, 94) if dark else (198, 204, 212),
        shadow_opacity=0.0,
    )
