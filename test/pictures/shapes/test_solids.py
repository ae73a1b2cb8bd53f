"""The solids of shapes have the sizes of the shapes."""

import numpy as np
import pytest

from mbd_sim.base.geometry.pose import identity_pose
from mbd_sim.mechanism.elements.parts import Shape
from mbd_sim.pictures.shapes.solids import Box, Cylinder, Ring, Rod, Sphere, half_sizes, solid_of

SHAPES = [
    (("rod", (2.0, 0.1)), Rod(2.0, 0.1), [0.1, 0.1, 1.0]),
    (("cylinder", (2.0, 0.5)), Cylinder(2.0, 0.5), [0.5, 0.5, 1.0]),
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
    record = Shape(kind, size, identity_pose())
    assert solid_of(record) == solid
    np.testing.assert_allclose(half_sizes(record), half)


def test_an_unknown_kind_of_shape_is_an_error():
    with pytest.raises(ValueError, match="no solid for a shape of kind 'cone'"):
        solid_of(Shape("cone", (1.0, 2.0), identity_pose()))
