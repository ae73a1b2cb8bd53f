"""Where a function of one variable is least: smooth minima at once, kinks and ends as well."""

import math

import numpy as np
import pytest

from mbd_sim.studies.kinematic_analysis.drive_line import least_place


@pytest.mark.parametrize(
    ("function", "most"),
    [
        (lambda y: 2.0 + 3.0 * y * y + y**3 / 3.0, 20),
        (lambda y: 1.0 - math.cos(0.5 * y), 20),
        (lambda y: abs(y) * (1.3 if y > 0.0 else 1.0), 60),  # the only way to a kink are golden sections
        (lambda y: math.inf if y > 0.1 else abs(y), 60),
    ],
)
def test_minima_inside_and_at_kinks_are_found_from_anywhere(function, most):
    """A wrong parabola is found by the number of steps, which golden sections alone exceed."""
    rng = np.random.default_rng(3)
    for _ in range(30):
        place, count = float(rng.uniform(-1.0, 1.0)), 0

        def counted(x, place=place):
            nonlocal count
            count += 1
            return function(x - place)

        low, high = place - float(rng.uniform(0.2, 1.0)), place + float(rng.uniform(0.2, 1.0))
        middle = None if rng.random() < 0.5 else float(rng.uniform(0.5 * (low + place), place + 0.05))
        found = least_place(counted, low, high, 3e-13, middle)
        assert abs(function(found - place) - function(0.0)) < 1e-11
        assert count <= most


def test_the_end_of_an_interval_is_the_least_of_a_monotone_function():
    assert least_place(lambda x: x, 1.0, 3.0, 1e-6) == pytest.approx(1.0, abs=1e-5)
    assert least_place(lambda x: x, 3.0, 1.0, 1e-6) == pytest.approx(1.0, abs=1e-5)  # it searched without end
    assert least_place(lambda x: -x, 1.0, 3.0, 1e-6) == pytest.approx(3.0, abs=1e-5)
