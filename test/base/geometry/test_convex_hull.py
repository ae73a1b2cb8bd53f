"""Convex hulls against Qhull, and what a hull that is cut short, flat or degenerate is."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.convex_hull import convex_hull, face_normals, fans

EVERY = 10_000


def cube(count):
    return np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, count)] * 3), axis=-1).reshape(-1, 3)


def volume(points, hull):
    a, b, c = points[list(hull.corners)][fans(hull.faces)].swapaxes(0, 1)
    return float(np.sum(np.einsum("ij,ij->i", a, np.cross(b, c)))) / 6.0


def assert_hull(points, hull):
    """A closed surface of plane polygons that run counterclockwise, with all points on or below them."""
    corners, size = points[list(hull.corners)], float(np.max(np.ptp(points, axis=0)))
    assert len(corners) - sum(map(len, hull.faces)) // 2 + len(hull.faces) == 2  # Euler
    edges = {(face[side - 1], face[side]) for face in hull.faces for side in range(len(face))}
    assert len(edges) == sum(map(len, hull.faces)) and all((stop, start) in edges for start, stop in edges)
    for face, normal in zip(hull.faces, face_normals(corners, hull.faces), strict=True):
        heights = (points - corners[face[0]]) @ normal
        assert heights.max() < hull.beyond + 1e-9 * size
        assert np.abs(heights[[hull.corners[corner] for corner in face]]).max() < 1e-9 * size


@pytest.mark.parametrize("count", [2, 3, 5])
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e4])
def test_a_cube_has_eight_corners_and_six_faces_whatever_points_lie_on_or_in_it(count, size):
    points = size * (cube(count) @ Rotation.random(rng=count).as_matrix() + [3.0, -2.0, 1.0])
    hull = convex_hull(points, EVERY)
    assert_hull(points, hull)
    assert (len(hull.corners), len(hull.faces), hull.beyond) == (8, 6, 0.0)
    assert volume(points, hull) == pytest.approx(size**3)


@pytest.mark.parametrize("seed", range(24))
def test_hulls_of_random_points_are_those_of_qhull(seed):
    """Rounded points share planes, edges and places."""
    chance = np.random.default_rng(seed)
    points = chance.normal(size=(chance.integers(8, 60), 3))
    if seed % 2:
        points = np.round(points, int(chance.integers(0, 2)))
    points = points @ Rotation.random(rng=seed).as_matrix()
    hull = convex_hull(points, EVERY)
    assert_hull(points, hull)
    assert volume(points, hull) == pytest.approx(ConvexHull(points).volume, rel=1e-8)
    if seed % 2 == 0:
        assert set(hull.corners) == set(ConvexHull(points).vertices.tolist())


def test_a_hull_with_few_corners_is_close_and_says_how_far_the_others_are_beyond_it():
    points = np.random.default_rng(1).normal(size=(5000, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    hull = convex_hull(points, 100)
    assert len(hull.corners) == 100
    planes = ConvexHull(points[list(hull.corners)]).equations
    assert hull.beyond == pytest.approx(np.max(points @ planes[:, :3].T + planes[:, 3]))
    assert hull.beyond < 0.06


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (np.ones((9, 3)), "at least 4 different points"),
        (cube(2)[:3], "at least 4 different points"),
        (np.outer(np.arange(6.0), [1.0, 2.0, 3.0]), "on a line"),
        (cube(3) * [1.0, 1.0, 1e-7], "in a plane"),
    ],
)
def test_points_without_a_solid_are_refused(points, words):
    with pytest.raises(InputError, match=words):
        convex_hull(points @ Rotation.random(rng=1).as_matrix(), EVERY)
