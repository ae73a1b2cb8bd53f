"""Steps of the Taylor method: accuracy, the same bits however steps are divided, and a new expansion after any change."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from mbd_sim import DivergedError, Ensemble, MechanismError, Simulation
from mbd_sim.compiler import taylor_step
from mbd_sim.compiler.kernel import compile_kernel
from mbd_sim.compiler.method_history import history_size
from mbd_sim.compiler.taylor_history import POSITION, SPAN
from mbd_sim.integrators.methods import METHODS
from mbd_sim.simulation import method_choice

METHOD = "taylor"
# A chain, a loop, a drive, a quaternion, rolling: the first four with loops over the order, and one without.
NAMES = ("double_rod", "four_bar", "moving_support_pendulum", "heavy_top", "disk_weight", "simple_pendulum")
PULSE = """
mechanism: pulse
parts: {block: {mass: 2}}
joints: {slide: {type: prismatic, between: [ground, block], axis: [1, 0, 0]}}
forces: {push: {type: effort, coordinate: slide, effort: "4 / (exp((t - 0.5) / 0.002) + exp(-(t - 0.5) / 0.002))"}}
"""


def built(name="double_rod", **options):
    return Simulation.from_file(name, method=METHOD, **options)


def same(*simulations):
    return len({s.state.tobytes() + s.history.tobytes() for s in simulations}) == 1


@pytest.mark.parametrize("step", [1e-3, 0.07])
@pytest.mark.parametrize("name", NAMES)
def test_steps_may_be_divided_in_any_way(name, step):
    """The longer steps are divided into several expansions."""
    at_once, singly, divided = (built(name, step=step) for _ in range(3))
    at_once.step(400)
    for _ in range(400):
        singly.step()
    for n in (1, 9, 10, 11, 30, 139, 200):
        divided.step(n)
    assert same(at_once, singly, divided)
    assert at_once.error_estimate == singly.error_estimate == divided.error_estimate < 1e-14


@pytest.mark.parametrize("name", NAMES)
def test_a_run_goes_on_from_a_snapshot_with_the_same_bits(name):
    run, copy = built(name), built(name)
    run.step(123)
    copy.restore(pickle.loads(pickle.dumps(run.snapshot())))
    assert same(run, copy)
    run.step(200)
    copy.step(200)
    assert same(run, copy)


@pytest.mark.parametrize("name", ["double_rod", "four_bar", "moving_support_pendulum", "upright_wheel"])
def test_every_step_is_as_accurate_as_small_steps_of_another_method(name):
    """Also within expansions, where states are not moved back to the constraints."""
    run, other = built(name), Simulation.from_file(name, method="tsitouras8", step=2.5e-4)
    for _ in range(23):
        run.step(17)
        other.step(4 * 17)
        np.testing.assert_allclose(run.state, other.state, rtol=0.0, atol=2e-12)
        assert abs(run.energies.residual) < 2e-13 * (1.0 + abs(run.energies.kinetic))
        assert max(run.violation.position, run.violation.velocity) < 1e-13


def test_a_pendulum_follows_its_closed_form():
    """Released at rest from φ: sin(θ/2) = k sn(K(k) + √(g/l) t), k = sin(φ/2)."""
    text = """
mechanism: pendulum
parts: {bob: {mass: 1, center: [0, 0, -2]}}
joints: {pin: {type: revolute, between: [ground, bob], axis: [0, 1, 0], position: 2.5}}
"""
    run, k = Simulation.from_text(text, method=METHOD), np.sin(1.25)
    for n in (1, 300, 77, 2622):
        run.step(n)
        sn = ellipj(ellipk(k**2) + np.sqrt(9.81 / 2.0) * run.time, k**2)[0]
        assert np.sin(run.q[0] / 2.0) == pytest.approx(k * sn, abs=2e-14)


def test_a_fast_top_keeps_its_energy():
    """At 150 rad/s: to round-off, of which the other method loses a hundred times as much."""
    residuals = []
    for method in (METHOD, "tsitouras8"):
        run = Simulation.from_file("heavy_top", method=method)
        run.step(2000)
        residuals.append(abs(run.energies.residual))
    assert residuals[0] < 2e-12 < 0.05 * residuals[1]


@pytest.mark.parametrize(("order", "tolerance"), [(6, 1e-7), (9, 1e-9)])
def test_the_error_follows_tolerance_and_order(order, tolerance):
    """Of expansions of low order: tolerances of 1 and 1/64, whose root is the ratio of the lengths of expansions."""
    exact, errors, spans = built("moving_support_pendulum"), [], []
    equations = exact.model.equations
    exact.step(500)
    for factor in (1.0, 1.0 / 64.0):
        method = dataclasses.replace(METHODS[METHOD], order=order, tolerance=factor * tolerance, compared=2)
        kernel = compile_kernel(equations.rates, equations.project, {}, method, equations.core)
        y = equations.start_state.copy()
        inputs = np.zeros(1 + history_size(method, y.size, 1))
        assert kernel.advance(y.ctypes.data, inputs.ctypes.data, 0, 1e-3, 500) == 1
        spans.append(inputs[1 + SPAN])
        errors.append(np.max(np.abs(y - exact.state)))
    assert spans[1] < spans[0]
    assert 8.0 < errors[0] / errors[1] < 512.0
    assert errors[0] < 1e3 * tolerance


@pytest.mark.parametrize("change", ["effort", "wrench", "live", "state", "time", "reset"])
def test_any_change_begins_a_new_expansion(change):
    run = built(
        "rod_pendulum", wrenches=["rod"] if change == "wrench" else (), live=["gravity[2]"] if change == "live" else ()
    )
    run.step(3)
    assert run.history[POSITION] == 3 < run.history[SPAN]
    if change == "effort":
        run.set_efforts([0.1])
    elif change == "wrench":
        run.set_wrench("rod", force=[0.1, 0.0, 0.0])
    elif change == "live":
        run.set_live({"gravity[2]": -9.0})
    elif change == "state":
        run.set_state(positions={"pin": 0.1})
    elif change == "time":
        run.restore(run.state, steps=20, inputs=run.inputs, history=run.history)
    else:
        run.reset()
    other = run.copy()
    other.restore(run.state, steps=run.steps, inputs=run.inputs)  # without a history
    run.step(1)
    other.step(1)
    assert run.history[POSITION] == 1
    assert same(run, other)


def test_a_command_that_changes_nothing_keeps_the_expansion():
    run, other = built(), built()
    run.step(3)
    run.set_efforts([0.0, 0.0])
    run.step(50)
    other.step(53)
    assert same(run, other)


def test_a_call_that_fails_leaves_the_history_as_it_was():
    """An effort law that ends: the same bits up to there as a run that was never asked for more."""
    text = """
