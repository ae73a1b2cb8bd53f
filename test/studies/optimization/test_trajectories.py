"""Trajectories are those of the simulation, and their derivatives those of differences."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import InputError
from mbd_sim.files.load import load_mechanism
from mbd_sim.studies.optimization import casadi_functions, one_step, trajectory

STEPS, STEP = 40, 0.01


@pytest.mark.parametrize("name", ["double_rod", "four_bar", "spherical_top", "spun_tube_particle"])
def test_a_trajectory_is_that_of_the_simulation(name):
    functions = casadi_functions(load_mechanism(name))
    sim = Simulation.from_file(name, method="tsitouras8", step=STEP)
    random = np.random.default_rng(1)
    efforts = random.normal(size=(len(functions.coordinates), STEPS))
    expected = [np.concatenate([sim.q, sim.u])]
    for column in efforts.T:
        sim.set_efforts(column)
        sim.step(1)
        expected.append(np.concatenate([sim.q, sim.u]))
    own = np.array(trajectory(functions, STEPS, STEP)(0, functions.start, efforts, [])).T
    assert np.allclose(own, expected, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("by", ["x0", "e", "p"])
def test_derivatives_agree_with_differences(by):
    functions = casadi_functions(load_mechanism("cart_pendulum_spring"), ["m", "l", "k"])
    function = trajectory(functions, STEPS, STEP)
    random = np.random.default_rng(2)
    given = {"t0": 0.0, "x0": random.normal(size=4), "e": random.normal(size=(2, STEPS)), "p": functions.values}
    exact = np.array(function.factory("d", function.name_in(), [f"jac:x:{by}"])(**given)[f"jac_x_{by}"])
    for index in random.choice(given[by].size, min(given[by].size, 6), replace=False):

        def moved(size, index=index):
            changed = given[by].ravel(order="F").copy()
            changed[index] += size
            return np.array(function(**{**given, by: changed.reshape(given[by].shape, order="F")})["x"]).ravel(
                order="F"
            )

        h = 1e-3
        difference = (8 * (moved(h) - moved(-h)) - (moved(2 * h) - moved(-2 * h))) / (12 * h)
        difference_of_half = (8 * (moved(h / 2) - moved(-h / 2)) - (moved(h) - moved(-h))) / (6 * h)
        difference = difference_of_half + (difference_of_half - difference) / 15  # Richardson's extrapolation
        assert np.allclose(exact[:, index], difference, rtol=1e-8, atol=1e-8 * max(1.0, np.max(np.abs(difference))))


def test_derivatives_stay_on_the_constraints():
    """By the start state, projected onto the constraints: differentials of later states satisfy G δu + … = 0."""
    functions = casadi_functions(load_mechanism("four_bar"))
    function = trajectory(functions, 5, STEP)
    by_start = np.array(
        function.factory("d", function.name_in(), ["jac:x:x0"])(0, functions.start, np.zeros((3, 5)), [])
    )
    last = by_start[-6:-3]
    gradient = np.array(functions.G(0, function(0, functions.start, np.zeros((3, 5)), [])[:, -1], []))
    assert np.max(np.abs(gradient @ last)) < 1e-9


def test_what_is_no_trajectory_is_refused():
    functions = casadi_functions(load_mechanism("rod_pendulum"))
    with pytest.raises(InputError, match="not a trajectory"):
        trajectory(functions, 0, STEP)
    with pytest.raises(TypeError, match="integer"):
        trajectory(functions, 1.5, STEP)
    with pytest.raises(InputError, match="no explicit method 'rk5'"):
        one_step(functions, STEP, "rk5")
