"""The pieces of outlines: each begins where the one before ends, and has the normals and the curvature it states."""

import math

import numpy as np
import pytest

from mbd_sim.mechanism.outlines.crossings import self_crossing
from mbd_sim.mechanism.outlines.pieces import Round, Straight
from test.generators.outlines import built, random_chain


@pytest.mark.parametrize("seed", range(20))
def test_pieces_meet_and_corners_fill_the_turn_between_their_neighbors(seed):
    pieces = built(random_chain(seed)).pieces
    for piece, following in zip(pieces, (*pieces[1:], pieces[0]), strict=True):
        assert math.dist(piece.end, following.start) < 1e-13
        turn = math.remainder(following.first - piece.last, 2.0 * math.pi)
        assert turn < 1e-6  # a turn to the left is that of a corner
        if any(isinstance(one, Round) and one.is_corner for one in (piece, following)):
            assert turn == pytest.approx(0.0, abs=1e-12)
    assert sum(piece.last - piece.first for piece in pieces) >= 2.0 * math.pi - 1e-9  # reentrant corners turn back


@pytest.mark.parametrize("piece", [Straight((0.0, 1.0), (2.0, 0.5)), Round((0.1, 0.2), 0.5, 0.3, 2.0),
                                   Round((0.1, 0.2), -0.5, 2.0, 0.3), Round((0.1, 0.2), 0.3, -1.0, 0.5, 0.4),
                                   Round((0.1, 0.2), 0.7, -1.0, 0.5, -0.4)])  # fmt: skip
def test_slopes_normals_and_curvature_are_those_of_the_points(piece):
    shares, step = np.linspace(0.1, 0.9, 5), 1e-5
    slopes = piece.slopes(shares)
    ahead, behind = piece.points(shares + step), piece.points(shares - step)
    np.testing.assert_allclose(slopes, (ahead - behind) / (2.0 * step), rtol=1e-7, atol=1e-9)
    angles = piece.first + (piece.last - piece.first) * shares
    outward = np.column_stack([slopes[:, 1], -slopes[:, 0]]) / np.linalg.norm(slopes, axis=1)[:, None]
    np.testing.assert_allclose(outward, np.column_stack([np.cos(angles), np.sin(angles)]), atol=1e-12)
    if isinstance(piece, Round):
        for angle, point in zip(angles, piece.points(shares), strict=True):
            np.testing.assert_allclose(piece.at(angle), point, atol=1e-15)
        radii = np.linalg.norm(slopes, axis=1) / (piece.last - piece.first)
        np.testing.assert_allclose([piece.reach(angle) for angle in angles], radii, rtol=1e-12)


@pytest.mark.parametrize("hand", [1.0, -1.0])
@pytest.mark.parametrize("outward", [True, False])
def test_an_involute_leads_through_its_ends_and_its_normals_touch_the_base_circle(hand, outward):
    b, rolls = 0.2, (0.4, 1.3)
    ends = [
        (0.1 + b * (math.cos(s) + s * math.sin(s)), 0.2 + hand * b * (math.sin(s) - s * math.cos(s))) for s in rolls
    ]
    one, other = ends if outward else ends[::-1]
    points = [
        list(one),
        {"to": list(other), "involute": b, "center": [0.1, 0.2]},
        [-5.0, 0.2 - 3.0 * hand * (1.0 if outward else -1.0)],
    ]
    curve = next(piece for piece in built(points).pieces if isinstance(piece, Round) and piece.growth)
    assert {tuple(np.round(curve.start, 12)), tuple(np.round(curve.end, 12))} == {
        tuple(np.round(end, 12)) for end in ends
    }
    for share in (0.2, 0.7):
        (x, y), (dx, dy) = curve.points(np.array([share]))[0] - (0.1, 0.2), curve.slopes(np.array([share]))[0]
        assert abs(x * dx + y * dy) / math.hypot(dx, dy) == pytest.approx(b, rel=1e-12)


def test_a_chain_that_is_repeated_is_turned_about_the_origin():
    outline = built([[1.0, 0.0], {"to": [0.0, 1.2], "through": [0.8, 0.8]}], repeat=4)
    starts = [piece.start for piece in outline.pieces if isinstance(piece, Straight)]
    assert len(starts) == 4
    np.testing.assert_allclose(starts[1], [-starts[0][1], starts[0][0]], atol=1e-15)


CROSSING = [
    [[0, 0], [1, 1], [1, 0], [0, 1]],
    [[0, 0], [1, 0], {"to": [1, 1], "through": [-0.2, 0.5]}, [0, 1]],
    [[0, 0], [2, 0], [2, 1], [1, 0], [0, 1]],  # touches with a corner
    [[0, 0], [2, 0], [2, 1], [1.5, 0], [0.5, 0], [0, 1]],  # lies on itself
    [[0, 0], {"to": [2, 0], "radius": -1.2}, {"to": [0, 0.2], "radius": 5}],
]


@pytest.mark.parametrize("points", CROSSING)
def test_an_outline_that_meets_itself_is_found(points):
    assert self_crossing(built(points)) is not None


@pytest.mark.parametrize("seed", range(20))
def test_random_chains_do_not_meet_themselves(seed):
    assert self_crossing(built(random_chain(seed))) is None
