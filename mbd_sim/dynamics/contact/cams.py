"""The point of a cam's profile that touches a roller or a flat follower, by a fixed number of Newton's iterations.

They begin at the nearest of a few points of the profile, or at the one farthest against a follower's normal, and their
number is such that they converge to round-off.

Cams whose profile cannot be followed are refused: one point must touch, and the iterations must find it. For this the
profile is sampled; at each sample a roller, or a flat follower, is placed so that it touches there. Where a roller
touches two points, the nearest one jumps between them, and so would the state.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import MechanismError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import product
from mbd_sim.dynamics.math.expressions import function_of
from mbd_sim.mechanism.elements.contacts import CAM_ANGLE, Ball, Barrel, Cam, Contact
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import TimeExpression

ITERATIONS = 6
LARGEST_STEP = 0.2  # rad
STARTS = 72  # points of a profile
LEAST_CURVATURE = 0.05  # of the profile relative to the roller, as a fraction of that of a circle


def profile_points(profile: TimeExpression, derivatives: int = 0) -> Callable[[ca.SX], list[ca.SX]]:
    """What gives the point (2,) in m of a profile at an angle in rad, and as many derivatives by the angle."""
    s = ca.SX.sym("s")
    values = [function_of(profile, {CAM_ANGLE: s}) * ca.vertcat(ca.cos(s), ca.sin(s))]
    for _ in range(derivatives):
        values.append(ca.jacobian(values[-1], s))
    return lambda angle: [ca.substitute([value], [s], [angle])[0] for value in values]


def roller_angle(profile: TimeExpression, center: ca.SX) -> ca.SX:
    """The angle of the point of a profile that is nearest to a `center` (2,) in m."""
    points = profile_points(profile, 2)

    def excess(s: ca.SX) -> tuple[ca.SX, ca.SX]:
        at, slope, second = points(s)
        square = ca.dot(slope, slope)
        own = ca.dot(slope, at - center)
        return own, ca.fmax(square + ca.dot(second, at - center), LEAST_CURVATURE * square)

    return _solved(excess, _nearest_start(profile, lambda at: ca.dot(at, at) - 2.0 * ca.dot(center, at)))


def roller_distance(profile: TimeExpression, center: ca.SX, angle: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The distance in m of a `center` (2,) from the profile's tangent at an angle, the point (2,), and the tangent."""
    at, slope = profile_points(profile, 1)(angle)
    tangent = slope / ca.norm_2(slope)
    return ca.dot(ca.vertcat(tangent[1], -tangent[0]), center - at), at, tangent


def follower_angle(profile: TimeExpression, normal: ca.SX) -> ca.SX:
    """The angle of the point of a convex profile that is farthest against a `normal` (2,) of a flat follower."""
    points = profile_points(profile, 2)

    def excess(s: ca.SX) -> tuple[ca.SX, ca.SX]:
        at, slope, second = points(s)
        size = ca.sqrt(ca.dot(at, at))
        return ca.dot(normal, slope), ca.fmax(ca.dot(normal, second), LEAST_CURVATURE * size)

    return _solved(excess, _nearest_start(profile, lambda at: ca.dot(normal, at)))


def _nearest_start(profile: TimeExpression, size: Callable[[ca.SX], ca.SX]) -> ca.SX:
    """Of some angles, spread evenly, that whose point (2,) of the profile has the least size."""
    points, angles = profile_points(profile), np.linspace(-np.pi, np.pi, STARTS, endpoint=False).tolist()
    best, least = ca.SX(angles[0]), size(*points(ca.SX(angles[0])))
    for angle in angles[1:]:
        found = size(*points(ca.SX(angle)))
        best = ca.if_else(found < least, angle, best)
        least = ca.fmin(found, least)
    return best


def _solved(excess: Callable[[ca.SX], tuple[ca.SX, ca.SX]], start: ca.SX) -> ca.SX:
    s = start
    for _ in range(ITERATIONS):
        value, slope = excess(s)
        s = s - ca.fmin(ca.fmax(value / slope, -LARGEST_STEP), LARGEST_STEP)
    return s


Mask: TypeAlias = NDArray[np.bool_]

