"""The camera of the scene."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.pictures.shapes.extent import extent_of


def test_a_planar_mechanism_is_viewed_from_the_side_with_x_to_the_right():
    from mbd_sim.pictures.rerun import plots

    extent = extent_of(Simulation.from_file("double_rod").model)
    np.testing.assert_allclose(np.abs(extent.normal), [0.0, 1.0, 0.0], atol=1e-12)
    position, target, up = plots.eye(extent)
    forward = (target - position) / np.linalg.norm(target - position)
    assert forward[1] > 0.9
    assert np.cross(forward, up)[0] > 0.9
    assert position[2] > target[2]


def test_a_free_body_is_viewed_obliquely():
    from mbd_sim.pictures.rerun import plots

    extent = extent_of(Simulation.from_file("tumbling").model)
    assert extent.normal is None
    assert extent.size == pytest.approx(1.4)
    position, _, up = plots.eye(extent)
    assert np.all(np.isfinite(position))
    np.testing.assert_array_equal(up, [0.0, 0.0, 1.0])
