"""Contacts between shapes of parts as plain records.

Each contact is one gap between two bodies; shapes with edges have several of them, such as a block its eight corners.
Directions (3,) are unit vectors in the frame of the part that carries them; SI units throughout.
"""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.constraints import ContactLaw
from mbd_sim.mechanism.elements.parts import Attachment
from mbd_sim.mechanism.outlines.pieces import Outline
from mbd_sim.mechanism.values.expression import TimeExpression

CAM_ANGLE = "angle"  # the variable of a cam's profile
FIRST_RIM, LAST_RIM = " rim -", " rim +"  # of a cylinder, in the quantities of contacts


@dataclass(frozen=True, eq=False)
class Ball:
    """A sphere; with the radius 0 a point."""

    at: Attachment
    radius: float


@dataclass(frozen=True, eq=False)
class Rim:
    """The circle around `axis`: the edge of a disc, or one of the two of a cylinder of a `length` in m.

    The `first` rim of a cylinder is that from which `axis` leads to the other one.
    """

    at: Attachment
    axis: Array
    radius: float
    length: float = 0.0
    first: bool = True


@dataclass(frozen=True, eq=False)
class RimPoint:
    """A point of the lower rim, in the `direction` (3,) from its center; it touches a plane only if the rim is flat.

    `at` is the center of the first rim; the other is at the distance `length` in m along `axis`.
    """

    at: Attachment
    axis: Array
    radius: float
    length: float
    direction: Array


@dataclass(frozen=True, eq=False)
class EllipsoidBody:
    """An ellipsoid with its center at `at` and `radii` in m along the columns of `axes` (3, 3)."""

    at: Attachment
    axes: Array
    radii: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Barrel:
    """A cylinder around `axis` of a `length` in m, with its center at `at`; a disc or a ring has none."""

    at: Attachment
    axis: Array
    radius: float
    length: float


@dataclass(frozen=True, eq=False)
class ConeBody:
    """A cone around `axis`, which leads to its tip, of a `length` in m; half of its height is at `at`."""

    at: Attachment
    axis: Array
    radius: float
    length: float


@dataclass(frozen=True, eq=False)
class Face:
    """A plane; its `normal` points away from the material."""

    at: Attachment
    normal: Array


@dataclass(frozen=True, eq=False)
class Cam:
    """A disc in the x-y plane of `axes` (3, 3): its `profile` is the radius in m as an expression of `angle` in rad."""

    at: Attachment
    axes: Array
    profile: TimeExpression


@dataclass(frozen=True, eq=False)
class Solid:
    """A convex body: the hull of its `vertices` (n, 3) in the frame of the part, rounded by a `radius`.

    `faces` are loops of indices of vertices, counterclockwise seen from outside; a plate has two with the same
    vertices, a rod and a point have none. `at` is the origin of the part.
    """

    at: Attachment
    vertices: Array
    faces: tuple[tuple[int, ...], ...]
    radius: float

    @property
    def thin(self) -> bool:
        """Whether it has no volume: a plate, a rod or a point without a radius."""
        return self.radius == 0.0 and len(self.faces) <= 2

    @property
    def edges(self) -> tuple[tuple[int, int], ...]:
        """The pairs of vertices that edges connect, the smaller index first."""
        if len(self.vertices) == 2:
            return ((0, 1),)
        sides = [(face[k - 1], vertex) for face in self.faces for k, vertex in enumerate(face)]
        return tuple(sorted({(min(side), max(side)) for side in sides}))


@dataclass(frozen=True, eq=False)
class PlanarBody:
    """An outline in the x-y plane of `axes` (3, 3) through `origin` (3,), endless across it; a circle is a roller.

    `at` is the origin of the part, in whose frame these are. What else touches it counts as its shadow in this plane.
    """

    at: Attachment
    origin: Array
    axes: Array
    outline: Outline


@dataclass(frozen=True, eq=False)
class Cluster:
    """Balls and rims of a part and of those that are welded to it, in the frame of the part, whose origin is `at`.

    Each touches a plane for itself; few touch it at a time. `names` are those of the shapes to which they belong.
    """

    at: Attachment
    bodies: tuple[Ball | Rim, ...]
    names: tuple[str, ...] = ()


Curved = Barrel | ConeBody | EllipsoidBody  # those that touch with changing features
ContactBody = Cluster | Ball | Rim | RimPoint | EllipsoidBody | Barrel | ConeBody | Face | Cam | Solid | PlanarBody


@dataclass(frozen=True)
class ComplianceLaw:
    """A compliant contact (Hunt & Crossley 1975): the normal force k δⁿ (1 + c δ') at the depth δ, never negative.

    Its `friction` μ is smooth at rest: it falls to zero with slip below the speed `regularization`.
    """

    stiffness: float
    exponent: float
    damping: float
    friction: float
    regularization: float


@dataclass(frozen=True, eq=False)
class Contact:
    """A pair of bodies that cannot penetrate each other; `inside` is whether the second one encloses the first.

    Pairs are ball and face, rim and face, rim point and face, ellipsoid and face, ball and ball, ball and barrel, two
    barrels with parallel axes, ball and cam, barrel and cam with parallel axes, cam and face. `names` are those of both
    for people, `quantity` both and the corner or rim in one word. Two solids touch in up to as many points as they have
    `slots`, with changing vertices, edges and faces, and a ball has one at the side, the edges and ends of a barrel.
    `still` is the axis of ground along which both are prisms and nothing moves; None in space.
    """

    name: str
    quantity: str
    names: tuple[str, str]
    first: ContactBody
    second: ContactBody
    law: ContactLaw | ComplianceLaw
    inside: bool = False
    slots: int = 0
    still: int | None = None

    @property
    def rigid(self) -> bool:
        """Whether it has no compliance: then it is one-sided, and its motion has events."""
        return isinstance(self.law, ContactLaw)