mechanism: ends
parameters: {t_end: 0.0505}
parts: {rod: {mass: 1, center: [0, 0, -1], inertia: [0.1, 0.1, 0.1]}}
joints: {pin: {type: revolute, between: [ground, rod], axis: [0, 1, 0], position: 1}}
forces: {law: {type: effort, coordinate: pin, effort: "sqrt(t_end - t)"}}
"""
    run, other = (Simulation.from_text(text, method=METHOD) for _ in range(2))
    run.step(20)
    other.step(40)
    with pytest.raises(DivergedError):
        run.step(100)
    run.step(20)
    assert same(run, other)


def test_a_pulse_that_no_derivative_at_the_start_announces_is_not_missed():
    """∫ 2 F / cosh(t / w) dt = π F w: an impulse of 4 π / 2 0.002 N s, half a second after a start at rest."""
    run = Simulation.from_text(PULSE, method=METHOD)
    run.step(1000)
    assert run.u[0] == pytest.approx(4.0 * np.pi / 2.0 * 0.002 / 2.0, rel=1e-13)


def test_ill_conditioned_steps_are_those_of_the_other_method():
    """Two-fold four-bars pass a singular configuration: from there on no expansion is kept, as in the next step."""
    run, other = (Simulation.from_file("a02_four_bars", method=method) for method in (METHOD, "tsitouras8"))
    spans = []
    for _ in range(1000):
        state, steps = run.state, run.steps
        run.step(1)
        spans.append(run.history[SPAN])
        if not spans[-1]:
            other.restore(state, steps=steps)
            other.step(1)
            assert run.state.tobytes() == other.state.tobytes()
    assert 0 < spans.count(0.0) < 500
    assert abs(run.energies.residual) < 1e-9


@pytest.mark.parametrize("name", ["double_rod", "four_bar"])
def test_members_of_an_ensemble_take_the_same_steps(name):
    ensemble, single = Ensemble.from_file(name, 3, method=METHOD), built(name)
    q, u = (np.tile(array, (3, 1)) for array in (single.q, single.u))
    u[1:] *= [[1.5], [4.0]]
    ensemble.reset(q, u)
    ensemble.step(33)
    ensemble.step(67)
    for member in range(3):
        single.reset(q[member], u[member])
        single.step(100)
        assert single.state.tobytes() == ensemble.state[member].tobytes()
        assert single.error_estimate == ensemble.error_estimates[member]


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("bounce", "one-sided elements"),
        ("six_axis_servo_arm", "sample_rate or a delay"),
        ("gas_engine", r"not smooth: the motion of crank depends on \w+\(…\).*Use auto or adams11"),
        ("van_der_pol", r"not smooth: the energy account.* depends on max\(…\)"),
    ],
)
def test_what_has_no_series_is_refused(name, reason):
    with pytest.raises(MechanismError, match=f"{METHOD} cannot treat .*{reason}"):
        built(name)


def test_an_expansion_that_would_need_too_much_of_the_stack_is_refused(monkeypatch, own_builds):
    monkeypatch.setattr(method_choice, "LARGEST_EXPANSION", 1000)
    with pytest.raises(MechanismError, match=r"taylor cannot treat so many parts: .* 0.0 MB of the stack.*adams11"):
        built(step=1.1e-3)


def test_both_ways_to_expand_agree(monkeypatch):
    """With loops over the order and without, which differ by round-off."""
    equations, found = built("moving_support_pendulum").model.equations, []
    for unrolled in (0, 100_000):
        monkeypatch.setattr(taylor_step, "UNROLLED", unrolled)
        kernel = compile_kernel(equations.rates, None, {}, METHODS[METHOD], equations.core)
        y = equations.start_state.copy()
        inputs = np.zeros(1 + history_size(METHODS[METHOD], y.size, 1))
        assert kernel.advance(y.ctypes.data, inputs.ctypes.data, 0, 1e-3, 300) == 1
        found.append((y, inputs))
    (state, history), (other, its_history) = found
    np.testing.assert_allclose(state, other, rtol=0.0, atol=1e-14)
    assert history.tobytes() != its_history.tobytes()
