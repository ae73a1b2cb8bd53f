"""The solids of shapes have the sizes of the shapes."""

from itertools import pairwise
from typing import get_args

import numpy as np
import pytest

from mbd_sim.base.geometry.pose import identity_pose
from mbd_sim.mechanism.elements.parts import Polyhedron, Shape, ShapeKind
from mbd_sim.mechanism.outlines.pieces import Outline, Straight
from mbd_sim.pictures.shapes.prisms import Prism
from mbd_sim.pictures.shapes.solids import (
    Box,
    Cone,
    Cylinder,
    Ellipsoid,
    Ring,
    Rod,
    Sphere,
    half_sizes,
    solid_of,
    triangles_of,
)

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
