"""What a part, a joint, a spring and a damper look like as markers of RViz."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from visualization_msgs.msg import Marker

from mbd_sim.appearance import palette
from mbd_sim.appearance.extent import joint_radius
from mbd_sim.geometry.pose import Array, Pose, identity_pose
from mbd_sim.geometry.rotation import aligning_z
from mbd_sim.mechanism.records import (
    GROUND,
    Joint,
    Mechanism,
    Part,
    Shape,
)

TURNS = 8
COIL = 20 * TURNS + 4  # points of a coil
DAMPER = 12  # and of a damper
DARK: palette.Color = (18, 20, 26)
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 49)
# A damper by its segments: along its line, and across in half widths.
_PISTON = np.array([
    [0.0, 0.0], [0.35, 0.0], [0.35, -1.0], [0.35, 1.0], [0.35, 1.0], [0.7, 1.0], [0.35, -1.0], [0.7, -1.0],
    [0.55, -0.8], [0.55, 0.8], [0.55, 0.0], [1.0, 0.0],
])  # fmt: skip

Points = tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, eq=False)
class Solid:
    """A marker that moves with a part: its kind, pose in the part's frame, scale, colour, and points of lines."""

    part: str
    space: str
    kind: int
    pose: Pose
    scale: tuple[float, float, float]
    color: palette.Color
    points: Points = ()


def thickness(size: float) -> float:
    """The width in m of lines in a mechanism of a given size in m."""
    return 0.006 * size


def part_solids(mechanism: Mechanism, part: Part, size: float) -> list[Solid]:
    """The shapes of a part; a ball at its mass centre and lines to its points where it has none."""
    color = palette.part_colors(mechanism)[part.name]
    if part.shapes:
        return [solid for shape in part.shapes if not shape.hole for solid in _shape(part.name, shape, color)]
    ball = 0.04 * size
    center = Pose(part.center, np.eye(3))
    found = [Solid(part.name, "parts", Marker.SPHERE, center, (ball,) * 3, palette.lit(color))]
    ends = [pose.position for pose in part.points.values()] or [part.center]
    points = [xyz for end in ends if np.any(end) for xyz in (np.zeros(3), end)]
    if points:
        width = (2.0 * thickness(size), 0.0, 0.0)
        found.append(
            Solid(part.name, "parts", Marker.LINE_LIST, identity_pose(), width, color, _tuples(np.array(points)))
        )
    return found


def _shape(part: str, shape: Shape, color: palette.Color) -> list[Solid]:
    own = palette.from_hex(shape.color) if shape.color else palette.lit(color)

    def solid(kind: int, scale: tuple[float, float, float], pose: Pose = shape.pose, points: Points = ()) -> Solid:
        return Solid(part, "parts", kind, pose, scale, own, points)

    def lines(points: Array, width: float) -> Solid:
        return Solid(part, "parts", Marker.LINE_LIST, shape.pose, (width, 0.0, 0.0), DARK, _tuples(points))

    match shape.kind, shape.size:
        case "rod", (length, radius):
            caps = [
                Pose(shape.pose.position + s * length / 2.0 * shape.pose.rotation[:, 2], np.eye(3)) for s in (-1, 1)
            ]
            balls = [solid(Marker.SPHERE, (2.0 * radius,) * 3, cap) for cap in caps]
            return [solid(Marker.CYLINDER, (2.0 * radius, 2.0 * radius, length)), *balls]
        case "cylinder", (length, radius):
            cross = _cross(radius, 0.505 * length)
            return [solid(Marker.CYLINDER, (2.0 * radius, 2.0 * radius, length)), lines(cross, 0.06 * radius)]
        case "disc", (radius,):
            cross = _cross(radius, 0.042 * radius)
            return [solid(Marker.CYLINDER, (2.0 * radius, 2.0 * radius, 0.08 * radius)), lines(cross, 0.04 * radius)]
        case "ring", (radius,):
            circle = radius * np.column_stack([np.cos(_CIRCLE), np.sin(_CIRCLE), 0.0 * _CIRCLE])
            spoke = np.array([[-radius, 0.0, 0.0], [radius, 0.0, 0.0]])
            ring = solid(Marker.LINE_STRIP, (0.08 * radius, 0.0, 0.0), points=_tuples(circle))
            return [ring, lines(spoke, 0.04 * radius)]
        case "plate", (x, y):
            return [solid(Marker.CUBE, (x, y, 0.02 * min(x, y)))]
        case "block", (x, y, z):
            return [solid(Marker.CUBE, (x, y, z))]
    return [solid(Marker.SPHERE, (2.0 * shape.size[0],) * 3)]


def joint_solids(mechanism: Mechanism, joint: Joint, size: float) -> list[Solid]:
    """A pin along a revolute axis, a guide along a prismatic one, a ball for the others; none where nothing holds."""
    if not joint.kind.connects:
        return []
    radius = joint_radius(mechanism, joint, size)
    color = palette.STEEL if joint.parent == GROUND else palette.JOINT
    pose = joint.parent_pose
    match joint.type:
        case "revolute":
            scale = (2.0 * radius, 2.0 * radius, 4.0 * radius)
        case "prismatic":
            scale = (0.6 * radius, 0.6 * radius, 0.5 * size)
        case _:
            return [Solid(joint.parent, "joints", Marker.SPHERE, pose, (2.6 * radius,) * 3, color)]
    along = Pose(pose.position, pose.rotation @ aligning_z(joint.axis))
    return [Solid(joint.parent, "joints", Marker.CYLINDER, along, scale, color)]


def coil(start: Array, stop: Array, radius: float) -> Array:
    """(COIL, 3): a helical spring between two points (3,), with straight ends of a tenth of its length."""
    along, first, second = _frame(start, stop)
    turn = np.linspace(0.0, 2.0 * np.pi * TURNS, COIL - 2)
    inner = start + np.outer(0.1 + 0.8 * np.linspace(0.0, 1.0, COIL - 2), along)
    inner += radius * (np.outer(np.cos(turn), first) + np.outer(np.sin(turn), second))
    return np.vstack([start, inner, stop])


def damper(start: Array, stop: Array, half_width: float) -> Array:
    """(DAMPER, 3): the segments of a damper between two points (3,)."""
    along, first, _ = _frame(start, stop)
    points: Array = start + np.outer(_PISTON[:, 0], along) + half_width * np.outer(_PISTON[:, 1], first)
    return points


def _frame(start: Array, stop: Array) -> tuple[Array, Array, Array]:
    """The way from start to stop, and two unit vectors across it; any two where the points meet."""
    along = stop - start
    length = float(np.linalg.norm(along))
    turn = aligning_z(along / length) if length > 1e-12 else np.eye(3)
    return along, turn[:, 0], turn[:, 1]


def _cross(radius: float, height: float) -> Array:
    """Diameters on both faces of something round, which show how it turns."""
    ends = [(-radius, 0.0), (radius, 0.0), (0.0, -radius), (0.0, radius)]
    return np.array([(x, y, z) for z in (-height, height) for x, y in ends])


def _tuples(points: Array) -> Points:
    return tuple((x, y, z) for x, y, z in points.tolist())
