"""The symbols that drawings share: joints at a state, elements between two points, ropes, and ground.

A joint has the part that carries it, the part that moves, its frames and its axes. The elements between points are
springs, dampers, rods, cables and friction. Ropes can pull but not push: taut they are straight, slack they hang with
their own length. Ground and its supports are hatched lines, brackets, bearings, walls and posts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import unit_or_zero
from mbd_sim.mechanism.elements.parts import GROUND, Joint, Part
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.pictures.drawing.parts import span_along
from mbd_sim.pictures.drawing.sheet import (
    BACK,
    BODIES,
    FRONT,
    GRAY,
    INK,
    LINE,
    STEEL,
    WHITE,
    ScaledView,
    SheetPath,
    arc,
    left_of,
)
from mbd_sim.pictures.shapes.extent import frame_of
from mbd_sim.pictures.shapes.solids import flat_coil, spiral


@dataclass(frozen=True, eq=False)
class PlacedJoint:
    """A joint at a state. The carrier is ground wherever ground is one of the two parts.

    `carrier_frame` and `mover_frame` are the joint's frames on the two parts, and `axis` and `second` (3,) its axes, in
    ground's frame. `support_direction` (2,) is the direction on the sheet in which there is room for ground.
    """

    joint: Joint
    carrier_frame: Pose
    mover_frame: Pose
    carrier_part: Part | None
    mover_part: Part | None
    axis: Array
    second: Array
    support_direction: Array

    @property
    def grounded(self) -> bool:
        """Whether the joint is on ground."""
        return self.carrier_part is None

    def elastic(self, index: int = 0) -> bool:
        """Whether one of its coordinates has a spring."""
        return bool(self.joint.stiffness[index : index + 1].any()) or self.joint.spring is not None

    def damped(self, index: int = 0) -> bool:
        """Whether one of its coordinates has a damper."""
        return bool(self.joint.damping[index : index + 1].any()) or self.joint.damper is not None

    def mover_span(self, direction: Array, kinds: tuple[str, ...] = ()) -> tuple[float, float] | None:
        """The smallest and largest coordinate in m of the moving part along `direction` (3,), from the mover's frame.

        Only shapes of the given `kinds` count, all where none is given; None where there is no such shape.
        """
        return self._span(self.mover_part, self.mover_frame, direction, kinds)

    def carrier_span(self, direction: Array) -> tuple[float, float] | None:
        """The span of the carrying part along a direction, from the carrier's frame."""
        return self._span(self.carrier_part, self.carrier_frame, direction, ())

    def _span(
        self, part: Part | None, frame: Pose, direction: Array, kinds: tuple[str, ...]
    ) -> tuple[float, float] | None:
        if part is None:
            return None
        return span_along(part, frame_on_part(self, part), frame.rotation.T @ direction, kinds)

    @property
    def displacement(self) -> float:
        """The displacement in m of the mover's frame along the axis."""
        return float((self.mover_frame.position - self.carrier_frame.position) @ self.axis)


def place_joint(page: ScaledView, mechanism: Mechanism, poses: Mapping[str, Pose], joint: Joint) -> PlacedJoint:
    """A joint of the mechanism at the poses of its parts."""
    first = frame_of(poses, joint.parent, joint.parent_pose)
    second = frame_of(poses, joint.child, joint.child_pose)
    names, frames = [joint.parent, joint.child], [first, second]
    if joint.child == GROUND:
        names.reverse()
        frames.reverse()
    parts = [mechanism.parts.get(name) for name in names]
    center = frames[1].position
    if parts[1] is not None:
        center = poses[parts[1].name].position + poses[parts[1].name].rotation @ middle(parts[1])
    return PlacedJoint(
        joint=joint,
        carrier_frame=frames[0],
        mover_frame=frames[1],
        carrier_part=parts[0],
        mover_part=parts[1],
        axis=first.rotation @ joint.axis,
        second=first.rotation @ joint.second,
        support_direction=_support_direction(page, center - frames[0].position),
    )


def frame_on_part(placed: PlacedJoint, part: Part) -> Pose:
    """The joint's frame in the frame of one of its parts."""
    return placed.joint.parent_pose if placed.joint.parent == part.name else placed.joint.child_pose


