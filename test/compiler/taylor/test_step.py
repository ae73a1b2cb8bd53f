"""Steps of the Taylor method: accuracy, and where expansions end; see also `test_method_history`."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from mbd_sim import MechanismError, Simulation, parse_mechanism
from mbd_sim.compiler.code import machine_code
from mbd_sim.compiler.kernel import compile_kernel
from mbd_sim.compiler.taylor import step
from mbd_sim.compiler.taylor.step import SPAN
from mbd_sim.integrators.methods import METHODS

METHOD = "taylor"
ACCURATE = ("four_bar", "moving_support_pendulum", "cart_massive_spring")  # the last one with lengths along a line
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


@pytest.mark.parametrize("name", ACCURATE)
def test_every_step_is_as_accurate_as_small_steps_of_another_method(name):
    """Also within expansions, where states are not moved back to the constraints."""
    run, other = built(name), Simulation.from_file(name, method="tsitouras8", step=2.5e-4)
    for _ in range(12):
        run.step(17)
        other.step(4 * 17)
        np.testing.assert_allclose(run.state, other.state, rtol=0.0, atol=2e-12)
        assert abs(run.energies.residual) < 2e-13 * (1.0 + abs(run.energies.kinetic))
        assert max(run.violation.position, run.violation.velocity) < 1e-13


def test_an_expansion_ends_where_a_length_along_a_line_vanishes():
    """A block on a spring that it passes: the force jumps in steps that the other method takes."""
    text = """
mechanism: passing
gravity: [0, 0, 0]
parts: {block: {mass: 1}}
joints: {slide: {type: prismatic, between: [ground, block], axis: [1, 0, 0], position: 1, velocity: -4}}
forces: {spring: {type: spring, between: [ground, block], stiffness: 20, length: 0.3}}
"""
    mechanism = parse_mechanism(text)
    run, other, divided = (Simulation(mechanism, method=method) for method in (METHOD, "tsitouras8", METHOD))
    signs = []
    for _ in range(40):
        run.step(50)
        other.step(50)
        for n in (7, 43):
            divided.step(n)
        signs.append(np.sign(run.q[0]))
        np.testing.assert_allclose(run.state, other.state, rtol=0.0, atol=1e-11)
    assert np.count_nonzero(np.diff(signs)) > 2
    assert same(run, divided)


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


@pytest.mark.parametrize(("order", "tolerance"), [(6, 1e-7)])
def test_the_error_follows_tolerance_and_order(order, tolerance):
    """Of expansions of low order: tolerances of 1 and 1/64, whose root is the ratio of the lengths of expansions."""
    exact, errors, spans = built("moving_support_pendulum"), [], []
    equations = exact.model.equations
    exact.step(500)
    for factor in (1.0, 1.0 / 64.0):
        method = dataclasses.replace(METHODS[METHOD], order=order, tolerance=factor * tolerance, compared=2)
        kernel = compile_kernel(equations.rates, equations.project, {}, method, equations.core)
        y = equations.start_state.copy()
        inputs = np.zeros(1 + method.history_size(y.size, 1))
        assert kernel.advance(y.ctypes.data, inputs.ctypes.data, 0, 1e-3, 500) == 1
        spans.append(inputs[1 + SPAN])
        errors.append(np.max(np.abs(y - exact.state)))
    assert spans[1] < spans[0]
    assert 8.0 < errors[0] / errors[1] < 512.0
    assert errors[0] < 1e3 * tolerance


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
    monkeypatch.setattr(step, "LARGEST_EXPANSION", 1000)
    with pytest.raises(MechanismError, match=r"taylor cannot treat so many parts: .* 0.0 MB of the stack.*adams11"):
        built(step=1.1e-3)


def test_both_ways_to_expand_agree(monkeypatch):
    """With loops over the order and without, which differ by round-off; optimized or not, to the bit."""
    equations, found = built("moving_support_pendulum").model.equations, []
    for unrolled, level in ((0, 0), (100_000, 0), (0, 1)):
        monkeypatch.setattr(step, "UNROLLED", unrolled)
        monkeypatch.setattr(machine_code, "LEVEL", level)
        kernel = compile_kernel(equations.rates, None, {}, METHODS[METHOD], equations.core)
        y = equations.start_state.copy()
        inputs = np.zeros(1 + METHODS[METHOD].history_size(y.size, 1))
        assert kernel.advance(y.ctypes.data, inputs.ctypes.data, 0, 1e-3, 300) == 1
        found.append((y, inputs))
    (state, history), (other, its_history), optimized = found
    assert all(np.array_equal(one, two) for one, two in zip(found[0], optimized, strict=True))
    np.testing.assert_allclose(state, other, rtol=0.0, atol=1e-14)
    assert history.tobytes() != its_history.tobytes()


@pytest.mark.parametrize(
    ("place", "regularization", "exponent"),
    [
        ("joint", "", "2"),
        ("force", ", regularization: 1e-6", "2.5"),
    ],
)
def test_the_kink_of_a_damper_is_not_passed_with_one_expansion(place, regularization, exponent):
    """C |v|ᵖ is analytic up to v = 0, and its expansion goes on smoothly: the damper drove the mass after a turn."""
    law = f"coefficient: 0.5, exponent: {exponent}{regularization}"
    in_joint = f", damper: {{{law}}}" if place == "joint" else ""
    text = f"""
mechanism: swing
gravity: [0, 0, 0]
parts: {{a: {{mass: 1}}}}
joints: {{x: {{type: prismatic, between: [ground, a], axis: [1, 2, 2], position: 1.2, stiffness: 25{in_joint}}}}}
"""
    if place == "force":
        text += f"forces: {{d: {{type: damper, between: [ground, a], along: velocity, {law}}}}}\n"
    found, fine = (
        Simulation.from_text(text, method="taylor"),
        Simulation.from_text(text, step=1e-4, method="tsitouras8"),
    )
    for simulation in (found, fine):
        simulation.run(until=2.0)
    assert found.q == pytest.approx(fine.q, abs=1e-10)
    assert abs(found.energies.residual) < 1e-12
