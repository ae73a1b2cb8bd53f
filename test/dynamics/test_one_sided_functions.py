"""One-sided rows whose matrix is written out, and given as factors."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.dynamics import one_sided_functions

# A block that slides with four of its corners, of which three would do; a fourth leg is heavier and lifts the others.
SLED = """
mechanism: sled
parts:
  sled: {shapes: [{type: block, mass: 2, size: [0.3, 0.2, 0.1]}, {type: particle, mass: 1, at: [0.05, 0.02, 0.2]}]}
  arm: {shape: {type: rod, mass: 0.5, to: [0, 0, 0.3]}}
joints:
  sled: {type: free, between: [ground, sled], position: [0, 0, 0.05], velocity: [0.8, 0.1, 0]}
  arm: {type: revolute, between: [sled, arm], axis: [1, 0, 0], position: 0.4, stiffness: 5, damping: 0.05}
contacts:
  floor: {parts: [sled], plane: ground, friction: 0.3}
"""
# Friction that depends on the loads of joints, in a loop; unilateral constraints with a loop; several points that touch.
CASES = {
    "slider_crank_friction": (None, 0.1),
    "four_bar_clearance": (None, 0.1),
    "column_of_beads": (None, 0.3),
    "rocking": (None, 0.5),
    "sled": (SLED, 0.4),
}


@pytest.mark.parametrize("name", CASES)
def test_factors_give_the_same_motion_as_the_matrix(monkeypatch, own_builds, name):
    text, until = CASES[name]
    found = []
    for least in (1, 10**9):
        monkeypatch.setattr(one_sided_functions, "FACTORED", least)
        sim = Simulation.from_file(name) if text is None else Simulation.from_text(text)
        assert (sim.model.equations.one_sided.rates.factors is None) == (least > 1)
        sim.run(until=until)
        assert sim.contact_events or name in ("slider_crank_friction", "rocking")
        assert abs(sim.energies.residual) < 1e-11
        found.append((sim.state, [(event.name, event.change) for event in sim.contact_events]))
    (one, events), (other, expected) = found
    assert one == pytest.approx(other, rel=1e-9, abs=1e-9)
    assert np.max(np.abs(one)) > 0.01
    assert events == expected