def middle(part: Part) -> Array:
    """The middle (3,) of a part, for symbols and names: its mass center, or that of its shapes if it has no mass."""
    if part.mass or not part.shapes:
        return part.center
    return np.asarray(np.mean([shape.pose.position for shape in part.shapes], axis=0))


def _support_direction(page: ScaledView, toward_part: Array) -> Array:
    """Up for parts that hang from or lie beside the joint, down for those that stand on it or are centered on it."""
    projected = page.project(toward_part)
    stands = projected[1] > 0.35 * abs(projected[0]) or float(np.hypot(*projected)) < 1.0
    return np.array([0.0, -1.0 if stands else 1.0])


AMPLITUDE, PITCH = 5.6, 7.0  # pt
MAX_TURNS = 11
BESIDE = 8.5  # pt, from the center line to a spring and its damper in parallel
MIN_LENGTH = 2.0  # pt
SAW = 4.5  # pt, from tooth to tooth


def spring(start: Array, stop: Array, layer: int = BODIES, depth: float = 0.0) -> list[SheetPath]:
    """A coil between two points (2,), with a white rim that sets it off from the background."""
    length = float(np.hypot(*(stop - start)))
    if length < MIN_LENGTH:
        return []
    along, end = unit_or_zero(stop - start), float(np.clip(0.12 * length, 0.0, 14.0))
    turns = int(np.clip(round((length - 2.0 * end) / PITCH), 4, MAX_TURNS))
    forward, sideways = flat_coil(length, end, turns, AMPLITUDE).T
    coil = start + np.outer(forward, along) + np.outer(sideways, left_of(along))
    points = np.vstack([start, coil, stop])
    rim = SheetPath(coil, edge=WHITE, width=3.0, layer=layer, depth=depth)
    return [rim, SheetPath(points, edge=INK, width=LINE, layer=layer, depth=depth)]


def damper(start: Array, stop: Array, layer: int = BODIES, depth: float = 0.0) -> list[SheetPath]:
    """A dashpot between two points (2,)."""
    length = float(np.hypot(*(stop - start)))
    if length < MIN_LENGTH:
        return []
    along, across = unit_or_zero(stop - start), left_of(stop - start)
    middle, half, box = 0.5 * (start + stop), 5.0, min(11.0, 0.3 * length)
    cup = np.array([middle + box * along + half * across, middle - box * along + half * across,
                    middle - box * along - half * across, middle + box * along - half * across])  # fmt: skip
    piston = middle + 0.25 * box * along
    lines = [
        np.array([start, middle - box * along]),
        cup,
        np.array([piston - 0.75 * half * across, piston + 0.75 * half * across]),
        np.array([piston, stop]),
    ]
    body = SheetPath(cup, edge=None, fill=WHITE, closed=True, layer=layer, depth=depth)
    strokes = [
        SheetPath(line, edge=INK, width=w, layer=layer, depth=depth)
        for line, w in zip(lines, (LINE, LINE, 2.0, LINE), strict=True)
    ]
    return [body, *strokes]


def spring_and_damper(
    start: Array, stop: Array, elastic: bool, damped: bool, layer: int = BODIES, depth: float = 0.0
) -> list[SheetPath]:
    """A spring, a damper, or both side by side."""
    if not (elastic and damped):
        draw = spring if elastic else damper
        return draw(start, stop, layer, depth) if elastic or damped else []
    length = float(np.hypot(*(stop - start)))
    if length < MIN_LENGTH:
        return []
    along, across = unit_or_zero(stop - start), BESIDE * left_of(stop - start)
    inset = min(7.0, 0.15 * length)
    first, last = start + inset * along, stop - inset * along
    bars = [
        SheetPath(np.array(line), edge=INK, width=LINE, layer=layer, depth=depth)
        for line in ([start, first], [last, stop], [first - across, first + across], [last - across, last + across])
    ]
    return [
        *spring(first + across, last + across, layer, depth),
        *damper(first - across, last - across, layer, depth),
        *bars,
    ]


