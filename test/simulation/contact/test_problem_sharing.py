"""Forces that rigid bodies leave undetermined: the least sum of squares within the limits of friction."""

import numpy as np
import pytest
from scipy.optimize import minimize

from mbd_sim.simulation.contact.problem import ContactProblem, FrictionLimit, contact_forces


def shared_load(chance, contacts, load):
    """Friction at rest of some contacts of a body in a plane, up to 1 each: the rows (2 n, 3), the free rates, limits."""
    places = chance.uniform(-1.0, 1.0, (contacts, 2))
    rows = np.array([row for x, y in places for row in ((1.0, 0.0, -y), (0.0, 1.0, x))])
    wrench = chance.normal(size=3)
    return rows, rows @ (load * wrench), [FrictionLimit((2 * i, 2 * i + 1), None, 1.0) for i in range(contacts)]


def least_forces(rows, free, contacts):
    """By a general optimizer."""
    found = minimize(
        lambda x: x @ x,
        np.zeros(2 * contacts),
        jac=lambda x: 2.0 * x,
        method="SLSQP",
        constraints=[
            {"type": "eq", "fun": lambda x: rows.T @ x + np.linalg.lstsq(rows, free, rcond=None)[0]},
            {"type": "ineq", "fun": lambda x: 1.0 - np.sum(x.reshape(-1, 2) ** 2, axis=1)},
        ],
        options={"maxiter": 500, "ftol": 1e-14},
    )
    return found.x if found.success else None


@pytest.mark.parametrize("seed", range(8))
def test_friction_at_rest_is_least_within_its_limits_in_any_order(seed):
    """It was what Newton's method happened to find, so it depended on the order where one was at its limit."""
    chance, contacts, load = np.random.default_rng(seed), 4, 0.0
    state = chance.bit_generator.state
    while True:  # the largest load of a series at which there still is a distribution, with several at their limits
        chance.bit_generator.state = state
        rows, free, limits = shared_load(chance, contacts, load + 0.1)
        if least_forces(rows, free, contacts) is None:
            break
        load += 0.1
    chance.bit_generator.state = state
    rows, free, limits = shared_load(chance, contacts, load)
    expected = least_forces(rows, free, contacts)
    found = contact_forces(ContactProblem(rows @ rows.T, free, [], limits))
    assert found == pytest.approx(expected, abs=1e-5)
    assert found @ found == pytest.approx(expected @ expected, rel=1e-7)
    assert np.max(np.abs(rows @ rows.T @ found + free)) < 1e-10
    order = np.random.default_rng(seed).permutation(contacts)
    moved = [row for contact in order for row in (2 * contact, 2 * contact + 1)]
    other = contact_forces(ContactProblem((rows @ rows.T)[moved][:, moved], free[moved], [], limits))
    assert other == pytest.approx(found[moved], abs=1e-9)
