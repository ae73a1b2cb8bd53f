"""The geometry of contacts between shapes: their distance, their normal, and where they touch.

It holds for any frames, those of rigid contacts and those of compliant ones. The gradient of a distance is the unit
normal where it is zero, so that its multiplier is the normal force.

An upright disc touches a plane in the lowest point of its rim. As it falls flat, that point runs around the rim ever
faster, and it is not defined where the disc lies flat. Below a small tilt fixed points of the rim therefore protrude
beyond the plane of the disc, so that it rests on them, and its lowest point is withdrawn. With the tilt s, the sine of
the angle between the axis and the normal, points protrude by `BULGE` r s² (1 - x) / (1 + x)², x = (s / `FLAT_TILT`)²:
the gap is exact where the disc lies flat, and no point touches from `FLAT_TILT` on. Between `EXACT_TILT` and
`FLAT_TILT` the lowest point leaves the plane. On a face of finite size they protrude otherwise: see `smooth_rows`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import product
from mbd_sim.base.rounded import sine_cosine
from mbd_sim.dynamics.constraints.rows import IteratedNormal, perpendiculars
from mbd_sim.dynamics.contact.cams import follower_angle, profile_points, roller_angle, roller_distance
from mbd_sim.dynamics.contact.rows.normal_searches import unit
from mbd_sim.dynamics.kinematics.poses import SymbolicPose
from mbd_sim.dynamics.math.spatial import constant, is_symbolic
from mbd_sim.mechanism.elements.contacts import (
    FIRST_RIM,
    Ball,
    Barrel,
    Cam,
    Contact,
    EllipsoidBody,
    Face,
    Rim,
    RimPoint,
)

POINTS = 6  # of a rim that carry it; in a plane mechanism the two in its plane
FLAT_TILT = 0.02  # sine of the tilt below which a disc lies flat
EXACT_TILT = 0.5 * FLAT_TILT  # sine of the tilt from which on the lowest point is exact
BEND = 73.0  # of an end that lies on a face of finite size, at `EXACT_TILT` as much as `BULGE`: see `smooth_rows`
LEVEL_TILT = 0.2 * FLAT_TILT  # sine of the tilt below which such an end is bent less and less
UNBENT = 0.25  # sine of the tilt of the normal of a crossing against such an end, from which on it is not bent
BULGE = 31.0  # at `EXACT_TILT` the points beside the lowest one are lower than it: 1 - cos(π / 6) = 0.134


def can_lie_flat(rim: Rim | RimPoint, face: Face, still: int | None) -> bool:
    """Whether a rim and a plane can be parallel; not so if the axis remains in the plane, as that of a wheel.

    :param still: the axis of ground, 0, 1 or 2, along which no part moves; None if there is none.
    """
    return still is None or face.normal[still] != 0.0 or abs(rim.axis[still]) != 1.0


def with_rim_points(contact: Contact, still: int | None) -> Iterator[Contact]:
    """A contact, and those of the points that carry it if it is one of a rim that can lie flat.

    :param still: see `can_lie_flat`.
    """
    yield contact
    rim, face = contact.first, contact.second
    if not isinstance(rim, Rim) or not isinstance(face, Face) or not (rim.first and can_lie_flat(rim, face, still)):
        return
    name = contact.quantity.removesuffix(FIRST_RIM)
    for number, direction in enumerate(_directions(rim, face, still), start=1):
        point = RimPoint(rim.at, rim.axis, rim.radius, rim.length, direction)
        yield replace(contact, quantity=f"{name} edge {number}", first=point)


def _directions(rim: Rim, face: Face, still: int | None) -> Array:
    """The directions (n, 3) of the points, in the frame of the part."""
    if still is not None and face.normal[still] == 0.0 and rim.axis[still] == 0.0:
        across = np.cross(rim.axis, np.eye(3)[still])
        return np.array([across, -across])
    return rim_directions(rim.axis)


def rim_directions(axis: Array) -> Array:
    """The directions (n, 3) of the points of a rim around an axis (3,) in space."""
    angles = [2.0 * math.pi * number / POINTS for number in range(POINTS)]
    around: Array = product(np.array([sine_cosine(angle)[::-1] for angle in angles]), perpendiculars(axis))
    return around


def protrusion(radius: Any, square: Any) -> Any:
    """How far in m the points of a rim protrude, from the square s² of its tilt; negative where it is not flat."""
    x = square / FLAT_TILT**2
    return BULGE * radius * square * (1.0 - x) / (1.0 + x) ** 2


def withdrawn(radius: Any, square: Any) -> Any:
    """How far in m the lowest point is below the center at tilts up to `EXACT_TILT`, from s²; negative at s = 0.

    Its value r s at `EXACT_TILT` and its first two derivatives by s are continuous with those of the rim.
    """
    x = square / EXACT_TILT**2
    return radius * EXACT_TILT * (-0.125 + x * (2.25 + x * (-1.625 + x * 0.5)))


FLAT = 1e-30  # square of the sine of the angle below which a rim counts as lying flat
ALONG = 1e-9  # of a tube's radius, by which a ball in the plane of a ring may be beside it by round-off
STEEP = 0.8  # component of a normal along y, from which on z is the reference for directions of slip


Sides = Callable[[ca.SX], tuple[ca.SX, ca.SX]]


@dataclass(frozen=True, slots=True)
class Touch:
    """Two bodies that touch: their distance in m, and in ground's axes the `normal` (3,) and the `point` (3,).

    The normal is that along which the second body pushes the first. `sides` are two directions (3,) of slip. All may
    depend on an `iterated` normal. The distance is less than that of the points that touch by the `lift`, along a
    direction that has a cosine with the normal.
    """

    distance: ca.SX
    normal: ca.SX
    point: ca.SX
    sides: tuple[ca.SX, ca.SX]
    iterated: IteratedNormal | None = None
    lift: ca.SX | None = None
    lift_cosine: ca.SX | float = 1.0


def touch(contact: Contact, first: SymbolicPose, second: SymbolicPose, still: int | None = None) -> Touch:
    """The geometry of a contact; the frames are at the points of both bodies, with the axes of their parts.

    :param still: the axis of ground, 0, 1 or 2, along which no part moves; None if there is none.
    """
    match contact.first, contact.second:
        case Ball() as ball, Face() as face:
            normal = _turned(second, face.normal)
            point = first.position - ball.radius * normal
            return Touch(ca.dot(normal, point - second.position), normal, point, _along(second, face))
        case Rim() as rim, Face() as face:
            return _rim_on_face(rim, face, first, second, can_lie_flat(rim, face, still) and contact.rigid)
        case RimPoint() as rim, Face() as face:
            return _rim_point_on_face(rim, face, first, second)
        case EllipsoidBody() as body, Face() as face:
            return _ellipsoid_on_face(body, face, first, second)
        case Ball() as ball, Ball() as other:
            line = first.position - second.position
            return _round(contact, ball, other.radius, first, line, lambda normal: tangents(normal, still))
        case Ball() as ball, Barrel() as barrel if contact.inside:
            return ball_in_barrel(contact, ball, barrel, first, second)
        case Ball() as ball, Barrel() as barrel:
            return ball_on_barrel(ball, barrel, first, second)
        case Barrel() as inner, Barrel() as barrel:
            axis, across, _ = _cylindrical(barrel, first, second)
            roller = Ball(inner.at, inner.radius)
            return _round(contact, roller, barrel.radius, first, across, lambda normal: (ca.cross(axis, normal), axis))
        case Ball() | Barrel() as ball, Cam() as cam:
            return _ball_on_cam(ball, cam, first, second)
        case Cam() as cam, Face() as face:
            normal, axes = _turned(second, face.normal), ca.sparsify(first.rotation @ constant(cam.axes))
            own = (axes.T @ normal)[:2]
            (at,) = profile_points(cam.profile)(follower_angle(cam.profile, own))
            point = first.position + axes[:, :2] @ at
            axis = axes[:, 2]
            return Touch(ca.dot(normal, point - second.position), normal, point, (ca.cross(axis, normal), axis))
        case one, other:
            raise ValueError(f"contact {contact.name}: {type(one).__name__} and {type(other).__name__} have no gap")


def without_repeated(contacts: Iterable[Contact], still: int | None) -> list[Contact]:
    """The contacts, of those that always have the same gap only the first: one behind the other in a plane mechanism.

    :param still: see `touch`.
    """
    found, known = [], set()
    for contact in contacts:
        key = None if still is None else _seen_along(contact, still)
        if key is None or key not in known:
            found.append(contact)
        known.add(key)
    return found


def _seen_along(contact: Contact, axis: int) -> tuple[object, ...] | None:
    """What of a contact with a face counts in a motion across an axis; None for others, and where numbers vary."""
    body, face = contact.first, contact.second
    if not isinstance(body, Ball | Rim) or not isinstance(face, Face) or face.normal[axis] != 0.0:
        return None
    across = isinstance(body, Ball) or abs(body.axis[axis]) == 1.0
    if not across or is_symbolic(body.at.point, body.radius, face.at.point):
        return None
    places = (tuple(np.delete(at.point, axis).tolist()) for at in (body.at, face.at))
    return contact.name, body.at.part, face.at.part, tuple(face.normal.tolist()), type(body), body.radius, *places


def _turned(frame: SymbolicPose, direction: Array) -> ca.SX:
    return ca.sparsify(frame.rotation @ constant(direction))


def _along(frame: SymbolicPose, face: Face) -> tuple[ca.SX, ca.SX]:
    one, other = (_turned(frame, side) for side in perpendiculars(face.normal))
    return one, other


def _rim_on_face(rim: Rim, face: Face, first: SymbolicPose, second: SymbolicPose, lies: bool) -> Touch:
    """The lowest point of the circle; the directions of slip are forward and sideways."""
    normal, axis = _turned(second, face.normal), _turned(first, rim.axis)
    in_disc = normal - axis * ca.dot(normal, axis)
    square = ca.dot(in_disc, in_disc)
    if lies:
        square = ca.fmax(square, (0.5 * EXACT_TILT) ** 2)
    size = ca.sqrt(square + FLAT)
    point = first.position - in_disc * (rim.radius / size)
    forward = ca.cross(axis, normal) / size
    distance = ca.dot(normal, point - second.position)
    if lies:
        flat = ca.dot(normal, first.position - second.position) - withdrawn(rim.radius, ca.dot(in_disc, in_disc))
        distance = ca.if_else(square < EXACT_TILT**2, flat, distance)
    return Touch(distance, normal, point, (forward, ca.cross(normal, forward)))


def _rim_point_on_face(rim: RimPoint, face: Face, first: SymbolicPose, second: SymbolicPose) -> Touch:
    normal, axis = _turned(second, face.normal), _turned(first, rim.axis)
    in_disc = normal - axis * ca.dot(normal, axis)
    center = first.position + axis * (rim.length * (ca.dot(axis, normal) < 0.0))
    point = center + rim.radius * _turned(first, rim.direction)
    lift = protrusion(rim.radius, ca.dot(in_disc, in_disc))
    return Touch(ca.dot(normal, point - second.position) - lift, normal, point, _along(second, face))


def _ellipsoid_on_face(body: EllipsoidBody, face: Face, first: SymbolicPose, second: SymbolicPose) -> Touch:
    """The lowest point is at -A D² Aᵀ n / h from the center, with the radii D along A and h = |D Aᵀ n|."""
    normal, axes = _turned(second, face.normal), ca.sparsify(first.rotation @ constant(body.axes))
    radii = ca.vertcat(*body.radii)
    scaled = radii * (axes.T @ normal)
    height = ca.sqrt(ca.dot(scaled, scaled))
    point = first.position - axes @ (radii * scaled) / height
    return Touch(ca.dot(normal, first.position - second.position) - height, normal, point, _along(second, face))


def _round(contact: Contact, ball: Ball, radius: float, first: SymbolicPose, line: ca.SX, sides: Sides) -> Touch:
    """A ball and another one, or a barrel, with this `radius`; `line` (3,) leads to the ball, across a barrel's axis.

    A ball inside has (R² - l²) / 2R: as large as R - l near zero, and smooth where both centers coincide.
    """
    if contact.inside:
        play = radius - ball.radius
        distance, normal = (play * play - ca.dot(line, line)) / (2.0 * play), -line / play
    else:
        length = ca.norm_2(line)
        distance, normal = length - (ball.radius + radius), line / length
    return Touch(distance, normal, first.position - ball.radius * normal, sides(normal))


def _cylindrical(barrel: Barrel, first: SymbolicPose, second: SymbolicPose) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The axis (3,) of a barrel, what leads (3,) from there to the first frame, and how far along it that is in m."""
    axis, line = _turned(second, barrel.axis), first.position - second.position
    along = ca.dot(axis, line)
    return axis, line - axis * along, along