def link(start: Array, stop: Array, layer: int = BODIES, depth: float = 0.0) -> list[SheetPath]:
    """A massless rod that keeps two points (2,) at a distance: dashed."""
    ends = [SheetPath(arc(at, 2.2), edge=INK, fill=INK, closed=True, layer=layer, depth=depth) for at in (start, stop)]
    line = np.array([start, stop])
    rim = SheetPath(line, edge=WHITE, width=3.0, layer=layer, depth=depth)
    return [rim, SheetPath(line, edge=INK, width=LINE, dash=(5.0, 3.0), layer=layer, depth=depth), *ends]


def cable_paths(page: ScaledView, line: Array, depth: float) -> list[SheetPath]:
    """A taut cable along a line (n, 3) in ground's frame, with a white rim."""
    widths = ((WHITE, 3.0), (INK, LINE))
    return [SheetPath(page.project(line), edge=edge, width=w, layer=BODIES, depth=depth) for edge, w in widths]


def friction_teeth(start: Array, stop: Array, side: Array, layer: int, depth: float = 0.0) -> SheetPath:
    """Rough faces between two points (2,): saw teeth on the line, on the side opposite to `side` (2,)."""
    along, length = unit_or_zero(stop - start), float(np.hypot(*(stop - start)))
    count = max(round(length / SAW), 3)
    foot = start + np.outer(np.repeat(np.arange(count + 1), 2)[1:-1] * length / count, along)
    foot[1::2] -= 0.8 * SAW * unit_or_zero(side)
    return SheetPath(foot, edge=INK, width=1.2, layer=layer, depth=depth)


def brake_shoe(at: Array, away: Array, layer: int, depth: float = 0.0) -> list[SheetPath]:
    """A shoe that rubs on a pin, on the side `away` (2,)."""
    angle = float(np.arctan2(away[1], away[0]))
    shoe = np.vstack([arc(at, 7.0, angle - 0.9, angle + 0.9, 15), arc(at, 11.0, angle + 0.9, angle - 0.9, 15)])
    return [SheetPath(shoe, edge=INK, fill=INK, width=0.8, closed=True, layer=layer, depth=depth)]


def torsion_spring(at: Array, layer: int, depth: float = 0.0) -> list[SheetPath]:
    """A spiral spring about a pin."""
    points = at + spiral(6.2, 13.5, 2.25)
    rim = SheetPath(points, edge=WHITE, width=2.4, layer=layer, depth=depth)
    return [rim, SheetPath(points, edge=INK, width=0.9, layer=layer, depth=depth)]


PIN = 4.6  # pt, radius of a pin
HATCH, SPACING = 6.0, 5.0  # pt
SUPPORT = 17.0  # pt, from a pin to the ground below it


def hatched_line(start: Array, stop: Array, side: Array, layer: int = BACK, depth: float = 0.0) -> list[SheetPath]:
    """A line from `start` (2,) to `stop` (2,) with hatching on its `side`, a direction (2,)."""
    along = unit_or_zero(stop - start)
    across = left_of(along) * (1.0 if left_of(along) @ side >= 0.0 else -1.0)
    length = float(np.hypot(*(stop - start)))
    count = max(round(length / SPACING), 2)
    strokes = [
        SheetPath(
            np.array([foot, foot + HATCH * (across - 0.75 * along)]), edge=GRAY, width=0.7, layer=layer, depth=depth
        )
        for foot in (start + along * length * (i + 0.75) / count for i in range(count))
    ]
    return [*strokes, SheetPath(np.array([start, stop]), edge=INK, width=1.4, layer=layer, depth=depth)]


def support(at: Array, direction: Array, layer: int = BACK, depth: float = 0.0) -> list[SheetPath]:
    """A bracket from a pin to hatched ground in `direction` (2,) from it."""
    down, across = unit_or_zero(direction), left_of(direction)
    foot = at + SUPPORT * down
    bracket = np.array([at + 0.9 * PIN * across, foot + 11.0 * across, foot - 11.0 * across, at - 0.9 * PIN * across])
    body = SheetPath(bracket, fill=STEEL, closed=True, layer=layer, depth=depth)
    return [*hatched_line(foot - 17.0 * across, foot + 17.0 * across, down, layer, depth), body]


