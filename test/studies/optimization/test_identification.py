"""Parameters are found from measured states, with errors that say how well."""

import functools

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import InputError, MbdSimError, MechanismError
from mbd_sim.base.geometry.rotation import of_vector, product
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import load_mechanism
from mbd_sim.studies.optimization import (
    MeasuredRun,
    SensitivityModel,
    casadi_functions,
    identification,
    identify,
    trajectory,
)

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


def share_models(monkeypatch):
    """Compile each model once."""

    @functools.cache
    def build(mechanism, keys, **options):
        return SensitivityModel(mechanism, keys, **options)

    monkeypatch.setattr(identification, "SensitivityModel", lambda m, keys, **options: build(m, tuple(keys), **options))


def test_without_noise_the_parameters_are_exact():
    run = run_of("cart_pendulum_spring", 100, [0.1, 0.5, 0.0, 0.0])
    guess = {"mc": 1.3, "m": 0.8, "l": 1.2, "k": 15.0}
    found = identify(load_mechanism("cart_pendulum_spring"), run, guess)
    assert [one.value for one in found.estimates.values()] == pytest.approx([1.0, 1.0, 1.0, 20.0], rel=1e-9)
    assert np.max(found.noise) < 1e-9


def test_values_that_the_file_refuses_are_an_error_that_names_them():
    """The true damping is zero; noise makes the best fit negative."""
    mechanism = load_mechanism("rod_pendulum")
    run = run_of("rod_pendulum", 50, [0.5, 0.0], noise=0.01, seed=1)
    words = r"joints\.pin\.damping = -\S+ \(from -\S+ to \S+\), which the file refuses: .*at least 0.*Leave out"
    with pytest.raises(MbdSimError, match=words):
        identify(with_values(mechanism, {"joints.pin.damping": 0.0}), run, {"joints.pin.damping": 0.02})


def test_confidence_intervals_contain_the_truth_as_often_as_they_say(monkeypatch):
    """Of 2 parameters in 20 runs with intervals of 80 %: 32 of 40, within three standard deviations of 2.5."""
    share_models(monkeypatch)
    mechanism, inside, errors = load_mechanism("rod_pendulum"), 0, []
    for seed in range(20):
        run = run_of("rod_pendulum", 50, [0.5, 0.0], noise=0.01, seed=seed)
        found = identify(mechanism, run, ["m", "l"], interval=25, confidence=0.8)
        inside += sum(one.lower <= 1.0 <= one.upper for one in found.estimates.values())
        errors += [(one.value - 1.0) / one.error for one in found.estimates.values()]
        assert found.noise == pytest.approx([0.01, 0.01], rel=0.4)
    assert 25 <= inside <= 39
    assert 0.8 < np.std(errors) < 1.25


FOUR_BAR = {"crank": 0.5, "coupler": 1.4, "density": 1.0}


@functools.cache
def four_bar_run():
    """A motion of the linkage under changing efforts: its model, states, efforts and the path of the coupler's tip."""
    model = SensitivityModel(load_mechanism("four_bar"), list(FOUR_BAR), step=STEP, by_efforts=False)
    efforts = np.zeros((40, 3))
    efforts[:, 0] = np.repeat(np.random.default_rng(0).normal(scale=4.0, size=8), 5)
    own = model.functions
    found = model.at_steps(range(41), list(enumerate(efforts)), t0=0.0, x0=own.start, parameters=own.values,
                           points=["coupler.tip"])  # fmt: skip
    return model, found.x, efforts, found.points["coupler.tip"][0]


def identified(data, guess, **options):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(identification, "SensitivityModel", lambda *given, **named: four_bar_run()[0])
        return identify(load_mechanism("four_bar"), data, guess, **options)


