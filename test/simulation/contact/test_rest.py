"""Impacts that bring contacts to rest: slow ones, which would rebound without end."""

from types import SimpleNamespace

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.simulation.contact.candidates import RESTING
from mbd_sim.simulation.contact.impact import _resting

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