def bearing(at: Array) -> list[SheetPath]:
    """A bearing in ground, seen along its axis."""
    spokes = [
        SheetPath(np.array([at + 10.5 * d, at + 15.5 * (d + 0.35 * left_of(d))]), edge=GRAY, width=0.7, layer=BACK)
        for d in (np.array([np.cos(a), np.sin(a)]) for a in np.linspace(0.0, 2.0 * np.pi, 14, endpoint=False))
    ]
    return [*spokes, SheetPath(arc(at, 10.5), fill=STEEL, width=1.2, closed=True, layer=BACK)]


def pin(at: Array) -> list[SheetPath]:
    """A pin seen along its axis."""
    return [SheetPath(arc(at, PIN), edge=INK, fill=WHITE, width=1.3, closed=True, layer=FRONT)]


def ball(at: Array, away: Array, depth: float, layer: int) -> list[SheetPath]:
    """A ball in a socket that opens opposite to the direction `away` (2,)."""
    angle = float(np.arctan2(away[1], away[0]))
    socket = arc(at, 8.6, angle - 1.75, angle + 1.75, 25)
    return [
        SheetPath(socket, edge=INK, fill=STEEL, width=1.3, closed=True, layer=layer, depth=depth),
        SheetPath(arc(at, 6.4), edge=INK, fill=WHITE, width=1.2, closed=True, layer=layer, depth=depth),
        SheetPath(arc(at + np.array([-1.9, 2.1]), 1.5), edge=None, fill=STEEL, closed=True, layer=layer, depth=depth),
    ]


def wall(at: Array, away: Array, depth: float = 0.0, layer: int = BACK) -> list[SheetPath]:
    """A short piece of hatched ground at the end of a spring, with the hatching in the direction `away` (2,)."""
    across = left_of(away)
    return hatched_line(at - 13.0 * across, at + 13.0 * across, away, layer, depth)


def post(at: Array, direction: Array, length: float, depth: float, layer: int) -> list[SheetPath]:
    """A short post on hatched ground in `direction` (2,) from its end."""
    down, across = unit_or_zero(direction), left_of(direction)
    foot = at + length * down
    stem = SheetPath(np.array([at, foot]), edge=INK, width=3.2 * LINE, layer=layer, depth=depth)
    inside = SheetPath(np.array([at, foot]), edge=STEEL, width=1.6 * LINE, layer=layer, depth=depth)
    return [stem, inside, *hatched_line(foot - 13.0 * across, foot + 13.0 * across, down, layer, depth)]


TAUT = 1e-6  # of the length that may be missing
POINTS = 33  # of the curve of a slack rope
HALVINGS = 60


def rope_paths(page: ScaledView, mechanism: Mechanism, points: Array, length: TimeExpression) -> list[SheetPath]:
    """A rope along points (n, 3) in ground's frame; one whose length varies with time is drawn straight."""
    between = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    whole = between if length.variables else length.at(0.0)
    line = points
    if whole > between * (1.0 + TAUT):
        gravity = float(np.linalg.norm(mechanism.gravity))
        down = mechanism.gravity / gravity if gravity else np.array([0.0, 0.0, -1.0])
        excess = (whole - between) / (len(points) - 1)
        line = np.vstack([hanging(*ends, excess, down) for ends in pairwise(points)])
    return cable_paths(page, line, page.depth(points.mean(axis=0)))


def hanging(start: Array, stop: Array, excess: float, down: Array) -> Array:
    """A parabola (n, 3) from `start` to `stop`, longer than their distance by `excess` in m, that sags along `down`."""
    parameter = np.linspace(0.0, 1.0, POINTS)[:, None]
    straight, shape = start + parameter * (stop - start), 4.0 * parameter * (1.0 - parameter)
    wanted = float(np.linalg.norm(stop - start)) + excess
    low, high = 0.0, wanted  # a sag as deep as the whole length makes the line longer than that
    for _ in range(HALVINGS):
        sag = 0.5 * (low + high)
        line = straight + sag * shape * down
        too_long = np.linalg.norm(np.diff(line, axis=0), axis=1).sum() > wanted
        low, high = (low, sag) if too_long else (sag, high)
    return np.asarray(straight + low * shape * down)