@dataclass(frozen=True, eq=False)
class Zone:
    """What of a cylinder a ball touches: an `end`, 1 or -1, or 0 for none, and 1 for the `side` and an edge, else 0."""

    end: ca.SX
    side: ca.SX


def ball_on_barrel(
    ball: Ball, barrel: Barrel, first: SymbolicPose, second: SymbolicPose, zone: Zone | None = None
) -> Touch:
    """A ball at the side, on an end, or at an edge of a cylinder.

    :param zone: what it touches; where it is not given, that to which its center is nearest.
    """
    axis, across, along = _cylindrical(barrel, first, second)
    radial = ca.sqrt(ca.dot(across, across) + FLAT)
    beside, outward = radial - barrel.radius, across / radial
    if zone is None:
        up = ca.if_else(along < 0.0, -1.0, 1.0)
        beyond = ca.fabs(along) - 0.5 * barrel.length
        at_edge, on_end = (beside > 0.0) * (beyond > 0.0), beyond > beside
        on_face = on_end * (beside <= 0.0)
    else:
        up, beyond = zone.end, zone.end * along - 0.5 * barrel.length
        at_edge, on_end, on_face = zone.side * up * up, up * up, up * up * (1.0 - zone.side)
    size = ca.sqrt(beside * beside + beyond * beyond + FLAT)
    distance = ca.if_else(at_edge, size, ca.if_else(on_end, beyond, beside)) - ball.radius
    flat = ca.if_else(on_end, up * axis, outward)
    normal = ca.if_else(at_edge, (beside * outward + (beyond * up) * axis) / size, flat)
    around, fixed = ca.cross(axis, outward), _turned(second, perpendiculars(barrel.axis)[0])
    side = ca.if_else(on_face, fixed, around)
    return Touch(distance, normal, first.position - ball.radius * normal, (side, ca.cross(normal, side)))


