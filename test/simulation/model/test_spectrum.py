"""The derivatives on which the choice of a method is based."""

import casadi as ca
import numpy as np
import pytest

from mbd_sim import load_mechanism
from mbd_sim.dynamics.equations import derive
from mbd_sim.simulation.model import spectrum


@pytest.mark.parametrize("name", ["double_rod", "four_bar", "motor_arm"])
def test_differences_are_the_derivatives_of_the_rates(name):
    equations = derive(load_mechanism(name))
    y, inputs, core = equations.start_state, np.zeros(equations.rates.size1_in(2)), equations.core.stop
    at = ca.SX.sym("y", len(y))
    slopes = ca.Function("slopes", [at], [ca.jacobian(equations.rates.call([0.0, at, inputs])[0], at)])
    expected = np.array(ca.DM(slopes(y)))[:core, :core]
    found = spectrum._jacobian(equations, 0.0, y, inputs)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5 * np.max(np.abs(expected)))