def test_lengths_of_a_linkage_are_found_with_intervals_that_contain_them():
    """Of 3 parameters in 3 runs with intervals of 80 %: 7.2 of 9, within three standard deviations of 1.2."""
    _, states, efforts, _ = four_bar_run()
    inside, errors = 0, []
    for seed in range(3):
        noisy = states + 0.005 * np.random.default_rng(seed).normal(size=states.shape)
        found = identified(MeasuredRun(STEP, noisy, efforts), FOUR_BAR, interval=20, confidence=0.8)
        inside += sum(one.lower <= FOUR_BAR[key] <= one.upper for key, one in found.estimates.items())
        errors += [(one.value - FOUR_BAR[key]) / one.error for key, one in found.estimates.items()]
    assert inside >= 4
    assert np.max(np.abs(errors)) < 4.0
    assert found.noise == pytest.approx(6 * [0.005], rel=0.4)


def test_outputs_alone_determine_parameters():
    """The angle of the crank and the path of a point, not all of them measured; from wrong guesses to round-off."""
    _, states, efforts, path = four_bar_run()
    path, angle = path.copy(), states[:, 0].copy()
    path[1::2] = np.nan
    angle[7:11] = np.nan
    outputs = {"joints.crank_pivot.position": angle, "points.coupler.tip.position": path}
    guess = {"crank": 0.52, "coupler": 1.35, "density": 1.2}
    found = identified(MeasuredRun(STEP, None, efforts, outputs=outputs), guess)
    assert [one.value for one in found.estimates.values()] == pytest.approx(list(FOUR_BAR.values()), rel=1e-9)
    assert found.measured == ("joints.crank_pivot.position", *(f"points.coupler.tip.position.{axis}" for axis in "xyz"))
    without_speeds = states.copy()
    without_speeds[:, 3:] = np.nan
    found = identified(MeasuredRun(STEP, without_speeds, efforts), guess)
    assert [one.value for one in found.estimates.values()] == pytest.approx(list(FOUR_BAR.values()), rel=1e-9)
    speed = {"joints.crank_pivot.velocity": states[:, 3]}
    found = identified(MeasuredRun(STEP, None, efforts, outputs=speed, first_state=states[0]), guess)
    assert found.estimates["density"].value == pytest.approx(1.0, rel=1e-9)


def test_orientations_are_compared_by_rotations(monkeypatch):
    """The height of the mass of a top, from quaternions with noise of 2 mrad about each axis, of any sign and length."""
    share_models(monkeypatch)
    mechanism, random = load_mechanism("spherical_top"), np.random.default_rng(5)
    sim = Simulation(mechanism, step=STEP)
    states = [np.concatenate([sim.q, sim.u])]
    for _ in range(60):
        sim.step(1)
        states.append(np.concatenate([sim.q, sim.u]))
    states = np.array(states)
    for q in states[:, :4]:
        q[:] = 1.7 * random.choice([-1.0, 1.0]) * product(q, of_vector(0.002 * random.normal(size=3)))
    states[:, 4:] += 0.01 * random.normal(size=(61, 3))
    efforts = np.zeros((60, 3))
    found = identify(mechanism, MeasuredRun(STEP, states, efforts), {"h": 0.25}, interval=30)
    one = found.estimates["h"]
    assert abs(one.value - 0.2) < 4 * one.error < 0.01
    assert found.noise[:3] == pytest.approx([0.002] * 3, rel=0.4)
    assert found.measured[:3] == tuple(f"joints.point.orientation.{axis}" for axis in "xyz")
    by_output = {"joints.point.orientation": states[:, :4]}
    single = identify(mechanism, MeasuredRun(STEP, None, efforts, outputs=by_output), {"h": 0.21}).estimates["h"]
    assert abs(single.value - 0.2) < 4 * single.error


def test_several_runs_tell_more_than_one():
    runs = [run_of("rod_pendulum", 50, [0.5, 0.0], noise=0.01, seed=seed) for seed in range(4)]
    mechanism = load_mechanism("rod_pendulum")
    one, all_four = (identify(mechanism, data, ["m", "l"]).estimates["m"].error for data in (runs[0], runs))
    assert all_four < 0.8 * one


