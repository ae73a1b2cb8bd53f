"""The gap of a slot of two outlines: pieces that touch, with numbers that change, in the plane of the second one.

The geometry is that of `simulation/contact/compiled/features/pieces.py`: a straight piece gives the normal; between
two round ones the gap is stationary in the angle of the normal.

The numbers of a slot are the centers of both pieces (4), the normals at their first ends (4), radii (2), growths (2),
1 for each piece that is straight (2), and -1 if one of them is concave or else 1; the last one is the key, by which the
narrow phase knows the pieces; 0 is not a key.
"""

from __future__ import annotations

import casadi as ca

from mbd_sim.dynamics.contact.rows.normal_searches import TINY
from mbd_sim.dynamics.contact.shapes import Touch
from mbd_sim.dynamics.kinematics.poses import SymbolicPose
from mbd_sim.dynamics.math.spatial import constant
from mbd_sim.mechanism.elements.contacts import PlanarBody


def outline_touch(
    numbers: ca.SX,
    bodies: tuple[PlanarBody, PlanarBody],
    first: SymbolicPose,
    second: SymbolicPose,
    length: float,
) -> Touch:
    """The geometry of a slot; the frames are those of the two parts.

    :param length: the gap in m of a slot without features.
    """
    one, other = bodies
    axes, own_axes = (
        ca.sparsify(pose.rotation @ constant(body.axes))
        for body, pose in zip((other, one), (second, first), strict=True)
    )
    plane, own_plane = axes[:, :2], own_axes[:, :2]
    r_a, r_b, k_a, k_b, straight_a, straight_b, sign = (numbers[k] for k in range(8, 15))
    at = first.position + first.rotation @ constant(one.origin) + own_plane @ numbers[0:2]
    other_at = second.position + second.rotation @ constant(other.origin) + plane @ numbers[2:4]
    line, start_b = plane.T @ (at - other_at), numbers[6:8]
    start_a = plane.T @ (own_plane @ numbers[4:6])
    round_pieces = (1.0 - straight_a) * (1.0 - straight_b)
    square = ca.dot(line, line) + TINY
    grows = _grow(one) or _grow(other)
    growth = round_pieces * (k_a + k_b) if grows else ca.SX(1, 1)
    rest = ca.fmax(square - growth * growth, TINY) if grows else square
    curved = (sign * ca.sqrt(rest) * line - growth * _turned(line)) / square
    normal = round_pieces * curved - straight_a * start_a + straight_b * start_b
    p_a = r_a + k_a * _angle(start_a, -normal, k_a) if _grow(one) else r_a
    p_b = r_b + k_b * _angle(start_b, normal, k_b) if _grow(other) else r_b
    turned = _turned(normal)
    point = at - plane @ (p_a * normal + k_a * turned)
    other_point = other_at + plane @ (p_b * normal + k_b * turned)
    outward, used = plane @ normal, sign * sign
    gap = ca.dot(normal, line) - p_a - p_b + (1.0 - used) * length
    return Touch(gap, outward, point + straight_a * (other_point - point), (plane @ turned, axes[:, 2]))


def _grow(body: PlanarBody) -> bool:
    """Whether a body has involutes."""
    return any(getattr(piece, "growth", 0.0) for piece in body.outline.pieces)


def _turned(vector: ca.SX) -> ca.SX:
    return ca.vertcat(-vector[1], vector[0])


def _angle(start: ca.SX, end: ca.SX, growth: ca.SX) -> ca.SX:
    """The angle from one direction to another, of a piece that grows; others have no angle."""
    sine = start[0] * end[1] - start[1] * end[0]
    return ca.atan2(growth * growth * sine, growth * growth * ca.dot(start, end) + (growth == 0.0))
