"""The solids of shapes have the sizes of the shapes."""

from itertools import pairwise
from typing import get_args

import numpy as np
import pytest

from mbd_sim.base.geometry.pose import identity_pose
from mbd_sim.mechanism.elements.parts import Polyhedron, Shape, ShapeKind
from mbd_sim.mechanism.outlines.area import area_of
from mbd_sim.mechanism.outlines.pieces import Outline, Straight, polyline
from mbd_sim.pictures.shapes import solids
from mbd_sim.pictures.shapes.solids import (
    Box,
    Cone,
    Cylinder,
    Ellipsoid,
    Prism,
    Ring,
    Rod,
    Sphere,
    half_sizes,
    polygon_triangles,
    prism_mesh,
    solid_of,
    triangles_of,
)
from test.generators.outlines import built, random_chain

WEDGE = Polyhedron(
    ((-1.0, -2.0, -3.0), (1.0, -2.0, -3.0), (0.0, 2.0, -3.0), (0.0, 0.0, 3.0)),
    ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)),
)

SQUARE = Outline(
    tuple(Straight(*ends) for ends in pairwise([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0)]))
)

SHAPES = [
    (("outline", (0.5,)), Prism(((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)), 0.5), [1.0, 1.0, 0.25]),
    (("rod", (2.0, 0.1)), Rod(2.0, 0.1), [0.1, 0.1, 1.0]),
    (("cylinder", (2.0, 0.5)), Cylinder(2.0, 0.5), [0.5, 0.5, 1.0]),
    (("cone", (2.0, 0.5)), Cone(2.0, 0.5), [0.5, 0.5, 1.0]),
    (("capsule", (2.0, 0.5)), Rod(2.0, 0.5), [0.5, 0.5, 1.5]),
    (("ellipsoid", (0.5, 1.0, 1.5)), Ellipsoid((0.5, 1.0, 1.5)), [0.5, 1.0, 1.5]),
    (("hull", ()), WEDGE, [1.0, 2.0, 3.0]),
    (("disc", (0.5,)), Cylinder(0.04, 0.5, disc=True), [0.5, 0.5, 0.0]),
    (("ring", (0.5,)), Ring(0.5, 0.02), [0.5, 0.5, 0.0]),
    (("plate", (1.0, 2.0)), Box((1.0, 2.0, 0.02)), [0.5, 1.0, 0.0]),
    (("block", (1.0, 2.0, 3.0)), Box((1.0, 2.0, 3.0)), [0.5, 1.0, 1.5]),
    (("sphere", (0.5,)), Sphere(0.5), [0.5, 0.5, 0.5]),
    (("particle", (0.5,)), Sphere(0.5, particle=True), [0.5, 0.5, 0.5]),
]


@pytest.mark.parametrize(("shape", "solid", "half"), SHAPES, ids=[shape[0] for shape, _, _ in SHAPES])
def test_every_kind_of_shape_has_a_solid_and_a_box(shape, solid, half):
    kind, size = shape
    record = Shape(kind, size, identity_pose(), hull=WEDGE if kind == "hull" else None, outline=SQUARE)
    assert solid_of(record) == solid
    np.testing.assert_allclose(half_sizes(record), half)


def test_these_are_all_kinds():
    assert sorted(shape[0] for shape, _, _ in SHAPES) == sorted(get_args(ShapeKind))


@pytest.mark.parametrize(("solid", "volume"), [(WEDGE, 8.0), (Cone(3.0, 2.0), 4.0 * np.pi)])
def test_triangles_of_solids_enclose_their_volume_and_face_outward(solid, volume):
    """A cone has 48 corners, with 0.3 % less."""
    a, b, c = triangles_of(solid).swapaxes(0, 1)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0 == pytest.approx(volume, rel=3e-3)
    assert np.all(np.einsum("ij,ij->i", np.cross(b - a, c - a), a) > 0.0)


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


def test_a_corner_between_whose_neighbors_a_notch_ends_is_not_cut_off():
    half = [(0.3, 1.0), (2.0, 1.5), (2.0, 3.0), (0.05, 3.0)]
    points = np.array([(0.0, 0.0), *half, (0.0, 0.2), *((-x, y) for x, y in reversed(half))])
    assert np.all(areas(points, polygon_triangles(points)) > 0.0)


def test_a_prism_is_closed_and_has_its_volume():
    points = polyline(built([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], {"to": [0.0, 1.0], "through": [1.0, 0.3]}]))
    corners, triangles = prism_mesh(Prism(tuple(map(tuple, points)), 0.5))
    a, b, c = corners[triangles].transpose(1, 0, 2)
    volume = np.sum(np.cross(a, b) * c) / 6.0
    assert volume == pytest.approx(0.5 * np.sum(areas(points, polygon_triangles(points))), rel=1e-12)
    edges = np.sort(np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    assert np.all(np.unique(edges, axis=0, return_counts=True)[1] == 2)


@pytest.mark.parametrize("stop", [[1.0, 2.0, 3.5], [1.0, 2.0, 2.0], [1.0, 2.0, 3.0]])
@pytest.mark.parametrize("points", [solids.coil(0.1), solids.dashpot(0.1)], ids=["coil", "dashpot"])
def test_springs_and_dampers_lead_from_end_to_end(points, stop):
    start = np.array([1.0, 2.0, 3.0])
    line = solids.between(points, start, np.array(stop))
    assert line.shape == points.shape
    np.testing.assert_allclose(line[[0, -1]], [start, stop], atol=1e-12)


def test_the_windings_of_a_coil_keep_their_radius_when_it_is_stretched():
    line = solids.between(solids.coil(0.1), np.zeros(3), np.array([0.0, 5.0, 0.0]))
    assert np.max(np.hypot(line[:, 0], line[:, 2])) == pytest.approx(0.1)


def test_a_flat_coil_has_its_straight_ends_and_its_amplitude():
    forward, sideways = solids.flat_coil(100.0, 12.0, 5, 6.0).T
    assert forward.min() >= 12.0 - 1e-9
    assert forward.max() <= 88.0 + 1e-9
    assert np.ptp(sideways) == pytest.approx(12.0, rel=1e-2)


def test_a_spiral_grows_from_its_inner_to_its_outer_radius():
    radii = np.linalg.norm(solids.spiral(1.0, 3.0, 2.5), axis=1)
    np.testing.assert_allclose(radii, np.linspace(1.0, 3.0, 120), atol=1e-12)


def test_a_curved_arrow_is_right_handed_about_its_axis():
    points = solids.arc_arrow(np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.5, 2.0)[: solids.ARC_POINTS]
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 2.0, atol=1e-12)
    assert np.all(np.cross(points[:-1], points[1:])[:, 2] > 0.0)
