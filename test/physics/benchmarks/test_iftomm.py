"""Problems A01, A02 and A04 of IFToMM's library of multibody benchmarks (lim.ii.udc.es/mbsbenchmark)."""

from __future__ import annotations

import functools
import runpy
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from mbd_sim import Simulation
from mbd_sim.compiler.lists.lowering import instruction_count
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism, parse_mechanism
from test.generators.mechanisms import accelerations, violation

G = 9.81
SCRIPTS = Path(__file__).parents[3] / "scripts"


@functools.cache
def equations(name):
    return derive(load_mechanism(name))


def run(sim, seconds, every=20):
    """Run, and return the largest residual over the largest energy, and the largest violation of the constraints."""
    derived = derive(sim.mechanism)
    largest = residual = off = 0.0
    while sim.time < seconds - 1e-9:
        sim.step(every)
        largest = max(largest, *(abs(energy) for energy in sim.energies[:5]))
        residual = max(residual, abs(sim.energies.residual))
        off = max(off, violation(sim, derived))
    return residual / largest, off


class TestA01:
    """A simple pendulum in Cartesian coordinates, released with a horizontal rod."""

    def test_period(self):
        """After half a period, 2 K(sin 45°) sqrt(l/g), it is at rest on the other side, and after a period at the start."""
        half = 2.0 * ellipk(0.5) * np.sqrt(1.0 / G)
        sim = Simulation.from_file("a01_simple_pendulum", step=half / 1000)
        for number, side in enumerate([1.0, -1.0] * 4, start=1):
            sim.step(1000)
            assert sim.time == pytest.approx(number * half, rel=1e-14)
            assert sim.q == pytest.approx([side, 0.0], abs=1e-11)
            assert sim.u == pytest.approx([0.0, 0.0], abs=1e-10)


def rods(count, seconds):
    """θ and θ' from the horizontal: ((N + 1)/3 + N) θ'' + ((N + 1)/2 + N) g cos θ = 0, 1 rad/s toward +x upright."""
    factor = ((count + 1) / 2 + count) * G / ((count + 1) / 3 + count)
    fall = solve_ivp(
        lambda t, y: [y[1], -factor * np.cos(y[0])],
        (0.0, seconds),
        [np.pi / 2, -1.0],
        method="DOP853",
        rtol=1e-13,
        atol=1e-13,
        max_step=0.01,
    )
    return fall.y[:, -1]


def four_bars(count):
    """The text of N four-bars."""
    return runpy.run_path(str(SCRIPTS / "four_bars"))["four_bars"](count)


class TestA02:
    """N four-bars in a row, which lie flat twice per turn, where the constraints lose rank."""

    def test_two(self):
        sim = Simulation.from_file("a02_four_bars")
        assert sim.u == pytest.approx([1.0, 1.0, 1.0, -1.0, -1.0], abs=1e-14)
        sim.run(until=10.0)
        theta, rate = rods(2, 10.0)
        assert sim.q == pytest.approx((np.pi / 2 - theta) * np.array([1, 1, 1, -1, -1]), abs=1e-7)
        assert sim.u == pytest.approx(-rate * np.array([1, 1, 1, -1, -1]), abs=1e-7)

    def test_generated_file_is_the_shipped_one(self):
        shipped, generated = equations("a02_four_bars"), derive(parse_mechanism(four_bars(2)))
        y, nothing = generated.start_state, np.zeros(generated.layout.nv)
        assert y == pytest.approx(shipped.start_state, abs=1e-14)
        rates = [np.array(each.rates.call([0.0, y, nothing])[0]).ravel() for each in (shipped, generated)]
        assert rates[1] == pytest.approx(rates[0], abs=1e-12)

    def test_it_stays_a_row_of_parallelograms(self):
        """It lies flat thirty times and neither gains nor loses energy."""
        sim = Simulation.from_file("a02_four_bars")
        residual, off = run(sim, 20.0)
        assert sim.q[0] > 2.0 * np.pi * 8
        assert np.ptp(sim.q * [1, 1, 1, -1, -1]) < 1e-11
        assert residual < 1e-9
        assert off < 1e-11

    def test_other_masses_on_its_way_through(self):
        """With one heavy and one light rod the loops are loaded where they lie flat, and stay closed."""
        text = (
            four_bars(2)
            .replace("rod2: {mass: 1 kg", "rod2: {mass: 7 kg")
            .replace("bar1: {mass: 1 kg", "bar1: {mass: 0.1 kg")
        )
        sim = Simulation.from_text(text)
        residual, off = run(sim, 10.0)
        assert np.ptp(sim.q * [1, 1, 1, -1, -1]) < 1e-10
        assert residual < 1e-8
        assert off < 1e-10

    def test_five(self):
        """11 rods and bars, whose rates cost in proportion to their number. (scripts/systems_table has N = 40.)"""
        found = derive(parse_mechanism(four_bars(5)))
        few, many = (instruction_count(arranged(each.rates)) for each in (equations("a02_four_bars"), found))
        assert many < 3 * few
        turned = np.repeat([1.0, -1.0], [6, 5])  # from upright; see `rods`
        second = (6 / 2 + 5) * G * np.sin(0.5) / (6 / 3 + 5)
        assert accelerations(found, 0.5 * turned, 0.7 * turned) == pytest.approx(second * turned, rel=1e-9)


class TestA04:
    """Bricard's mechanism: rigid by Grübler's count, but with one degree of freedom."""

    def test_count(self):
        derived = equations("a04_bricard")
        assert 6 * 5 - 5 * 6 == 0
        assert (derived.layout.nv, len(derived.rows), derived.start.rank) == (5, 5, 4)

    def test_joints_in_space(self):
        """All hinge points stay one meter apart and every hinge stays perpendicular to both of its bars."""
        sim = Simulation.from_file("a04_bricard")
        lowest = 0.0
        for _ in range(30):
            sim.step(100)
            poses = sim.poses()
            bars = ["first", "second", "third", "fourth", "fifth"]
            points = np.array([poses[bar].position for bar in bars] + [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
            assert np.linalg.norm(np.diff(points, axis=0), axis=1) == pytest.approx(np.ones(6), abs=1e-13)
            last = poses["fifth"]
            assert last.position + last.rotation[:, 1] == pytest.approx([0.0, 0.0, 1.0], abs=1e-13)
            assert last.rotation[:, 0] == pytest.approx([1.0, 0.0, 0.0], abs=1e-13)  # the hinge on ground
            lowest = min(lowest, points[:, 1].min())
        assert lowest < -1.2  # it moves far

    def test_closure_condition(self):
        """Alternate hinges have equal angles, a and b from the cube, with sin a sin b + sin a + sin b = 0.

        That is cos α cos β + cos α + cos β = 0 of the threefold symmetric linkage, with α and β from a straight chain.
        """
        sim = Simulation.from_file("a04_bricard")
        reached = []
        for _ in range(100):
            sim.step(50)
            a, b, c, e, f = sim.q
            assert [c, e, f] == pytest.approx([a, a, b], abs=1e-12)
            assert np.sin(a) * np.sin(b) + np.sin(a) + np.sin(b) == pytest.approx(0.0, abs=1e-13)
            reached.append(a)
        assert np.ptp(reached) > 1.5
