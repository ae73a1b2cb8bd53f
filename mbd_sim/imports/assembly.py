"""An assembly as plain data: its parts as they are placed, their bodies, and the faces at which they touch.

Lengths are in m, in right-handed frames. A body is described once in its own frame, however often it is placed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.mechanism.mass_properties import MassProperties

FaceKind = Literal["plane", "cylinder", "sphere"]


@dataclass(frozen=True, eq=False)
class PartFace:
    """A part of the surface of a body: a plane, or a round face.

    `point` (3,) lies on the plane or the axis, or is the center of a sphere. `direction` (3,) is the normal of a plane,
    which leads out of the material, or a unit vector along the axis of a cylinder. A `convex` face has the material
    inside, like that of a shaft. `turn` is the angle in rad that a cylinder covers around its axis. `triangles`
    (n, 3, 3) are the face.
    """

    kind: FaceKind
    point: Array
    direction: Array
    radius: float
    convex: bool
    turn: float
    triangles: Array

    def placed(self, pose: Pose) -> PartFace:
        """The face in the outer frame of `pose`."""
        return replace(
            self,
            point=pose.position + pose.rotation @ self.point,
            direction=pose.rotation @ self.direction,
            triangles=pose.position + self.triangles @ pose.rotation.T,
        )


WHOLE = 0.5  # rad, between neighboring triangles, up to which a face is not open there


def covered_angle(triangles: Array, point: Array, axis: Array) -> float:
    """The angle in rad that triangles (n, 3, 3) cover around an axis."""
    helper = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    across = helper / np.linalg.norm(helper)
    away = triangles.reshape(-1, 3) - point
    angles = np.sort(np.arctan2(away @ np.cross(axis, across), away @ across))
    widest = float(np.diff(np.concatenate([angles, angles[:1] + 2.0 * math.pi])).max())
    return 2.0 * math.pi if widest <= WHOLE else 2.0 * math.pi - widest


@dataclass(frozen=True, eq=False)
class Body:
    """A solid in its own frame: its `volume` as mass properties with 1 kg/m³, its surface `triangles` (n, 3, 3).

    One that was read from the `file` of a mesh, in which lengths are in `scale` m, is not written again.
    """

    volume: MassProperties
    triangles: Array
    faces: tuple[PartFace, ...] = ()
    file: Path | None = None
    scale: float = 1.0


@dataclass(frozen=True, eq=False)
class PlacedBody:
    """A body in the frame of its part; `names` are those by which a table of materials may call it."""

    body: Body
    pose: Pose
    names: tuple[str, ...]
    color: str | None = None


@dataclass(frozen=True, eq=False)
class ImportedPart:
    """A part: its bodies, which move as one, and the `pose` of its frame in the assembly."""

    name: str
    pose: Pose
    bodies: tuple[PlacedBody, ...]

    def faces(self) -> list[PartFace]:
        """Its faces in the frame of the assembly."""
        return [face.placed(self.pose @ placed.pose) for placed in self.bodies for face in placed.body.faces]

    def triangles(self) -> Array:
        """Its surface (n, 3, 3) in the frame of the assembly."""
        found = []
        for placed in self.bodies:
            pose = self.pose @ placed.pose
            found.append(pose.position + placed.body.triangles @ pose.rotation.T)
        return np.concatenate(found)

    @property
    def volume(self) -> float:
        """In m³."""
        return float(sum(placed.body.volume.mass for placed in self.bodies))


@dataclass(frozen=True, eq=False)
class CadAssembly:
    """The parts of one or more files; `notes` say what was read, in which unit, and what was left out."""

    name: str
    parts: tuple[ImportedPart, ...]
    notes: tuple[str, ...] = ()
