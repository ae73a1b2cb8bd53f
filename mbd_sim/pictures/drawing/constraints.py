"""Constraints on the sheet: what points and wheels are constrained to, cables, gears and racks.

Wheels roll on planes, and points lie on lines, planes, curves and surfaces; knife edges are drawn too. Gears and racks
are pitch circles and pitch lines, dash-dotted, with marks for their teeth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import assert_never

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import aligning_z, unit_or_zero
from mbd_sim.mechanism.elements.constraints import (
    Cable,
    Clutch,
    Constraint,
    Coupling,
    Distance,
    Flat,
    KnifeEdge,
    Rolling,
    Surface,
)
from mbd_sim.mechanism.elements.contacts import Contact, Face
from mbd_sim.mechanism.elements.parts import GROUND, Attachment
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.drawing.forces import point_of
from mbd_sim.pictures.drawing.sheet import (
    AXIS_DASH,
    BACK,
    BODIES,
    FRONT,
    GRAY,
    INK,
    STEEL,
    WHITE,
    Projection,
    ScaledView,
    SheetPath,
    left_of,
)
from mbd_sim.pictures.drawing.symbols import (
    PlacedJoint,
    cable_paths,
    frame_on_part,
    hatched_line,
    place_joint,
    rope_paths,
)
from mbd_sim.pictures.shapes.curves import CurveLine, curve_lines, section_lines, surface_lines
from mbd_sim.pictures.shapes.palette import mixed
from mbd_sim.pictures.shapes.solids import circle, half_sizes

TOOTH_SPACING, TOOTH = 7.0, 2.6  # pt, from tooth to tooth, and half their height

PARALLEL = 1e-6
FITTING = 0.2  # largest difference of a wheel's radius from the pitch radius, relative to the latter
NUDGE = 0.02  # toward the eye, relative to the radius


def coupling_paths(
    page: ScaledView, mechanism: Mechanism, poses: Mapping[str, Pose], coupling: Coupling
) -> list[SheetPath]:
    """Two wheels, or a wheel and a rack or cable; other couplings, and wheels on skew axes, are not drawn."""
    joints = {
        joint.name: place_joint(page, mechanism, poses, joint)
        for joint in mechanism.all_joints.values()
        if joint.name in coupling.factors and joint.type in ("revolute", "prismatic")
    }
    if len(joints) != 2:
        return []
    (first, a), (second, b) = ((joints[name], factor) for name, factor in coupling.factors.items())
    if coupling.kind == "gear":
        return _gears(page, first, second, a / b)
    if coupling.kind == "rack":
        pinion, rack = (first, second) if first.joint.type == "revolute" else (second, first)
        return _rack(page, pinion, rack, -coupling.factors[pinion.joint.name] / coupling.factors[rack.joint.name])
    return []


def _gears(page: ScaledView, first: PlacedJoint, second: PlacedJoint, ratio: float) -> list[SheetPath]:
    """Pitch circles that touch: r1 + r2, or |r1 - r2| with internal teeth, equals the distance of the axes."""
    facing = float(first.axis @ second.axis)
    line = second.carrier_frame.position - first.carrier_frame.position
    distance = float(np.linalg.norm(line - (line @ first.axis) * first.axis))
    distance_by_radius = abs(1.0 + ratio * np.sign(facing))
    if abs(facing) < 1.0 - PARALLEL or distance == 0.0 or distance_by_radius < PARALLEL:
        return []
    radius = distance / distance_by_radius
    return [*_wheel(page, first, abs(ratio) * radius), *_wheel(page, second, radius)]


def _wheel(page: ScaledView, placed: PlacedJoint, radius: float) -> list[SheetPath]:
    """A pitch circle with teeth, on the face of the part's wheel if it has one of about that radius."""
    center = _wheel_center(page, placed, radius)
    plane = aligning_z(placed.axis)[:, :2].T
    count = max(round(2.0 * np.pi * radius * page.scale / TOOTH_SPACING), 8)
    pitch_circle = center + radius * circle(np.linspace(0.0, 2.0 * np.pi, 73)) @ plane
    outward = circle(2.0 * np.pi * np.arange(count) / count) @ plane
    half = TOOTH / page.scale
    teeth = [np.array([center + (radius - half) * out, center + (radius + half) * out]) for out in outward]
    return _pitch_line_and_teeth(page, pitch_circle, teeth, page.depth(center) + NUDGE * radius)


