"""Coils, dashpots and curved arrows lead from end to end at any place and direction."""

import numpy as np
import pytest

from mbd_sim.pictures.shapes import solids


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
