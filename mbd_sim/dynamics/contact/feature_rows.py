"""The gap of a slot: one of the points at which two bodies touch, with vertices, edges and faces that change.

What touches is a block of numbers among the inputs, so that nothing is compiled as it changes. One expression serves
all pairs of features: with the points A and B, the directions m_A and m_B, which are normals of faces or directions of
edges, and D = A - B,

    w = c_F (m_A + m_B) + c_X m_A × m_B + c_D (D - m_A m_A·D - m_B m_B·D),    n = w / |w|,    g = n·D - r_A - r_B.

A vertex on a face has c_F = 1 and the normal that points from the second body to the first; two edges have c_X = 1; a
point at an edge or at a point has c_D = 1, or -1 within a concave arc, whose radius is negative. A slot without
features has zeros only; its gap is then the natural length.

The numbers of a slot are, in the frames of the two parts, A, B, m_A and m_B (12), c_F, c_X, c_D, r_A and r_B (5),
1 if the contact point is on the second body, where it is nearest to the point of this body, or else 0, a direction
across the normal (3) in the frame of the second part, from which directions of slip follow, and the key, by which the
narrow phase knows what touches; 0 is not a key.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from mbd_sim.dynamics.contact.rows.normal_searches import TINY
from mbd_sim.dynamics.contact.shapes import Touch
from mbd_sim.dynamics.kinematics.poses import SymbolicPose
from mbd_sim.dynamics.math.spatial import constant

SLOT_SIZE = 22  # numbers of a slot
KEY = 21  # the place of the key


def slot_touch(
    numbers: ca.SX,
    first: SymbolicPose,
    second: SymbolicPose,
    length: float,
    still: int | None,
    *,
    crossing: bool = True,
    apart: bool = True,
) -> Touch:
    """The geometry of a slot; the frames are those of the two parts.

    :param length: the gap in m of a slot without features.
    :param still: the axis of ground along which the bodies are prisms and nothing moves; None in space.
    :param crossing: whether edges can cross, c_X ≠ 0.
    :param apart: whether points can be apart as they touch, c_D ≠ 0: where a body is rounded.
    """
    keep = np.ones(3)
    if still is not None:
        keep[still] = 0.0
    a, b, m_a, m_b, side = (ca.sparsify(numbers[k : k + 3] * constant(keep)) for k in (0, 3, 6, 9, 18))
    face, edges, points, r_a, r_b, on_second = (numbers[k] for k in range(12, 18))
    edges, points = edges if crossing else ca.SX(1, 1), points if apart else ca.SX(1, 1)
    at, other = first.position + first.rotation @ a, second.position + second.rotation @ b
    m_a, m_b = first.rotation @ m_a, second.rotation @ m_b
    line = ca.sparsify((at - other) * constant(keep))  # how far parts are apart along the still axis does not count
    across, free = ca.cross(m_a, m_b), line - m_a * ca.dot(m_a, line) - m_b * ca.dot(m_b, line)
    w = face * (m_a + m_b) + edges * across + points * free
    normal = w / ca.sqrt(ca.dot(w, w) + TINY)
    distance = ca.dot(normal, line)
    used = face + edges + points * points
    cosine = ca.dot(m_a, m_b)
    along = (cosine * ca.dot(m_b, line) - ca.dot(m_a, line)) / (1.0 - edges * cosine * cosine)
    on_edge = edges * along - (points * points) * ca.dot(m_a, line)
    core = at + m_a * on_edge + on_second * (other + normal * distance - at - m_a * on_edge)
    if still is None:
        one = ca.cross(second.rotation @ side, normal)
        one /= ca.sqrt(ca.dot(one, one) + TINY)
        sides = one, ca.cross(normal, one)
    else:
        axis = constant(np.eye(3)[still])
        sides = ca.cross(axis, normal), axis
    gap = distance - r_a - r_b + (1.0 - used) * length
    return Touch(gap, normal, core - r_a * normal, sides)