SAMPLES = 720  # of the profile
NEAREST = 1e-6  # of its size, by which another point must be nearer to a roller to count
FOUND = 1e-9  # of its size, up to which the iterations must find the point
PERIODIC = 1e-9  # of its size, by which a profile may differ after one revolution
APART = 0.01  # of its size, distance up to which the point must be found
FAR = (0.05, 0.2, 0.5)  # of its size, distances at which the gap must not be less than `MISJUDGED` of the true one
MISJUDGED = 0.5
KNOWN = 256  # profiles whose check is kept


@dataclass(frozen=True)
class _Samples:
    """The `angles` (n,) in rad, `points` in m and unit `normals` outward (2, n), and `curvatures` (n,) in 1/m.

    A curvature is positive where the profile is convex. `speeds` (n,) are ds/d angle in m, `size` the largest radius.
    """

    angles: Array
    points: Array
    normals: Array
    curvatures: Array
    speeds: Array
    size: float

    def placed(self, distance: float) -> Array:
        """The points (2, n) at this distance in m outside."""
        return self.points + distance * self.normals


def require_followable_cams(mechanism: Mechanism) -> None:
    """Refuse cams that their rollers or flat followers cannot follow.

    :raises MechanismError: the cams are named, with the angle and the curvature there.
    """
    problems = []
    for contact in mechanism.contacts:
        if (found := _cam_and_roller(contact)) is None:
            continue
        profile, roller = found
        if profile.tables:
            fault = profile_fault(profile, roller)
        else:  # members of an ensemble and live values mostly have the same cams
            fault = _known_fault(profile.text, tuple(profile.names.items()), roller)
        if fault is None:
            continue
        message, remedy = f"'{contact.names[0]}' and '{contact.names[1]}': the profile {fault[0]}", fault[1]
        problems.append(mechanism.source.problem(("contacts", contact.name, "profile"), message, remedy))
    if problems:
        raise MechanismError(problems)


@lru_cache(KNOWN)
def _known_fault(text: str, names: tuple[tuple[str, float], ...], roller: float | None) -> tuple[str, str] | None:
    return profile_fault(TimeExpression(text, dict(names)), roller)


def _cam_and_roller(contact: Contact) -> tuple[TimeExpression, float | None] | None:
    """The profile of a cam, and the radius in m of its roller; None for the radius of a flat follower."""
    if isinstance(contact.first, Cam):
        return contact.first.profile, None
    if isinstance(contact.second, Cam) and isinstance(contact.first, Ball | Barrel):
        return contact.second.profile, contact.first.radius
    return None


def profile_fault(profile: TimeExpression, roller: float | None) -> tuple[str, str] | None:
    """Why a roller with this radius in m, 0 for a point, or without it a flat follower cannot follow a profile.

    A sentence without its subject, and the remedy; None if it can.
    """
    samples = _sampled(profile)
    if isinstance(samples, tuple):
        return samples
    return _follower_fault(profile, samples) if roller is None else _roller_fault(profile, samples, roller)


def _sampled(profile: TimeExpression) -> _Samples | tuple[str, str]:
    s = ca.SX.sym("s")
    function = ca.Function("profile", [s], [ca.vertcat(*profile_points(profile, 2)(s))])
    angles = np.linspace(-math.pi, math.pi, SAMPLES + 1)
    values = np.array(function(ca.DM(angles).T))
    if not np.isfinite(values).all():
        angle = angles[int(np.argmin(np.isfinite(values).all(axis=0)))]
        return f"has no finite value or derivative at {_degrees(angle)}", "It must be smooth for every angle."
    points, size = values[:2, :-1], float(np.max(np.hypot(*values[:2])))
    radii = np.cos(angles) * values[0] + np.sin(angles) * values[1]
    if not np.min(radii) > 0.0:
        return f"is {np.min(radii):.4g} m at {_degrees(angles[int(np.argmin(radii))])}", "A radius must be positive."
    if np.max(np.abs(values[:, -1] - values[:, 0])) > PERIODIC * size:
        return "does not have the period 2*pi", "Make it periodic in 'angle'."
    slopes, seconds = values[2:4, :-1], values[4:, :-1]
    speeds = np.hypot(*slopes)
    normals = np.array([slopes[1], -slopes[0]]) / speeds
    curvatures = (slopes[0] * seconds[1] - slopes[1] * seconds[0]) / speeds**3
    return _Samples(angles[:-1], points, normals, curvatures, speeds, size)


