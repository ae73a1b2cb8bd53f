"""The mass matrix at the start, of which it is checked that it is regular."""

import casadi as ca
import numpy as np
import pytest

from mbd_sim import load_mechanism
from mbd_sim.dynamics.dynamics_terms import mass_matrix
from mbd_sim.dynamics.initial_conditions import given_start
from mbd_sim.dynamics.regular_start import start_mass_matrix
from mbd_sim.dynamics.tracing import trace


@pytest.mark.parametrize("name", ["double_rod", "spherical_top", "rotating_frame_mass", "cart_massive_spring"])
def test_the_columns_of_the_mass_matrix_are_those_of_composite_bodies(name):
    """Of derivatives of the kinetic energy, against the composite-rigid-body algorithm, also with drives."""
    traced = trace(load_mechanism(name))
    q = given_start(traced.numeric, traced.layout)[0]
    symbols = [traced.state.t, traced.state.q]
    expected = np.array(ca.Function("M", symbols, [mass_matrix(traced)])(0.0, q))
    found = start_mass_matrix(traced, q)
    assert found == pytest.approx(expected, rel=1e-14, abs=1e-14 * np.max(np.abs(expected)))
