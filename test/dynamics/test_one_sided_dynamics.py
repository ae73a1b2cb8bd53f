"""One-sided rows whose matrix is written out, and given as factors."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.dynamics import one_sided_dynamics

# A body that slides on four points, of which three would do.
SLED = """
mechanism: sled
parts:
  sled: {mass: 2, center: [0.05, 0.02, 0.1], inertia: [0.03, 0.04, 0.05],
    points: {a: [0.15, 0.1, 0], b: [0.15, -0.1, 0], c: [-0.15, 0.1, 0], d: [-0.15, -0.1, 0]}}
joints:
  sled: {type: free, between: [ground, sled], velocity: [0.8, 0.1, 0], angular_velocity: [0, 0, 1]}
contacts:
  floor: {parts: [sled.a, sled.b, sled.c, sled.d], plane: ground, friction: 0.3}
"""
# Friction that depends on the loads of joints, in a loop; several points that touch.
CASES = {"slider_crank_friction": (None, 0.1), "sled": (SLED, 0.4)}


@pytest.mark.parametrize("name", CASES)
def test_factors_give_the_same_motion_as_the_matrix(monkeypatch, own_builds, name):
    text, until = CASES[name]
    found = []
    for least in (1, 10**9):
        monkeypatch.setattr(one_sided_dynamics, "FACTORED", least)
        options = {"method": "tsitouras8"}
        sim = Simulation.from_file(name, **options) if text is None else Simulation.from_text(text, **options)
        assert (sim.model.equations.one_sided.rates.factors is None) == (least > 1)
        sim.run(until=until)
        assert sim.contact_events or name == "slider_crank_friction"
        assert abs(sim.energies.residual) < 1e-11
        found.append((sim.state, [(event.name, event.change) for event in sim.contact_events]))
    (one, events), (other, expected) = found
    assert one == pytest.approx(other, rel=1e-9, abs=1e-9)
    assert np.max(np.abs(one)) > 0.01
    assert events == expected