def _wheel_center(page: ScaledView, placed: PlacedJoint, radius: float) -> Array:
    """The center (3,) of the face toward the eye of a part's wheel; the joint's point where there is no such wheel."""
    part, center = placed.mover_part, placed.mover_frame.position
    if part is None:
        return center
    for shape in part.shapes:
        pose = placed.mover_frame @ frame_on_part(placed, part).inverse() @ shape.pose
        size = half_sizes(shape)
        fits = shape.kind in ("cylinder", "disc", "ring") and abs(size[0] - radius) < FITTING * radius
        if fits and abs(float(pose.rotation[:, 2] @ placed.axis)) > 1.0 - PARALLEL:
            half_width = size[2] if shape.kind == "cylinder" else 0.0
            center = pose.position + half_width * np.sign(page.depth(placed.axis)) * placed.axis
    return center


def _rack(page: ScaledView, pinion: PlacedJoint, rack: PlacedJoint, radius: float) -> list[SheetPath]:
    """The pinion's pitch circle and the rack's pitch line where its part reaches the pinion, otherwise a cable."""
    along = rack.axis
    contact = pinion.carrier_frame.position + radius * np.cross(along, pinion.axis)
    low, high = 0.0, 0.0
    if rack.mover_part is not None:
        low, high = rack.mover_frame.position @ along + (rack.mover_span(along) or (0.0, 0.0)) - contact @ along
    if abs(float(along @ pinion.axis)) > PARALLEL:
        return []
    depth = page.depth(contact) + NUDGE * abs(radius)
    if low <= 0.0 <= high:
        half, out = TOOTH / page.scale, unit_or_zero(np.cross(along, pinion.axis))
        count = max(round((high - low) * page.scale / TOOTH_SPACING), 1)
        feet = [contact + at * along for at in low + (high - low) * (np.arange(count) + 0.5) / count]
        teeth = [np.array([foot - half * out, foot + half * out]) for foot in feet]
        line = contact + np.outer([low, high], along)
        return [*_wheel(page, pinion, abs(radius)), *_pitch_line_and_teeth(page, line, teeth, depth)]
    end = contact + (low if low > 0.0 else high) * along
    return cable_paths(page, np.array([contact, end]), depth)


def _pitch_line_and_teeth(page: ScaledView, line: Array, teeth: list[Array], depth: float) -> list[SheetPath]:
    layer = FRONT if page.view.planar else BODIES
    marks = [SheetPath(page.project(tooth), edge=INK, width=0.9, layer=layer, depth=depth) for tooth in teeth]
    return [SheetPath(page.project(line), edge=INK, width=0.7, dash=AXIS_DASH, layer=layer, depth=depth), *marks]


PLANE = (246, 247, 249)
BLADE_HALF_LENGTH, BLADE_HALF_WIDTH = 26.0, 3.4  # pt
HALF_LENGTH, BEYOND = (
    0.6,
    0.15,
)  # of a plane or a line, and beyond its outermost points; relative to the mechanism's size


@dataclass(frozen=True, eq=False)
class _Guide:
    """The plane (one normal) or line (two) through `base` on which `point` lies; `normals` are in the base's part.

    `hatched` is -1 for hatching below a plane, where a one-sided point cannot be, 1 for above it, and 0 for none.
    """

    base: Attachment
    point: Attachment
    normals: Array
    hatched: float


@dataclass(frozen=True, eq=False)
class _DrawnGuide:
    """A plane or line through `base` (3,) that guides some `points` (3,), in ground's frame, see `_Guide`."""

    base: Array
    points: list[Array]
    normals: Array
    hatched: float

    def span(self, along: Array, size: float) -> tuple[Array, float]:
        """The middle (3,) of the feet of the points along a direction (3,), and how far it is drawn on both sides."""
        feet = [at - sum(((at - self.base) @ normal) * normal for normal in self.normals) for at in self.points]
        places = [float(foot @ along) for foot in feet]
        middle, reach = 0.5 * (max(places) + min(places)), 0.5 * (max(places) - min(places))
        return feet[0] + (middle - places[0]) * along, max(HALF_LENGTH * size, reach + BEYOND * size)


