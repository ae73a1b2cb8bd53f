"""Dead centers and functions: the linkages found have what was asked for, by closed forms and in motion."""

import numpy as np
import pytest

from mbd_sim import InputError, parse_mechanism
from mbd_sim.studies.kinematic_analysis import driven_motion, limit_positions
from mbd_sim.studies.synthesis.linkages import (
    chebyshev_positions,
    crank_rockers,
    function_four_bars,
    slider_cranks,
)
from mbd_sim.studies.synthesis.linkages.functions import follower_angles
from mbd_sim.studies.synthesis.linkages.mechanism_files import DRIVER, four_bar_text, slider_crank_text

TURN = np.linspace(0.0, 2.0 * np.pi, 40001)


def test_crank_rockers_of_a_family_have_the_swing_and_the_time_ratio():
    """The follower's angle over a turn of the crank, by the law of cosines; every member, not only the best."""
    swing, ratio = np.radians(60.0), 1.25
    found = crank_rockers(swing, ratio)
    assert found.best.transmission == max(one.transmission for one in found.family)
    for one in [found.best, *found.family[::400]]:
        phi = np.unwrap(follower_angles(TURN, one.crank / one.base, one.coupler / one.base, one.rocker / one.base, 1.0))
        assert np.ptp(phi) == pytest.approx(swing, abs=1e-6)
        between = abs(TURN[np.argmax(phi)] - TURN[np.argmin(phi)])
        between = max(between, 2.0 * np.pi - between)
        assert between / (2.0 * np.pi - between) == pytest.approx(ratio, abs=2e-3)


def test_equal_times_are_the_central_crank_rocker():
    """a = c sin(ψ/2) and a² + d² = b² + c² (Norton, ch. 3)."""
    one = crank_rockers(np.radians(45.0)).best
    assert one.crank == pytest.approx(one.rocker * np.sin(np.radians(22.5)), rel=1e-9)
    assert one.crank**2 + one.base**2 == pytest.approx(one.coupler**2 + one.rocker**2, rel=1e-9)


def test_a_slider_crank_has_the_stroke_and_runs():
    one = slider_cranks(0.08, 1.2).best
    mechanism = parse_mechanism(slider_crank_text("press", one, "A press."))
    motion = driven_motion(mechanism, {DRIVER: (0.0, 2.0 * np.pi)}, 181)
    ends = [extreme.value for extreme in limit_positions(motion, "slider")]
    assert max(ends) - min(ends) == pytest.approx(0.08, abs=1e-9)
    angles = sorted(extreme.drive for extreme in limit_positions(motion, "slider"))
    between = angles[1] - angles[0]
    assert max(between, 2 * np.pi - between) / min(between, 2 * np.pi - between) == pytest.approx(1.2, abs=1e-9)


@pytest.mark.parametrize(("swing", "ratio"), [(np.radians(200.0), 1.0), (1.0, 0.5), (1.0, 5.0)])
def test_impossible_dead_centers_are_refused(swing, ratio):
    with pytest.raises(InputError):
        crank_rockers(swing, ratio)


@pytest.mark.parametrize("count", [3, 4, 5])
def test_functions_of_random_four_bars_lead_back_to_them(count):
    """With 4 pairs the zero of the follower is lost, with 5 that of the crank as well."""
    random = np.random.default_rng(count)
    for _ in range(40):
        a, b, c = random.uniform([0.2, 0.8, 0.8], [0.5, 2.0, 2.0])
        theta = np.sort(random.uniform(0.0, 2.0 * np.pi, count))
        phi = follower_angles(theta, a, b, c, 1.0)
        if not np.all(np.isfinite(phi)):
            continue
        lost = random.uniform(-1.0, 1.0, 2) * [count == 5, count > 3]
        found = function_four_bars(theta + lost[0], phi + lost[1])
        assert min(abs(one.crank - a) + abs(one.coupler - b) + abs(one.follower - c) for one in found) < 1e-6
        assert len(found) <= {3: 1, 4: 2, 5: 3}[count]


def test_a_function_of_many_positions_is_closer_than_an_exact_one_and_runs():
    def angles(x):
        return np.radians(90.0) * (x - 1.0), np.radians(60.0) * (x**1.5 - 1.0) / (2.0**1.5 - 1.0)

    dense = np.linspace(1.0, 2.0, 41)
    one = function_four_bars(*angles(dense))[0]
    assert one.defects == "" and np.max(np.abs(one.deviations)) < np.radians(0.01)
    exact = function_four_bars(*angles(chebyshev_positions(1.0, 2.0, 5)))[0]
    start = exact.theta[0] - angles(chebyshev_positions(1.0, 2.0, 5))[0][0]
    phi = follower_angles(angles(dense)[0] + start, exact.crank, exact.coupler, exact.follower, exact.mode)
    errors = np.unwrap(phi) - angles(dense)[1]
    assert np.std(errors) >= np.sqrt(np.mean(one.deviations**2)) * 0.999
    text = four_bar_text("power", (one.crank, one.coupler, one.follower, 1.0), one.theta, one.mode, "A power.")
    motion = driven_motion(parse_mechanism(text), {DRIVER: (one.theta[0], one.theta[-1])}, 41)
    turned = motion.coordinate("rocker")[0]
    assert turned - turned[0] == pytest.approx(angles(dense)[1], abs=2e-4)
