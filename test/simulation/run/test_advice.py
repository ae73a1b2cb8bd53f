"""Steps that are too large: the error estimate, the advice, and no advice for a good step."""

from __future__ import annotations

import re

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import DivergedError
from mbd_sim.cli.runs.run import simulate
from mbd_sim.integrators.methods import METHODS
from mbd_sim.simulation.run.advice import TARGET, TOLERATED, fastest_rate, round_down

STIFF = """
mechanism: grain_on_a_rod
parts:
  rod: {mass: 1, shape: {type: rod, to: [0, 0, -1]}}
  grain: {mass: 1 g}
joints:
  pin: {type: revolute, between: [ground, rod], axis: [0, -1, 0], position: 60 deg}
  slide:
    {type: prismatic, between: [rod, grain], axis: [0, 0, -1], position: 1, rest: 1, stiffness: 1e7, damping: 1e4}
"""
RIGID = STIFF[: STIFF.index("  slide")] + "  slide: {type: fixed, between: [rod.tip, grain]}\n"
RIGID = RIGID.replace("to: [0, 0, -1]}}", "to: [0, 0, -1]}, points: {tip: [0, 0, -1]}}")


@pytest.mark.parametrize("name", ["gas_engine", "stick_slip", "spring_chain", "four_bar", "spherical_top"])
def test_no_shipped_mechanism_is_warned_of(name):
    simulation = Simulation.from_file(name)
    simulation.step(3000)
    assert simulation.step_advice is None
    assert simulation.error_estimate < 0.1 * TOLERATED


@pytest.mark.parametrize("method", ["euler", "rk4", "dop853", "rosenbrock", "gauss4", "taylor"])
def test_estimates_have_the_size_of_the_error(method):
    """Of one step of a double rod, within a factor of 50, and 300 for the methods of high order."""
    step = 0.01 if METHODS[method].order < 7 else 0.04
    simulation = Simulation.from_file("double_rod", method=method, step=step)
    exact = Simulation.from_file("double_rod", step=step / 20)
    start = [1.2, -0.4], [-3.0, 2.0]
    simulation.reset(*start)
    exact.reset(*start)
    simulation.step(1)
    exact.step(20)
    size = simulation.model.u_range.stop
    scale = 1.0 + np.abs(np.concatenate(start))
    error = np.linalg.norm((simulation.state - exact.state)[:size] / scale)
    factor = 50.0 if METHODS[method].order < 7 else 300.0
    assert error / factor < simulation.error_estimate < factor * error


def test_estimates_are_kept_until_reset_and_do_not_depend_on_calls():
    at_once, singly = (Simulation.from_file("double_rod", method="rk4") for _ in range(2))
    at_once.step(500)
    for _ in range(500):
        singly.step(1)
    assert at_once.error_estimate == singly.error_estimate > 0.0
    assert at_once.state.tobytes() == singly.state.tobytes()
    at_once.reset()
    assert at_once.error_estimate == 0.0


def test_a_stiff_mechanism_runs_with_the_rosenbrock_method():
    """A grain on a spring of 10⁷ N/m with a damper of 10⁴ N·s/m moves like one that is welded on."""
    simulation, rigid = Simulation.from_text(STIFF, method="rosenbrock"), Simulation.from_text(RIGID)
    simulation.run(until=10.0)
    rigid.run(until=10.0)
    assert simulation.q[0] == pytest.approx(rigid.q[0], abs=1e-7)
    assert simulation.u[0] == pytest.approx(rigid.u[0], abs=1e-6)
    assert abs(simulation.energies.residual) < 1e-9
    assert simulation.step_advice is None


@pytest.mark.parametrize("method", ["euler", "tsitouras8", "adams11", "gauss4"])
def test_explicit_methods_warn_of_a_stiff_mechanism(method):
    simulation = Simulation.from_text(STIFF, method=method)
    simulation.step(1)
    assert np.all(np.isfinite(simulation.state))
    assert re.search(
        r"too large for grain_on_a_rod, which has rates of 1e\+07/s.* Try method rosenbrock", simulation.step_advice
    )
    before = simulation.state
    with pytest.raises(DivergedError, match="Try method rosenbrock"):
        simulation.step(10_000)
    assert simulation.state.tobytes() == before.tobytes()


def test_with_contacts_no_method_is_advised_that_cannot_treat_them():
    """The stiff coordinate is named, and what helps there: that of a light hand with the damper of a heavy arm."""
    text = """mechanism: hand
parts: {arm: {mass: 1, shape: {type: sphere, radius: 0.1}}, hand: {mass: 1e-4, inertia: [1e-6, 1e-6, 1e-6]}}
joints:
  lift: {type: prismatic, between: [ground, arm], axis: [0, 0, 1], position: 1}
  wrist: {type: revolute, between: [arm, hand], axis: [0, 1, 0], damping: 1, velocity: 1}
contacts: {floor: {parts: [arm], plane: ground}}
"""
    simulation = Simulation.from_text(text)
    with pytest.raises(DivergedError, match=r"rates of 1e\+06/s at wrist.*less damping.* at wrist") as caught:
        simulation.run(until=1.0)
    assert "rosenbrock" not in str(caught.value)


