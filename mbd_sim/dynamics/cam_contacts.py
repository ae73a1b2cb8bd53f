"""The point of a cam's profile that touches a roller or a flat follower, by a fixed number of Newton's iterations.

They begin at the polar angle of the roller, or of the follower's normal, and their number is such that they converge to
round-off for profiles without corners.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

from mbd_sim.dynamics.time_functions import function_of
from mbd_sim.mechanism.contacts import CAM_ANGLE
from mbd_sim.mechanism.expression import TimeExpression

ITERATIONS = 6
LARGEST_STEP = 0.5  # rad
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

    return _solved(excess, ca.atan2(center[1], center[0]))


def follower_angle(profile: TimeExpression, normal: ca.SX) -> ca.SX:
    """The angle of the point of a convex profile that is farthest against a `normal` (2,) of a flat follower."""

    def excess(s: ca.SX) -> tuple[ca.SX, ca.SX]:
        at, slope, second = (profile_point(profile, s, order) for order in range(3))
        size = ca.sqrt(ca.dot(at, at))
        return ca.dot(normal, slope), ca.fmax(ca.dot(normal, second), LEAST_CURVATURE * size)

    return _solved(excess, ca.atan2(-normal[1], -normal[0]))


def _solved(excess: Callable[[ca.SX], tuple[ca.SX, ca.SX]], start: ca.SX) -> ca.SX:
    s = start
    for _ in range(ITERATIONS):
        value, slope = excess(s)
        s = s - ca.fmin(ca.fmax(value / slope, -LARGEST_STEP), LARGEST_STEP)
    return s