def ball_in_barrel(
    contact: Contact, ball: Ball, barrel: Barrel, first: SymbolicPose, second: SymbolicPose, zone: Zone | None = None
) -> Touch:
    """A ball inside a tube with a thin wall, or at the edge of one of its ends; for the `zone` see `ball_on_barrel`."""
    axis, across, along = _cylindrical(barrel, first, second)
    inner = _round(contact, ball, barrel.radius, first, across, lambda normal: (ca.cross(axis, normal), axis))
    radial = ca.sqrt(ca.dot(across, across) + FLAT)
    beside, outward = radial - barrel.radius, across / radial
    if zone is None:
        up = ca.if_else(along < 0.0, -1.0, 1.0)
        beyond = ca.fabs(along) - 0.5 * barrel.length
        outside = beyond > ALONG * barrel.radius
    else:
        up, beyond, outside = zone.end, zone.end * along - 0.5 * barrel.length, zone.end * zone.end
    size = ca.sqrt(beside * beside + beyond * beyond + FLAT)
    normal = ca.if_else(outside, (beside * outward + (beyond * up) * axis) / size, inner.normal)
    around = ca.if_else(outside, ca.cross(axis, outward), inner.sides[0])
    return Touch(
        ca.if_else(outside, size - ball.radius, inner.distance),
        normal,
        first.position - ball.radius * normal,
        (around, ca.if_else(outside, ca.cross(normal, around), inner.sides[1])),
    )


