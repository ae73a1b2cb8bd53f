"""Parameters are found from measured states, with errors that say how well."""

import functools

import numpy as np
import pytest

from mbd_sim.errors import InputError, MbdSimError
from mbd_sim.load import load_mechanism
from mbd_sim.optimization import MeasuredRun, casadi_functions, identification, identify, trajectory

STEP = 0.02


@functools.cache
def functions_of(name):
    return casadi_functions(load_mechanism(name))


def run_of(name, steps, start, noise=0.0, seed=0):
    """A run with random efforts and measured with noise."""
    functions, random = functions_of(name), np.random.default_rng(seed)
    efforts = np.repeat(random.normal(scale=2.0, size=(steps // 10, len(functions.coordinates))), 10, axis=0)
    states = np.array(trajectory(functions, steps, STEP)(0, start, efforts.T, [])).T
    return MeasuredRun(STEP, states + noise * random.normal(size=states.shape), efforts)


def test_without_noise_the_parameters_are_exact():
    run = run_of("cart_pendulum_spring", 100, [0.1, 0.5, 0.0, 0.0])
    guess = {"mc": 1.3, "m": 0.8, "l": 1.2, "k": 15.0}
    found = identify(load_mechanism("cart_pendulum_spring"), run, guess)
    assert [one.value for one in found.estimates.values()] == pytest.approx([1.0, 1.0, 1.0, 20.0], rel=1e-9)
    assert np.max(found.noise) < 1e-9


def test_confidence_intervals_contain_the_truth_as_often_as_they_say(monkeypatch):
    """Of 2 parameters in 40 runs with intervals of 80 %: 64 of 80, within three standard deviations of 3.6."""
    build = functools.cache(lambda mechanism, keys: casadi_functions(mechanism, keys))
    monkeypatch.setattr(identification, "casadi_functions", lambda mechanism, keys: build(mechanism, tuple(keys)))
    mechanism, inside, errors = load_mechanism("rod_pendulum"), 0, []
    for seed in range(40):
        run = run_of("rod_pendulum", 50, [0.5, 0.0], noise=0.01, seed=seed)
        found = identify(mechanism, run, ["m", "l"], interval=25, confidence=0.8)
        inside += sum(one.lower <= 1.0 <= one.upper for one in found.estimates.values())
        errors += [(one.value - 1.0) / one.error for one in found.estimates.values()]
        assert found.noise == pytest.approx([0.01, 0.01], rel=0.4)
    assert 54 <= inside <= 74
    assert 0.8 < np.std(errors) < 1.25


def test_several_runs_tell_more_than_one():
    runs = [run_of("rod_pendulum", 50, [0.5, 0.0], noise=0.01, seed=seed) for seed in range(4)]
    mechanism = load_mechanism("rod_pendulum")
    one, all_four = (identify(mechanism, data, ["m", "l"]).estimates["m"].error for data in (runs[0], runs))
    assert all_four < 0.8 * one


def test_parameters_that_the_motion_does_not_tell_apart_are_refused():
    """Without efforts, the motion of a pendulum does not depend on its mass."""
    run = run_of("rod_pendulum", 50, [0.5, 0.0])
    free = MeasuredRun(STEP, run.states, np.zeros_like(run.efforts))
    with pytest.raises(MbdSimError, match=r"do not (determine|depend)"):
        identify(load_mechanism("rod_pendulum"), free, ["m", "l"])


def test_what_does_not_fit_is_refused():
    run = run_of("rod_pendulum", 20, [0.5, 0.0])
    with pytest.raises(InputError, match=r"\(n \+ 1, 4\)"):
        identify(load_mechanism("double_rod"), run, ["m"])
    with pytest.raises(InputError, match="nothing to identify"):
        identify(load_mechanism("rod_pendulum"), run, [])
    with pytest.raises(MbdSimError, match="constraints"):
        identify(load_mechanism("four_bar"), run, ["crank"])
