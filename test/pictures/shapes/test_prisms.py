"""Prisms as triangles: the faces are covered once, and a closed prism has the volume of its outline."""

import numpy as np
import pytest

from mbd_sim.mechanism.outlines.area import area_of
from mbd_sim.mechanism.outlines.pieces import polyline
from mbd_sim.pictures.shapes.prisms import Prism, polygon_triangles, prism_mesh
from test.generators.outlines import built, random_chain


def areas(points, triangles):
    a, b, c = points[triangles].transpose(1, 0, 2)
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


@pytest.mark.parametrize("seed", range(6))
def test_the_triangles_of_a_hollow_polygon_cover_it_once(seed):
    outline = built(random_chain(seed))
    points = polyline(outline)
    found = areas(points, polygon_triangles(points))
    assert np.all(found > 0.0)
    assert np.sum(found) == pytest.approx(area_of(outline).area, rel=2e-3)


def test_a_prism_is_closed_and_has_its_volume():
    points = polyline(built([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], {"to": [0.0, 1.0], "through": [1.0, 0.3]}]))
    corners, triangles = prism_mesh(Prism(tuple(map(tuple, points)), 0.5))
    a, b, c = corners[triangles].transpose(1, 0, 2)
    volume = np.sum(np.cross(a, b) * c) / 6.0
    assert volume == pytest.approx(0.5 * np.sum(areas(points, polygon_triangles(points))), rel=1e-12)
    edges = np.sort(np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    assert np.all(np.unique(edges, axis=0, return_counts=True)[1] == 2)
