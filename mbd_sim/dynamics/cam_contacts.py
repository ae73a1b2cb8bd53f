"""The point of a cam's profile that touches a roller or a flat follower, by a fixed number of Newton's iterations.

They begin at the nearest of a few points of the profile, or at the one farthest against a follower's normal, and their
number is such that they converge to round-off; `cam_check` refuses profiles for which they do not.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from mbd_sim.dynamics.time_functions import function_of
from mbd_sim.mechanism.contacts import CAM_ANGLE
from mbd_sim.mechanism.expression import TimeExpression

ITERATIONS = 6
LARGEST_STEP = 0.2  # rad
STARTS = 72  # points of a profile
LEAST_CURVATURE = 0.05  # of the profile relative to the roller, as a fraction of that of a circle


def profile_point(profile: TimeExpression, angle: ca.SX, order: int = 0) -> ca.SX:
    """The point (2,) in m of a profile at an angle in rad, or its derivative of an `order` by the angle."""
    s = ca.SX.sym("s")
    value = function_of(profile, {CAM_ANGLE: s}) * ca.vertcat(ca.cos(s), ca.sin(s))
    for _ in range(order):
        value = ca.jacobian(value, s)
    return ca.substitute([value], [s], [angle])[0]


def roller_angle(profile: TimeExpression, center: ca.SX) -> ca.SX:
    """The angle of the point of a profile that is nearest to a `center` (2,) in m."""

    def excess(s: ca.SX) -> tuple[ca.SX, ca.SX]:
        at, slope, second = (profile_point(profile, s, order) for order in range(3))
        square = ca.dot(slope, slope)
        own = ca.dot(slope, at - center)
        return own, ca.fmax(square + ca.dot(second, at - center), LEAST_CURVATURE * square)

    return _solved(excess, _nearest_start(profile, lambda at: ca.dot(at, at) - 2.0 * ca.dot(center, at)))


def roller_distance(profile: TimeExpression, center: ca.SX, angle: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The distance in m of a `center` (2,) from the profile's tangent at an angle, the point (2,), and the tangent."""
    at, slope = profile_point(profile, angle), profile_point(profile, angle, 1)
    tangent = slope / ca.norm_2(slope)
    return ca.dot(ca.vertcat(tangent[1], -tangent[0]), center - at), at, tangent


def follower_angle(profile: TimeExpression, normal: ca.SX) -> ca.SX:
    """The angle of the point of a convex profile that is farthest against a `normal` (2,) of a flat follower."""

    def excess(s: ca.SX) -> tuple[ca.SX, ca.SX]:
        at, slope, second = (profile_point(profile, s, order) for order in range(3))
        size = ca.sqrt(ca.dot(at, at))
        return ca.dot(normal, slope), ca.fmax(ca.dot(normal, second), LEAST_CURVATURE * size)

    return _solved(excess, _nearest_start(profile, lambda at: ca.dot(normal, at)))


def _nearest_start(profile: TimeExpression, size: Callable[[ca.SX], ca.SX]) -> ca.SX:
    """Of some angles, spread evenly, that whose point (2,) of the profile has the least size."""
    angles = np.linspace(-np.pi, np.pi, STARTS, endpoint=False).tolist()
    best, least = ca.SX(angles[0]), size(profile_point(profile, ca.SX(angles[0])))
    for angle in angles[1:]:
        found = size(profile_point(profile, ca.SX(angle)))
        best = ca.if_else(found < least, angle, best)
        least = ca.fmin(found, least)
    return best


def _solved(excess: Callable[[ca.SX], tuple[ca.SX, ca.SX]], start: ca.SX) -> ca.SX:
    s = start
    for _ in range(ITERATIONS):
        value, slope = excess(s)
        s = s - ca.fmin(ca.fmax(value / slope, -LARGEST_STEP), LARGEST_STEP)
    return s
