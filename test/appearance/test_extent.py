"""The box that the motion fills."""

import pytest

from mbd_sim import Simulation
from mbd_sim.appearance.extent import extent_of


def test_the_extent_contains_the_swing_of_the_rods():
    extent = extent_of(Simulation.from_file("double_rod").model)
    assert extent.size == pytest.approx(2.0, abs=0.1)
    assert -2.1 < extent.lower[0] < -1.0
    assert -2.1 < extent.lower[2] < -1.5
    assert extent.upper[0] == pytest.approx(2.0, abs=0.1)
    assert extent.upper[2] < 1.0