def tangents(normal: ca.SX, still: int | None) -> tuple[ca.SX, ca.SX]:
    """Two directions (3,) perpendicular to a `normal` (3,) and to each other.

    The first is perpendicular to the axis `still` as well, so that in a plane mechanism the second is that axis;
    without one to y, or to z where the normal is almost along y.
    """
    if still is None:
        steep = ca.fabs(normal[1]) > STEEP
        reference = ca.vertcat(0.0, ca.if_else(steep, 0.0, 1.0), ca.if_else(steep, 1.0, 0.0))
    else:
        reference = constant(np.eye(3)[still])
    side = ca.cross(reference, normal)
    side /= ca.norm_2(side)
    return side, ca.cross(normal, side)


def with_slip_in_plane(touching: Touch, across: Array | None) -> Touch:
    """The geometry with sides in the plane in which all parts move, which has the normal `across` (3,), and across it.

    Slip across the plane does not occur, so its row is left out. Of two other rows, each would become unable to act
    where the bodies have turned such that it is across the plane.
    """
    if across is None:
        return touching
    return replace(touching, sides=(unit(ca.cross(constant(across), touching.normal)), constant(across)))


def _ball_on_cam(ball: Ball | Barrel, cam: Cam, first: SymbolicPose, second: SymbolicPose) -> Touch:
    """The ball, or a roller, at the nearest point of the profile."""
    axes = ca.sparsify(second.rotation @ constant(cam.axes))
    center = axes.T @ (first.position - second.position)
    angle = roller_angle(cam.profile, center[:2])
    distance, at, tangent = roller_distance(cam.profile, center[:2], angle)
    outward = ca.vertcat(tangent[1], -tangent[0])
    normal = axes[:, :2] @ outward
    point = second.position + axes @ ca.vertcat(at, center[2])
    return Touch(distance - ball.radius, normal, point, (axes[:, :2] @ tangent, axes[:, 2]))