def _roller_fault(profile: TimeExpression, samples: _Samples, radius: float) -> tuple[str, str] | None:
    """Where the roller does not fit, or its point is not found.

    Each ray from the cam's axis meets the profile once, so a roller that fits everywhere touches in one point.
    """
    fits = 1.0 + samples.curvatures * radius
    worst = int(np.argmin(fits))
    if fits[worst] < LEAST_CURVATURE:
        hollow = -1.0 / float(samples.curvatures[worst])
        return (
            f"has a concave radius of curvature of {hollow:.4g} m at {_degrees(samples.angles[worst])}, into which the "
            f"roller's radius of {radius:.4g} m does not fit",
            f"Use a radius of at most {(1.0 - LEAST_CURVATURE) * hollow:.3g} m, or a profile that is less concave.",
        )
    center = ca.SX.sym("center", 2)
    angle = roller_angle(profile, center)
    found = ca.Function("roller", [center], [angle, roller_distance(profile, center, angle)[0]])
    hollow = max(0.0, -float(np.min(samples.curvatures)))
    room = (1.0 - LEAST_CURVATURE) / hollow - radius if hollow else math.inf
    for apart in (0.0, min(APART * samples.size, room), *(share * samples.size for share in FAR)):
        true = _nearest(samples, radius + apart)
        angles, distances = (np.array(each).ravel() for each in found(samples.placed(radius + apart)))
        misjudged = distances - radius < MISJUDGED * (true - radius) - NEAREST * samples.size
        near = (true >= radius + apart - NEAREST * samples.size) & (apart <= APART * samples.size)
        if (fault := _not_found(samples, angles, near, misjudged)) is not None:
            return fault
    return None


def _nearest(samples: _Samples, distance: float) -> Array:
    """The distances (n,) in m of points at this distance outside each sample from the nearest one."""
    x, y = samples.placed(distance)
    squares = (x[:, None] - samples.points[0]) ** 2 + (y[:, None] - samples.points[1]) ** 2
    return np.asarray(np.sqrt(squares.min(axis=1)))


def _follower_fault(profile: TimeExpression, samples: _Samples) -> tuple[str, str] | None:
    """Where a profile is not convex, or the point of a flat follower is not found."""
    worst = int(np.argmin(samples.curvatures))
    if samples.curvatures[worst] <= 0.0:
        return (
            f"is not convex at {_degrees(samples.angles[worst])}, where its curvature is "
            f"{samples.curvatures[worst]:.4g}/m: a flat follower would touch it in two points",
            "Use a convex profile, or a roller.",
        )
    normal = ca.SX.sym("normal", 2)
    found = ca.Function("follower", [normal], [follower_angle(profile, normal)])
    everywhere = np.ones(SAMPLES, dtype=bool)
    return _not_found(samples, np.array(found(-samples.normals)).ravel(), everywhere, ~everywhere)


def _not_found(samples: _Samples, angles: Array, chosen: Mask, wrong: Mask) -> tuple[str, str] | None:
    """Where the iterations do not end at the touching point of the `chosen` samples, or are `wrong` in any case."""
    turns = np.remainder(angles - samples.angles + math.pi, 2.0 * math.pi) - math.pi
    errors = np.where(chosen, np.abs(turns) * samples.speeds, 0.0)
    errors = np.where(np.isfinite(turns) & ~wrong, errors, np.inf)
    worst = int(np.argmax(errors))
    if errors[worst] <= FOUND * samples.size:
        return None
    inward = float(product(samples.points[:, worst], samples.normals[:, worst])) / math.hypot(*samples.points[:, worst])
    steep = math.degrees(math.acos(max(-1.0, min(1.0, inward))))
    return (
        f"cannot be followed near {_degrees(samples.angles[worst])}: the point that touches is not found, because the "
        f"normal is {steep:.3g} deg from the radius there and the curvature is {samples.curvatures[worst]:.4g}/m",
        "Make the profile less steep or less concave, or use a smaller roller.",
    )


def _degrees(angle: float) -> str:
    return f"angle = {math.degrees(angle):.1f} deg"
