"""Potentials beyond the ends of their tables, against antiderivatives, and the energies of springs that reach there."""

import casadi as ca
import numpy as np
import pytest

from mbd_sim import Ensemble, Simulation
from mbd_sim.dynamics.math import distant_potentials
from mbd_sim.dynamics.math.distant_potentials import DistantPotential
from mbd_sim.dynamics.math.laws import distant_potential
from mbd_sim.dynamics.math.piecewise import table_of
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.mechanism.values.laws import Expressed
from mbd_sim.recordings.run.reader import TopicRole
from mbd_sim.recordings.run.verification import verify

ROOT = np.sqrt(2.0)


def kinked(x):
    """∫ |sin √2 s| ds from 0 to x."""
    half_waves = np.floor(ROOT * np.abs(x) / np.pi)
    return np.sign(x) * (2.0 * half_waves + 1.0 - np.cos(ROOT * np.abs(x) - np.pi * half_waves)) / ROOT


LAWS = {
    "x sin x": ("x*sin(x)", lambda x: np.sin(x) - x * np.cos(x)),
    "irrational": ("20*sin(sqrt(2)*x)", lambda x: 20.0 * (1.0 - np.cos(ROOT * x)) / ROOT),
    "kinks": ("abs(sin(sqrt(2)*x))", kinked),
}


def law(text, lower=-20.0, upper=20.0):
    return Expressed(TimeExpression(text, {}), lower, upper)


@pytest.mark.parametrize("name", LAWS)
def test_the_rest_of_the_integral_is_exact(name):
    text, exact = LAWS[name]
    rest = distant_potential(law(text))
    lower, upper = rest._lower, rest._upper
    assert rest(0.3) == rest(lower) == rest(upper) == 0.0
    for x in (1.0001 * upper, 1.37 * lower, 777.7, -900.5):
        expected = exact(x) - exact(upper if x > 0 else lower)
        largest = abs(x) if name == "x sin x" else 20.0
        assert rest(x) == pytest.approx(expected, rel=0.0, abs=2e-14 * largest * abs(x))  # of the integral of |f|


def test_the_integral_does_not_depend_on_what_was_read_before():
    fresh = {x: distant_potential(law("x*sin(x)"))(x) for x in (250.0, -999.9, 31234.5)}
    rest = distant_potential(law("x*sin(x)"))
    for x in (31234.5, 250.0, -999.9, 4e4, 250.0, 31234.5):
        assert rest(x) == fresh.get(x, rest(x))


def test_laws_with_a_sufficient_table_need_nothing_else():
    assert distant_potential(law("x + 2*x**3")) is None
    assert distant_potential(law("80*sin(x) + 30*sin(2*x)")) is None
    assert engine(1, "x + 2*x**3").model.equations.distant_springs is None


def test_beyond_all_cells_and_where_the_force_is_undefined_the_energy_is_nan(monkeypatch):
    monkeypatch.setattr(distant_potentials, "MAX_CELLS", 3000)

    def f(x):
        return ca.sin(ROOT * x)

    rest = DistantPotential(f, table_of(f, -20.0, 20.0))
    assert np.isfinite(rest(1000.0)) and np.isnan(rest(1e9)) and np.isnan(rest(float("inf")))
    assert np.isnan(distant_potential(law("sqrt(25 - x)*sin(1.3*x)"))(26.0))


def test_waves_that_are_too_fast_for_the_cells_give_nan_rather_than_a_wrong_energy(monkeypatch):
    monkeypatch.setattr(distant_potentials, "MAX_CELLS", 30_000)
    assert np.isnan(distant_potential(law("sin(1e5*sqrt(2)*x)", -1.0, 1.0))(1.5))
    fast = distant_potential(law("sin(200*sqrt(2)*x)", -2.0, 2.0))
    assert fast(3.3) == pytest.approx((np.cos(400 * ROOT) - np.cos(200 * ROOT * 3.3)) / (200 * ROOT), abs=1e-13)


ENGINE = """
mechanism: engine
gravity: [0, 0, 0]
parts: {wheel: {mass: 1, inertia: [0.5, 0.5, 0.5]}}
joints:
  shaft: {type: revolute, between: [ground, wheel], axis: [0, 0, 1], velocity: SPEED, rest: 0.2, spring: {force: "FORCE"}}
"""


def engine(speed, force="20*sin(sqrt(2)*x) + 0.1*x*sin(x)", **options):
    return Simulation.from_text(ENGINE.replace("SPEED", str(speed)).replace("FORCE", force), **options)


@pytest.mark.parametrize("speed", [100, -100])
def test_a_joint_keeps_its_account_over_many_turns(speed):
    sim = engine(speed)
    for until in (0.1, 5.5):
        sim.run(until=until)
        assert abs(sim.energies.residual) < 1e-9
    assert abs(sim.q[0]) > 500.0


def test_live_rest_positions_and_members_have_the_same_energies():
    live = engine(100, live=["joints.shaft.rest"])
    plain, members = engine(100), Ensemble(live.mechanism, [{}, {"joints.shaft.rest": 1.5}])
    for sim in (live, plain, members):
        sim.run(until=3.0)
    assert live.energies == plain.energies
    assert members.energies.potential[0] == plain.energies.potential
    assert np.all(np.abs(members.energies.residual) < 1e-9)


def test_a_spring_between_points_keeps_its_account_beyond_its_table():
    text = """
mechanism: thrown
gravity: [0, 0, 0]
parts: {stone: {mass: 1, shape: {type: sphere, radius: 1 cm}}}
joints: {way: {type: prismatic, between: [ground, stone], axis: [1, 0, 0], position: 1, velocity: 50}}
forces: {band: {type: spring, between: [ground, stone], length: 0.5, force: 30*sin(1.3*x) + exp(-x)}}
"""
    sim = Simulation.from_text(text)
    sim.run(until=4.0)
    assert sim.q[0] > 100.0 and abs(sim.energies.residual) < 1e-10


def test_a_recording_beyond_the_table_verifies(tmp_path):
    sim = engine(100)
    with sim.recording(tmp_path / "run.mcap"):
        sim.run(until=2.5)
    assert sim.q[0] > 220.0  # the table ends at 200
    (found,) = verify(tmp_path / "run.mcap")
    assert found.agrees and found.compared[TopicRole.ENERGIES]