def test_parameters_that_the_motion_does_not_tell_apart_are_refused():
    """Without efforts, the motion of a pendulum does not depend on its mass."""
    run = run_of("rod_pendulum", 50, [0.5, 0.0])
    free = MeasuredRun(STEP, run.states, np.zeros_like(run.efforts))
    with pytest.raises(MbdSimError, match=r"do not (determine the parameters: m can|depend on m\.)"):
        identify(load_mechanism("rod_pendulum"), free, ["m", "l"])
    damped = Simulation.from_file("rod_pendulum", set={"joints.pin.damping": 0.2}, step=STEP)
    states = [damped.state[:2]]
    for _ in range(50):
        damped.step()
        states.append(damped.state[:2])
    with pytest.raises(MbdSimError, match=r"not determine the parameters: m, joints\.pin\.damping can change together"):
        identify(damped.mechanism, MeasuredRun(STEP, np.array(states), free.efforts), ["m", "l", "joints.pin.damping"])
    with pytest.raises(MbdSimError, match=r"not determine the parameters: "):
        identify(damped.mechanism, MeasuredRun(STEP, np.array(states[:2]), free.efforts[:1]), ["m", "l", "gravity[2]"])


def test_what_does_not_fit_is_refused(monkeypatch):
    share_models(monkeypatch)
    run = run_of("rod_pendulum", 20, [0.5, 0.0])
    with pytest.raises(InputError, match=r"\(n \+ 1, 4\)"):
        identify(load_mechanism("double_rod"), run, ["m"])
    pendulum = load_mechanism("rod_pendulum")
    for data, keys, message in (
        (run, [], "nothing to identify"),
        ([], ["m"], "nothing to identify"),
        (MeasuredRun(STEP, None, run.efforts), ["m"], "without measurements"),
        (MeasuredRun(STEP, run.states, np.nan * run.efforts), ["m"], "efforts are not finite"),
        (MeasuredRun(STEP, None, run.efforts, outputs={"joints.pn.position": run.states[:, 0]}), ["m"], r"'joints\.pn"),
        (MeasuredRun(STEP, None, run.efforts, outputs={"joints.pin.position": run.states}), ["m"], r"Give \(21,\)"),
        ([run, MeasuredRun(2 * STEP, run.states, run.efforts)], ["m"], "differ in their steps"),
        (MeasuredRun(STEP, run.states + np.inf, run.efforts), ["m"], "infinite.*nan"),
        (MeasuredRun(STEP, run.states, run.efforts, first_state=np.zeros(3)), ["m"], r"first_state .* \(3,\).*\(2,\)"),
    ):
        with pytest.raises(InputError, match=message):
            identify(pendulum, data, keys)
    with pytest.raises(InputError, match=r"efforts has the shape \(20,\)"):
        MeasuredRun(STEP, run.states, run.efforts[:, 0])
    with pytest.raises(InputError, match="confidence must be between 0 and 1, not 95"):
        identify(pendulum, run, ["m"], confidence=95)
    for guess in (-1.0, float("nan")):
        with pytest.raises(MechanismError, match=r"m(ass)?: must be"):
            identify(pendulum, run, {"m": guess})


def test_guesses_are_values_of_the_file_and_tables_may_be_lists(monkeypatch):
    share_models(monkeypatch)
    run, pendulum = run_of("rod_pendulum", 20, [0.5, 0.0]), load_mechanism("rod_pendulum")
    expected = identify(pendulum, run, {"m": 1.5}).estimates["m"]
    lists = MeasuredRun(STEP, run.states.tolist(), run.efforts.tolist())
    assert identify(pendulum, lists, {"m": "1500 g"}).estimates["m"] == expected
    assert identify(pendulum, run, "m").estimates["m"].value == pytest.approx(expected.value, rel=1e-6)
