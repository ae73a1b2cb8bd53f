"""Where values at the nodes of collocation become negative, beside roots of the polynomials that they are taken from."""

from types import SimpleNamespace

import numpy as np
import pytest

from mbd_sim.base.rounded import radau
from mbd_sim.simulation.contact.compiled.instant.sliding import STAGES
from mbd_sim.simulation.contact.compiled.nodes import first_crossing

NODES = np.array([0.0, *radau(STAGES)[0]])
TOLERANCE = 1e-13


def crossing(guards, slips=(), left_out=()):
    """The first crossing of polynomials: of guards, and of slips of friction elements that turn."""
    c = SimpleNamespace(guards=len(guards), frictions=len(slips), tolerance=TOLERANCE, radau=NODES)
    kept = np.array([[one(x) for one in (*guards, *slips)] for x in NODES]).ravel()
    marks = [int(k in left_out) for k in range(len(guards))]
    return first_crossing(c, SimpleNamespace(kept=kept, left_out=marks, turning=[1] * len(slips)))


def first_root(polynomials):
    """The first zero of polynomials that are positive at 0, if one is negative at a node behind it; 1 otherwise."""
    roots = [
        min(root.real for root in one.roots() if abs(root.imag) < 1e-12 and 0.0 < root.real < 1.0)
        for one in polynomials
        if np.any(one(NODES) < -TOLERANCE)
    ]
    return min(roots, default=1.0)


@pytest.mark.parametrize("seed", range(30))
def test_the_first_root_of_several_values(seed):
    """A node at which a later value is negative must not hide an earlier root of another one."""
    rng = np.random.default_rng(seed)
    falling = [
        np.polynomial.Polynomial([rng.uniform(0.1, 1.0), -rng.uniform(0.0, 2.0), *(-rng.uniform(0.0, 0.2, size=4))])
        for _ in range(5)
    ]
    assert crossing(falling[:3], falling[3:]) == pytest.approx(first_root(falling), abs=1e-6)
    assert crossing(falling[:3], falling[3:], left_out=(0, 2)) == pytest.approx(
        first_root([falling[1], *falling[3:]]), abs=1e-6
    )


def test_a_value_that_begins_with_zero():
    """A guard that rises first is zero later; one that falls is an event at once, and a slip only makes a shorter part."""
    rises, falls = np.polynomial.Polynomial([0.0, 1e-2, -1.0]), np.polynomial.Polynomial([0.0, -1e-6, -1.0])
    assert crossing([rises]) == pytest.approx(1e-2, rel=1e-5)
    assert (
        crossing([np.polynomial.Polynomial([0.0, 1e-4, -1.0])]) == 0.0
    )  # what rises less may be an error of the nodes
    assert crossing([falls]) == 0.0
    assert crossing([], [falls]) == NODES[1]


def test_values_that_stay_positive():
    assert crossing([np.polynomial.Polynomial([1.0, -0.9])], [np.polynomial.Polynomial([0.0, 1.0])]) == 1.0