def constraint_paths(
    page: ScaledView,
    mechanism: Mechanism,
    poses: Mapping[str, Pose],
    size: float,
    start: Mapping[str, Pose] | None = None,
) -> list[SheetPath]:
    """The symbols of the constraints, except rods of constant length, and curves and surfaces; `size` in m.

    :param start: other poses, to which the planes and lines of ground extend as well, so that they do not move along
        with what they guide.
    """
    paths: list[SheetPath] = []
    drawn: dict[tuple[float, ...], _DrawnGuide] = {}
    guides: list[_Guide | None] = []
    for constraint in mechanism.constraints:
        paths += _own_symbol(page, mechanism, poses, constraint)
        guides.append(_guide_of(constraint))
    for guide in [*guides, *map(_face_of, mechanism.contacts)]:
        if guide is None:
            continue
        base = point_of(poses, guide.base)
        normals = guide.normals @ _rotation(poses, guide.base).T
        plane = (*normals[0].round(6), round(float(base @ normals[0]) / size, 6))
        key = plane if len(normals) == 1 else (*plane, float(len(drawn)))  # a plane is drawn once, for all its points
        points = drawn.setdefault(key, _DrawnGuide(base, [], normals, guide.hatched)).points
        points.append(point_of(poses, guide.point))
        if start is not None and guide.base.part == GROUND:
            points.append(point_of(start, guide.point))
    for one in drawn.values():
        paths += _plane_or_line(page, one, size)
    return paths


def _own_symbol(
    page: ScaledView, mechanism: Mechanism, poses: Mapping[str, Pose], constraint: Constraint
) -> list[SheetPath]:
    match constraint:
        case Cable(points=points, length=length, bound=bound):
            line = np.array([point_of(poses, at) for at in points])
            if bound == "at_most":
                return rope_paths(page, mechanism, line, length)
            return cable_paths(page, line, page.depth(line.mean(axis=0)))
        case Coupling():
            return coupling_paths(page, mechanism, poses, constraint)
        case KnifeEdge():
            return _blade(page, poses, constraint)
        case Flat() | Rolling():
            return []
        case Clutch():
            return []  # between joints, whose symbols show its place
        case Distance() | Surface():
            return []  # drawn by `two_point_paths` and `curve_paths`
        case _:
            assert_never(constraint)


def _guide_of(constraint: Constraint) -> _Guide | None:
    match constraint:
        case Flat(base=base, point=point, normals=normals, bound=bound):
            hatched = 1.0 if bound == "at_most" else -1.0 if bound == "at_least" else _below(base)
            return _Guide(base, point, np.atleast_2d(normals), hatched)
        case Rolling(plane=plane, center=center, normal=normal):
            return _Guide(plane, center, np.atleast_2d(normal), _below(plane))
        case KnifeEdge(plane=plane, point=point, normal=normal):
            return _Guide(plane, point, np.atleast_2d(normal), _below(plane))
        case Distance() | Surface() | Coupling() | Cable() | Clutch():
            return None
        case _:
            assert_never(constraint)


def _face_of(contact: Contact) -> _Guide | None:
    """The plane of a contact; only that of a ground is drawn, since a part has its own shape."""
    face = contact.second
    if not isinstance(face, Face) or face.at.part != GROUND:
        return None
    return _Guide(face.at, contact.first.at, np.atleast_2d(face.normal), -1.0)


def _below(base: Attachment) -> float:
    return -1.0 if base.part == GROUND else 0.0


