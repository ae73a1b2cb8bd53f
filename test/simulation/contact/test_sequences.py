"""Interlocked sequences of rebounds: each impact of one body sets off the sequence of another one again."""

from itertools import pairwise

import numpy as np
import pytest

from mbd_sim import Simulation

TABLE = """
mechanism: interlocked
parts:
  table: {shape: {type: particle, mass: 2}}
  a: {shape: {type: particle, mass: 1}}
  b: {shape: {type: particle, mass: 0.7}}
joints:
  table: {type: prismatic, between: [ground, table], axis: [0, 0, 1], stiffness: 500, damping: 3}
  a: {type: prismatic, between: [table, a], axis: [0, 0, 1], position: 0.02, limits: LIMITS}
  b: {type: prismatic, between: [table, b], axis: [0, 0, 1], position: 0.013, limits: LIMITS}
""".replace("LIMITS", "{lower: 0, upper: 1, restitution: 0.9}")


@pytest.mark.parametrize("step", [1e-3, 5e-3])
def test_sequences_that_set_off_each_other_end_within_few_events(step):
    """Steps had 135 and 146 of them. What the end of the sequences leaves out is not seen beside the steps' own errors."""
    fine = Simulation.from_text(TABLE, step=1e-4)
    fine.run(until=0.8)
    simulation, counts, totals = Simulation.from_text(TABLE, step=step), [0], []
    while simulation.time < 0.8 - 0.5 * step:
        simulation.step(1)
        counts.append(len(simulation.contact_events))
        totals.append(simulation.energies.total)
    assert 100 < max(after - before for before, after in pairwise(counts)) < 125
    assert np.max(np.diff(totals)) < 1e-13  # of some 2 J
    assert abs(simulation.energies.residual) < 1e-13
    np.testing.assert_allclose(simulation.q, fine.q, rtol=0, atol=2e-7)
    np.testing.assert_allclose(simulation.u, fine.u, rtol=0, atol=4e-6)
