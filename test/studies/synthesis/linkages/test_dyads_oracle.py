"""All dyads of four and five poses, found by derivations that share neither unknowns nor code with the dyads."""

import numpy as np
import pytest
import sympy

from mbd_sim.studies.synthesis.linkages import PlanePose
from mbd_sim.studies.synthesis.linkages.dyads import displacements_of, dyads_of_five, dyads_of_four
from test.studies.synthesis.linkages.linkages import four_bar_poses, random_poses


def rational_displacements(random, count):
    """Exact cosines, sines and shifts of `count` further poses, the first being that of ground."""
    found = []
    for _ in range(count):
        half, x, y = (sympy.Rational(int(random.integers(-12, 13)), 4) for _ in range(3))
        found.append(((1 - half**2) / (1 + half**2), 2 * half / (1 + half**2), x, y))
    return found


def exact_pairs(displacements):
    """All real pairs of center and point, by the centers: three conditions are linear in the point.

    Their determinants for poses 1, 2, 3, 4 and for 1, 2, 3, 5 are cubics in the center. Two of their nine common points
    are the circular points at infinity, three the poles of 1, 2 and 3; four are left (Bottema & Roth, ch. VIII).
    """
    x, y = sympy.symbols("x y")
    rows = []
    for cosine, sine, u, v in displacements:
        seen = sympy.Matrix([[cosine, sine], [-sine, cosine]]) * sympy.Matrix([x - u, y - v])  # the center, in the body
        rows.append([seen[0] - x, seen[1] - y, (seen.dot(seen) - x**2 - y**2) / 2])
    cubics = [sympy.Matrix([rows[0], rows[1], rows[index]]).det(method="berkowitz") for index in (2, 3)]
    polynomials = [sympy.Poly(sympy.expand(cubic), y) for cubic in cubics]
    both = [sympy.Poly(sympy.expand(cubic), y, x) for cubic in cubics]
    ends = sympy.Poly(both[0].resultant(both[1]).as_expr(), x)
    assert ends.degree() == 7
    found = []
    for root in ends.nroots(n=25, maxsteps=500):
        if abs(sympy.im(root)) > 1e-15:
            continue
        at = [np.array([complex(one.subs(x, sympy.re(root))) for one in cubic.all_coeffs()]) for cubic in polynomials]
        center_y = min(np.roots(at[0]), key=lambda one: abs(np.polyval(at[1], one)))
        center = complex(float(sympy.re(root)), center_y.real)
        conditions = np.array(
            [[float(one.subs({x: center.real, y: center.imag})) for one in row] for row in rows], dtype=float
        )
        point, _, rank, _ = np.linalg.lstsq(conditions[:, :2], conditions[:, 2], rcond=None)
        if rank == 2 and np.max(np.abs(conditions[:, :2] @ point - conditions[:, 2])) < 1e-6:
            found.append((center, complex(*point)))
    return found


def test_five_poses_have_exactly_the_dyads_of_exact_elimination():
    random, counts = np.random.default_rng(6), set()
    for _ in range(5):
        displacements = rational_displacements(random, 4)
        poses = [PlanePose(0.0, 0.0, 0.0)]
        poses += [PlanePose(float(x), float(y), float(sympy.atan2(s, c))) for c, s, x, y in displacements]
        expected, found = exact_pairs(displacements), dyads_of_five(displacements_of(poses))
        counts.add(len(expected))
        assert len(found) == len(expected)
        for center, point in expected:
            nearest = min(found, key=lambda one: abs(one.center - center) + abs(one.point - point))
            assert (nearest.center, nearest.point) == pytest.approx((center, point), rel=1e-6, abs=1e-6)
    assert counts == {0, 2, 4}


def links_by_turn(motion, turn):
    """The links that turn by a given angle from pose 1 to 2 (Sandor & Erdman, ch. 3: the compatibility linkage).

    The link W and the vector Z from its end to the origin of the body satisfy W (exp(i beta_j) - 1) + Z (A_j - 1) =
    B_j, three equations in two unknowns: a determinant of them is a four-bar of known vectors, which two turns close.
    """
    a, b = motion.turns[1:] - 1.0, motion.shifts[1:]
    minors = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    closing = sum(minors) - minors[0] * np.exp(1j * turn)  # = minors[1] exp(i beta_3) + minors[2] exp(i beta_4)
    r, p, q = abs(closing), abs(minors[1]), abs(minors[2])
    cosine = (r * r + p * p - q * q) / (2.0 * r * p)
    if abs(cosine) > 1.0:
        return []
    found = []
    for sign in (1.0, -1.0):
        third = closing / r * np.exp(1j * sign * np.arccos(cosine)) * p / minors[1]
        left = np.array([[np.exp(1j * turn) - 1.0, a[0]], [third - 1.0, a[1]]])
        if abs(np.linalg.det(left)) < 1e-12:
            continue
        link, body = np.linalg.solve(left, b[:2])
        found.append((complex(-body - link), complex(-body)))
    return found


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_four_poses_have_the_dyads_of_the_compatibility_linkage(seed):
    """Each link of the curve is among the two that its turn alone gives."""
    random = np.random.default_rng(seed)
    poses = random_poses(random, 4) if seed else four_bar_poses([0.1, 0.9, 2.0, 3.1])[0]
    motion = displacements_of(poses)
    links = [one for one in dyads_of_four(motion, 60) if one.kind == "RR"]
    for link in links:
        arms = motion.of(link.point) - link.center
        others = links_by_turn(motion, float(np.angle(arms[1] / arms[0])))
        apart = min(abs(center - link.center) + abs(point - link.point) for center, point in others)
        assert apart < 1e-5 * (motion.size + link.length)