def _plane_or_line(page: ScaledView, guide: _DrawnGuide, size: float) -> list[SheetPath]:
    """A plane (one normal) or a line (two), near the points that it guides."""
    normals, hatched = guide.normals, guide.hatched
    if len(normals) == 2:
        along = unit_or_zero(np.cross(normals[0], normals[1]))
        foot, reach = guide.span(along, size)
        ends = page.project(np.array([foot - reach * along, foot + reach * along]))
        return [SheetPath(ends, edge=GRAY, width=1.4, dash=(7.0, 3.0), layer=BACK, depth=page.depth(foot))]
    normal = unit_or_zero(normals[0])
    if abs(float(normal @ page.view.toward)) < 1e-6:
        along = np.cross(page.view.toward, normal)
        foot, reach = guide.span(along, size)
        ends = page.project(np.array([foot - reach * along, foot + reach * along]))
        if hatched:
            return hatched_line(ends[0], ends[1], hatched * page.direction(normal))
        return [SheetPath(ends, edge=INK, width=1.4, layer=BACK)]
    if page.view.planar:
        return []
    one, other = aligning_z(normal)[:, :2].T
    (first, half), (second, width) = guide.span(one, size), guide.span(other, size)
    middle = first + ((second - first) @ other) * other
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) @ np.array([half * one, width * other])
    return [SheetPath(page.project(middle + corners), edge=GRAY, fill=PLANE, width=0.8, closed=True, layer=BACK)]


def _blade(page: ScaledView, poses: Mapping[str, Pose], edge: KnifeEdge) -> list[SheetPath]:
    """A lens along the edge, pointed at both ends."""
    along = page.direction(_rotation(poses, edge.point) @ unit_or_zero(edge.direction))
    half_length = BLADE_HALF_LENGTH * float(np.hypot(*along))
    if half_length < 2.0 * BLADE_HALF_WIDTH:
        return []
    angles = np.linspace(0.0, np.pi, 13)
    sideways = np.concatenate([np.sin(angles), -np.sin(angles)]) * BLADE_HALF_WIDTH
    forward = np.concatenate([-np.cos(angles), np.cos(angles)]) * half_length
    at = point_of(poses, edge.point)
    points = page.project(at) + np.outer(forward, unit_or_zero(along)) + np.outer(sideways, left_of(along))
    return [SheetPath(points, edge=WHITE, fill=INK, width=0.8, closed=True, layer=FRONT, depth=page.depth(at))]


def _rotation(poses: Mapping[str, Pose], at: Attachment) -> Array:
    return np.eye(3) if at.part == GROUND else poses[at.part].rotation


def constraint_curves(mechanism: Mechanism, poses: Mapping[str, Pose], view: Projection) -> list[CurveLine]:
    """The lines of all curves and surfaces, in ground's frame in m."""
    curves: list[CurveLine] = []
    for constraint in mechanism.constraints:
        if isinstance(constraint, Surface):
            point, carrier = point_of(poses, constraint.point), constraint.base.part
            rotation = np.eye(3) if carrier == GROUND else poses[carrier].rotation
            base = Pose(point_of(poses, constraint.base), rotation @ constraint.axes)
            if len(constraint.equations) > 1:
                curves += curve_lines(constraint, point, base)
            elif view.planar:
                curves += section_lines(constraint, point, base, view.toward)
            else:
                curves += surface_lines(constraint, point, base, view.toward)
    return curves


def curve_paths(page: ScaledView, curves: Sequence[CurveLine]) -> list[SheetPath]:
    """A curve as a wire, a surface as thin lines, paler on its far side."""
    paths: list[SheetPath] = []
    for curve in sorted(curves, key=lambda curve: (curve.kind != "net", curve.front)):
        points = page.project(curve.points)
        match curve.kind:
            case "outline":
                paths.append(SheetPath(points, edge=GRAY, width=1.3, layer=BACK))
            case "net":
                color = STEEL if curve.front else mixed(STEEL, WHITE, 0.6)
                paths.append(SheetPath(points, edge=color, width=0.7, layer=BACK))
            case "curve":
                paths.append(SheetPath(points, edge=INK, width=3.2, layer=BACK))
                paths.append(SheetPath(points, edge=STEEL, width=1.6, layer=BACK))
            case _:
                assert_never(curve.kind)
    return paths
