"""Which of several events within one step is the first one."""

from types import SimpleNamespace

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.simulation.contact.compiled import search, trial

MEETS, PARTS, STRIKES = 0.0003, 0.0016, 0.001  # s, within a step of 2 ms
RISE = 1e-3  # m/s
TWO = f"""
mechanism: two
integrator: {{step: 2 ms, method: tsitouras8}}
gravity: [0, 0, 0]
parts:
  base: {{shape: {{type: block, size: [3, 1, 1], at: [0, 0, -0.5], mass: 1}}}}
  back: {{shape: {{type: sphere, radius: 0.1, mass: 1}}}}
  fast: {{shape: {{type: sphere, radius: 0.1, mass: 1}}}}
joints:
  base: {{type: fixed, between: [ground, base]}}
  back: {{type: prismatic, between: [ground, back], axis: [0, 0, 1], position: 0.1, velocity: {RISE}}}
  fast: {{type: prismatic, between: [ground.aside, fast], axis: [0, 0, 1], position: {0.1 + STRIKES}, velocity: -1}}
ground: {{points: {{aside: [1, 0, 0]}}}}
forces: {{curve: {{type: effort, coordinate: back, effort: "{RISE / (MEETS * PARTS)}*(6*t - {2 * (MEETS + PARTS)})"}}}}
contacts:
  one: {{between: [ONE, base], restitution: 0.5}}
  other: {{between: [OTHER, base], restitution: 0.5}}
"""


@pytest.mark.parametrize("order", [("back", "fast"), ("fast", "back")])
def test_bodies_that_meet_before_others_and_part_within_the_step_meet_first(order):
    """A body leaves another, comes back to it, and would leave it again: c t (t - 0.3 ms) (t - 1.6 ms).

    Where both ends of the step are free, only the impact of another body in between shows that they have met.
    """
    simulation = Simulation.from_text(TWO.replace("ONE", order[0]).replace("OTHER", order[1]))
    simulation.step(1)
    first = simulation.contact_events[0]
    assert first.time == pytest.approx(MEETS, abs=1e-11)
    assert any(event.time == pytest.approx(STRIKES, abs=1e-11) for event in simulation.contact_events)


@pytest.mark.parametrize("round_off", [1e-19, 2e-16, 1e-15])
def test_the_place_of_a_zero_is_not_sought_within_round_off(monkeypatch, round_off):
    """Falls and rebounds; each value costs a part of a step. Down to adjacent numbers it took 40 attempts more."""
    worst = 0
    for speed in (1e-4, 1e-2, 1.0):
        tried = []

        def gap(c, m, length, what, index, speed=speed, tried=tried):
            tried.append(length)
            exact = 1e-6 * speed - speed * length - 5.0 * length**2
            return round_off * (round(exact / round_off) + 0.5)

        monkeypatch.setattr(search, "value_of", gap)
        motion = SimpleNamespace(sliding=SimpleNamespace(is_collocated=[0]))
        contacts = SimpleNamespace(accuracy=1e-13, slow=0.0, pairs=0, gaps_and_rates=0)
        ends = gap(contacts, motion, 0.0, 0, 0), gap(contacts, motion, 2e-3, 0, 0)
        found = search.first_zero(contacts, motion, search.BESIDE, 0, 2e-3, *ends, 0.0)
        assert -2e-15 <= gap(contacts, motion, found, 0, 0) <= 0.0
        worst = max(worst, len(tried))
    assert worst <= 30


def test_a_zero_is_not_missed_where_the_last_place_is_almost_on_it(monkeypatch):
    """The next place rounded to this one, which ended the search: bodies were 3e-6 m in each other as they met."""
    chance = np.random.default_rng(5)
    for _ in range(300):
        zero, speed, bend = chance.uniform(0.1e-3, 0.9e-3), chance.uniform(0.1, 3.0), chance.uniform(-40.0, 40.0)

        def gap(c, m, length, what, index, zero=zero, speed=speed, bend=bend):
            return (zero - length) * (speed + bend * length) + 1e-20

        monkeypatch.setattr(search, "value_of", gap)
        motion = SimpleNamespace(sliding=SimpleNamespace(is_collocated=[0]))
        contacts = SimpleNamespace(accuracy=1e-13, slow=0.0, pairs=0, gaps_and_rates=0)
        ends = gap(contacts, motion, 0.0, 0, 0), gap(contacts, motion, 1e-3, 0, 0)
        found = search.first_zero(contacts, motion, search.BESIDE, 0, 1e-3, *ends, 0.0)
        assert -1e-15 <= gap(contacts, motion, found, 0, 0) <= 0.0


@pytest.mark.parametrize("miss", [0.0, 1e-9, 1e-7])
def test_few_motions_are_needed_where_bodies_meet_beside_others(monkeypatch, miss):
    """Zero up to a kink, and then steep: without a foreseen place, or with one beyond what counts as zero, 14 to 30."""
    chance = np.random.default_rng(7)
    for _ in range(100):
        zero, speed = 10.0 ** chance.uniform(-9, -3.3), 10.0 ** chance.uniform(-3, 0)
        tried = []

        def gap(length, zero=zero, speed=speed):
            return min(1e-13, (zero - length) * speed + 1e-13)

        def exact(c, m, length, what, index, gap=gap, tried=tried):
            tried.append(length)
            return gap(length)

        def nearly(c, m, length, what, index, gap=gap, speed=speed):
            return gap(length) + miss * speed * length

        monkeypatch.setattr(search, "value_of", exact)
        monkeypatch.setattr(trial, "near_value", nearly)
        motion = SimpleNamespace(sliding=SimpleNamespace(is_collocated=[0]))
        contacts = SimpleNamespace(accuracy=1e-13, slow=0.0, pairs=0, gaps_and_rates=1)
        found = search.first_zero(contacts, motion, search.BESIDE, 0, 1e-3, gap(0.0), gap(1e-3), 0.0)
        assert -1e-16 <= gap(found) <= 0.0 or np.nextafter(found, 0.0) < zero + 1e-13 / speed <= found
        assert len(tried) <= 6
