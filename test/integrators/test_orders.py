"""The order of every method on mechanisms with drives, quaternions and loops."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.integrators.explicit import ADAMS, TAYLOR
from mbd_sim.integrators.methods import METHODS

TIMES = {"moving_support_pendulum": 1.6, "heavy_top": 0.04, "four_bar": 0.4, "tube_particles": 0.16}
# The number of steps until that time. The errors of runs with this many and twice as many steps are compared.
STEPS = {
    "euler": 8000,
    "midpoint": 1000,
    "rk4": 64,
    "verner7": 10,
    "dop853": 8,
    "tsitouras8": 10,
    "rosenbrock": 32,
    "rosenbrock_w": 128,
    "gauss4": 40,
    "gauss6": 16,
}


@cache
def state(name, method, steps):
    simulation = Simulation.from_file(name, method=method, step=TIMES[name] / steps)
    simulation.step(steps)
    return simulation.state


ORDERED = [name for name, one in METHODS.items() if name not in {**ADAMS, **TAYLOR} and not one.time_stepping]
PAIRS = [(name, method) for i, name in enumerate(TIMES) for method in ORDERED[i::4]]


@pytest.mark.parametrize(("name", "method"), PAIRS)
def test_order(name, method):
    """Including the energies of the audit, the last three components of the state.

    Adams methods take such long steps as other methods do, and Taylor methods divide them; see `test_adams` and
    `test_taylor_step` for theirs.
    """
    exact = state(name, "dop853", 2000)
    coarse, fine = (np.max(np.abs(state(name, method, n * STEPS[method]) - exact)) for n in (1, 2))
    assert fine > 1e-13
    assert coarse / fine > 2.0 ** (METHODS[method].order - 0.6)
