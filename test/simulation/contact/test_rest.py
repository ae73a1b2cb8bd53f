"""Impacts that bring contacts to rest: slow ones, which would rebound without end."""

from types import SimpleNamespace

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.simulation.contact.candidates import RESTING
from mbd_sim.simulation.contact.impact import _resting, _slow_at_rest
from mbd_sim.simulation.contact.records import ContactChange

LENGTH, TILT, SPEED, APPROACH = 0.8, 1e-4, 4e-2, 1e-6  # m, rad, m/s, m/s
HALF = LENGTH / 2 * np.cos(TILT)
BAR = f"""
mechanism: bar
gravity: [0, 0, 0]
ground: {{points: {{top: [0, 0, {2 * HALF}]}}}}
parts: {{bar: {{shape: {{type: rod, mass: 1, from: [0, 0, {-LENGTH / 2}], to: [0, 0, {LENGTH / 2}]}}}}}}
joints:
  bar: {{type: planar, between: [ground, bar], axis: [0, 1, 0], x_axis: [1, 0, 0], position: [0, {-HALF}, {TILT}]}}
contacts:
  floor: {{parts: [bar], plane: ground, friction: MU, restitution: 0.5}}
  ceiling: {{parts: [bar], plane: ground.top, normal: [0, 0, -1], friction: MU, restitution: 0.5}}
"""

FALL = 0.1  # m, and the speed at its start is 1 m/s
# A bar on two supports; a weight on a rope jerks at its end, beyond one of them, and so raises the other end.
JERK = f"""
mechanism: jerk
parameters: {{m: 1}}
ground: {{points: {{eye: [1.5, 0, 0]}}}}
parts:
  carriage: {{mass: 0}}
  bar:
    shape: {{type: rod, mass: 1, from: [-1, 0, 0], to: [1.5, 0, 0]}}
    points: {{left: [-1, 0, 0], right: [1, 0, 0], end: [1.5, 0, 0]}}
  weight: {{shape: {{type: particle, mass: m}}}}
joints:
  z: {{type: prismatic, between: [ground, carriage], axis: [0, 0, 1]}}
  tilt: {{type: revolute, between: [carriage, bar], axis: [0, -1, 0]}}
  fall: {{type: prismatic, between: [ground.eye, weight], axis: [0, 0, 1], position: {FALL - 1}, velocity: -1}}
constraints:
  left: {{type: on_plane, point: bar.left, bound: at_least}}
  right: {{type: on_plane, point: bar.right, bound: at_least}}
  rope: {{type: distance, between: [bar.end, weight], length: 1, bound: at_most}}
"""


@pytest.mark.parametrize("mass", [1e-7, 1e-3])
def test_what_an_impact_raises_by_less_than_round_off_stays_closed(mass):
    """It took a trial of the step to find that it returns. What is raised by more returns when gravity lets it."""
    simulation = Simulation.from_text(JERK, step=1e-3, set={"parameters.m": mass})
    simulation.run(until=0.12)
    speed = np.sqrt(1.0 + 2.0 * 9.81 * FALL)
    jerk = (speed - 1.0) / 9.81
    events = [event for event in simulation.contact_events if event.name == "left"]
    assert events[0].time == pytest.approx(jerk, abs=1e-13)
    if mass < 1e-6:
        assert {event.change for event in events} == {ContactChange.IMPACT}
        assert len({event.time for event in simulation.contact_events}) == 1
    else:
        assert [event.change for event in events[:2]] == [ContactChange.OPENED, ContactChange.IMPACT]
        assert events[1].time - jerk == pytest.approx(mass * speed / (9.81 * (0.75 - 0.5 * mass)), rel=1e-5)
    assert simulation.contacts()["left"].gap == pytest.approx(0.0, abs=1e-15)
    assert simulation.energies.dissipated == pytest.approx(0.5 * mass * speed**2, rel=1e-9)
    assert abs(simulation.energies.residual) < 1e-16


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_slow_contacts_do_not_stop_fast_motions(friction):
    """A bar turns away from the upright between a floor and a ceiling about its upper end, which touches the ceiling.

    Both gaps change so slowly that they would not rebound; only a pull at both ends could bring them to rest together.
    """
    simulation = Simulation.from_text(BAR.replace("MU", str(friction)))
    turn = SPEED / LENGTH
    rise = LENGTH / 2 * np.sin(TILT) * turn
    simulation.reset(u=[-HALF * turn, -rise - APPROACH, turn])
    lost = 0.5 * APPROACH**2 / (1 + 12 * np.sin(TILT) ** 2 / 4)  # without friction, which changes it little
    assert simulation.energies.dissipated == pytest.approx(lost, rel=2e-2 if friction else 1e-6)
    assert simulation.u[2] == pytest.approx(turn, rel=1e-3)


def test_rows_that_nearly_depend_on_each_other_come_to_rest_or_are_left_to_the_law_of_impacts():
    """With a rate that remains, contacts would stay open, and strike again at once, without end."""
    chance, rest, left = np.random.default_rng(0), 1e-5, []
    ones = np.ones(4)
    model = SimpleNamespace(layout=SimpleNamespace(rows=4), compliance=ones, speeds=ones)
    for nearly in 10.0 ** np.arange(-9.0, 1.0):
        rows = np.linalg.qr(chance.normal(size=(6, 6)))[0][:4]  # of G, with M = 1
        fast = rows[3].copy()
        rows[3] = chance.normal(size=3) @ rows[:3] + nearly * fast
        rates = rows @ (0.1 * rest * chance.normal(size=6) + min(0.5 * rest / nearly, 1.0) * fast)
        matrix = rows @ rows.T
        found = _resting(model, SimpleNamespace(rates=rates), matrix, [0, 1, 2, 3], rest * ones)
        left.append(found is None)
        if found is not None:
            assert np.max(np.abs(rates + matrix @ found[0])) <= RESTING
    assert all(left[:6])
    assert not any(left[8:])


def test_a_slip_that_depends_on_others_does_not_keep_them_from_rest():
    """All friction was left out then: what slipped so slowly raised contacts again and again, without end."""
    chance, rest, ones = np.random.default_rng(1), 1e-5, np.ones(5)
    model = SimpleNamespace(layout=SimpleNamespace(rows=5), compliance=ones, speeds=ones)
    rows = chance.normal(size=(5, 7))  # of G, with M = 1: two gaps, and three rows of friction
    rows[3] = 0.5 * rows[0] + rows[2]
    rates = 0.1 * rest * (rows @ chance.normal(size=7))
    rates[3] += 0.01 * rest  # no motion of rigid bodies: as two slips that round-off sets apart
    matrix = rows @ rows.T
    readings = SimpleNamespace(rates=rates)
    assert _resting(model, readings, matrix, [0, 1, 2, 3, 4], rest * ones) is None
    impulses, _ = _slow_at_rest(model, readings, matrix, [0, 1], [2, 3, 4], rest * ones)
    after = np.abs(rates + matrix @ impulses)
    assert np.max(after[[0, 1, 2, 4]]) <= RESTING
    assert after[3] == pytest.approx(0.01 * rest, rel=1e-6)
