"""The solids that stand for the shapes of a part, the same in Rerun, in RViz and in drawings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbd_sim.appearance.polylines import circle
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Part, Shape

DISC_THICKNESS = 0.08  # relative to the radius
PLATE_THICKNESS = 0.02  # relative to the shorter side
RING_TUBE = 0.04  # radius of the tube, relative to that of the ring
POINT_MASS_RADIUS = 0.02  # of the ball at the mass center of a part without shapes, relative to the mechanism's size
LINE_WIDTH = 0.006  # relative to the mechanism's size


@dataclass(frozen=True)
class Rod:
    """A rod along z of a `length` in m between the centers of its rounded ends."""

    length: float
    radius: float


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about z; a disc is a flat one."""

    length: float
    radius: float
    disc: bool = False

    @property
    def mark_height(self) -> float:
        """The height above the center at which lines lie visibly on its faces, m."""
        return 0.042 * self.radius if self.disc else 0.505 * self.length


@dataclass(frozen=True)
class Ring:
    """A ring about z, a torus whose tube has the radius `tube`."""

    radius: float
    tube: float


@dataclass(frozen=True)
class Box:
    """A box with edges of `size` (x, y, z) along the axes."""

    size: tuple[float, float, float]


@dataclass(frozen=True)
class Ball:
    """A ball; a `particle` is a point mass, whose radius is only that of its picture."""

    radius: float
    particle: bool = False


Solid = Rod | Cylinder | Ring | Box | Ball


def solid_of(shape: Shape) -> Solid:
    """The solid of a shape, centered on the shape's pose.

    :raises ValueError: there is no such kind of shape.
    """
    match shape.kind, shape.size:
        case "rod", (length, radius):
            return Rod(length, radius)
        case "cylinder", (length, radius):
            return Cylinder(length, radius)
        case "disc", (radius,):
            return Cylinder(DISC_THICKNESS * radius, radius, disc=True)
        case "ring", (radius,):
            return Ring(radius, RING_TUBE * radius)
        case "plate", (x, y):
            return Box((x, y, PLATE_THICKNESS * min(x, y)))
        case "block", (x, y, z):
            return Box((x, y, z))
        case ((("sphere" | "particle") as kind), (radius,)):
            return Ball(radius, particle=kind == "particle")
        case _:
            raise ValueError(f"no solid for a shape of kind '{shape.kind}' and size {shape.size}")


def half_sizes(shape: Shape) -> Array:
    """Half the size (3,) in m of the box around a shape, along the shape's axes; plates, discs and rings are flat."""
    match shape.kind, shape.size:
        case (("rod" | "cylinder"), (length, radius)):
            return np.array([radius, radius, length / 2.0])
        case (("disc" | "ring"), (radius,)):
            return np.array([radius, radius, 0.0])
        case "plate", (x, y):
            return np.array([x, y, 0.0]) / 2.0
        case "block", (x, y, z):
            return np.array([x, y, z]) / 2.0
    return np.full(3, shape.size[0])


def diameters(radius: float, heights: tuple[float, ...], *, crossed: bool = False) -> list[Array]:
    """Lines (2, 3) along x at heights z, and along y with `crossed`: they show how something round turns about z."""
    lines = [np.array([[-radius, 0.0, z], [radius, 0.0, z]]) for z in heights]
    if crossed:
        lines += [np.array([[0.0, -radius, z], [0.0, radius, z]]) for z in heights]
    return lines


def meridian(radius: float) -> Array:
    """A circle (33, 3) about y, slightly larger than a ball of this radius: it shows how the ball turns."""
    x, z = (1.005 * radius * circle(np.linspace(0.0, 2.0 * np.pi, 33))).T
    return np.column_stack([x, 0.0 * x, z])


def skeleton(part: Part) -> list[Array]:
    """Lines (2, 3) that stand for a part without shapes: from its origin to its points, or else its mass center."""
    ends = [pose.position for pose in part.points.values()] or [part.center]
    return [np.array([np.zeros(3), end]) for end in ends if np.any(end)]


def is_invisible(part: Part) -> bool:
    """Whether a part has neither mass nor shape nor mesh: it only carries coordinates, and is not drawn."""
    return part.mass == 0.0 and not part.shapes and not part.meshes