@pytest.mark.parametrize("method", ["rk4", "rosenbrock", "tsitouras8"])
def test_the_step_that_is_advised_is_small_enough(method):
    simulation = Simulation.from_file("double_rod", method=method, step=0.1 if method == "tsitouras8" else 0.05)
    simulation.run(until=5.0)
    advised = float(re.search(r"Try step (\S+?)(?: or|\.$)", simulation.step_advice)[1])
    better = Simulation.from_file("double_rod", method=method, step=advised)
    better.run(until=5.0)
    assert better.step_advice is None
    assert TARGET / 1e4 < better.error_estimate < TOLERATED


def test_a_method_of_higher_order_is_advised_beside_a_smaller_step():
    simulation = Simulation.from_file("double_rod", method="rk4", step=0.02)
    simulation.run(until=5.0)
    assert simulation.step_advice.endswith("or method tsitouras8.")


HANGING = """
mechanism: hanging
parts: {weight: {mass: 1}}
joints: {rail: {type: prismatic, between: [ground, weight], axis: [0, 0, 1], position: POSITION}}
forces: {s: {type: spring, between: [ground.hook, weight], stiffness: 100, length: 0.3}}
ground: {points: {hook: [0, 0, 0.3]}}
"""


@pytest.mark.parametrize("position", ["-0.0981", "-0.1", "-0.2"])
def test_round_off_of_the_energy_account_is_no_advice(position):
    """At rest, and at the turning points of the motion, nothing but the round-off of the account is left."""
    simulation = Simulation.from_text(HANGING.replace("POSITION", position))
    period = 2.0 * np.pi / np.sqrt(100.0)
    for turn in range(1, 9):
        simulation.run(until=0.5 * turn * period)
        assert simulation.step_advice is None


def test_a_summary_prints_zero_for_round_off_by_the_size_of_the_mechanism():
    """A weight at rest keeps its speed of some 1e-16 m/s; one that moves by nanometres does move."""
    lines = simulate(Simulation.from_text(HANGING.replace("POSITION", "-0.0981")), 2.0, quiet=True).splitlines()
    assert lines[-1].split() == ["rail", "-0.0981", "0"]
    small = HANGING.replace("POSITION", "-2e-13").replace("100,", "1e13,").replace("0.3", "3e-10")
    position, speed = map(float, simulate(Simulation.from_text(small), 1e-3, quiet=True).splitlines()[-1].split()[1:])
    assert 0.0 < abs(position + 9.81e-13) < 9e-13 and 0.0 < abs(speed) < 1e-5


def test_a_run_says_so():
    assert "WARNING" not in simulate(Simulation.from_file("double_rod"), 1.0, quiet=True)
    summary = simulate(Simulation.from_file("double_rod", method="euler"), 1.0, quiet=True)
    assert re.search(r"WARNING +a step of 0.001 s is too large for double_rod: .* Try step", summary)


def test_the_fastest_rate_is_an_eigenvalue():
    model = Simulation.from_text(STIFF).model
    assert fastest_rate(model, 0.0, model.start, np.zeros(2)) == pytest.approx(1e7, rel=1e-2)


@pytest.mark.parametrize(("value", "rounded"), [(1.0, 1.0), (0.0049, 0.002), (0.05, 0.05), (9e-7, 5e-7), (3.0, 2.0)])
def test_steps_are_rounded_down(value, rounded):
    assert round_down(value) == pytest.approx(rounded)


@pytest.mark.parametrize(("keys", "helps"), [("", False), (", damping: 0.1", True)])
def test_an_implicit_method_is_proposed_only_where_something_may_be_stiff(keys, helps):
    text = f"""
mechanism: whirl
parts: {{a: {{mass: 1, shape: {{type: rod, to: [0, 0, -1]}}, points: {{tip: [0, 0, -1]}}}}, b: {{mass: 1, inertia: [1, 2, 3], center: [1, 0, 0]}}}}
joints:
  first: {{type: revolute, between: [ground, a], axis: [1, 0, 0]{keys}}}
  second: {{type: revolute, between: [a.tip, b], axis: [0, 1, 0]}}
"""
    simulation = Simulation.from_text(text, method="rk4")
    simulation.set_efforts([1e9, 0.0])
    with pytest.raises(DivergedError, match=r"the error of a step is unbounded. Try step 0.0001") as caught:
        simulation.run(until=10.0)
    assert ("method rosenbrock" in str(caught.value)) is helps
