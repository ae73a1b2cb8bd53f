"""Root loci and stability maps against closed forms."""

import numpy as np
import pytest

from mbd_sim import parse_mechanism
from mbd_sim.base.errors import InputError
from mbd_sim.studies.linear_analysis import draw_locus, eigenvalue_locus
from test.studies.linear_analysis.columns import COLUMN


def test_flutter_of_zieglers_column():
    """2 λ⁴ + (7 - 2 P) λ² + 1 = 0 without damping: pairs meet at P = 7/2 - √2."""
    forces = [0.0, 1.0, 3.5 - np.sqrt(2) - 1e-6, 3.5 - np.sqrt(2) + 1e-4, 3.0]
    locus = eigenvalue_locus(parse_mechanism(COLUMN), {"P": forces})
    for force, found in zip(forces, locus.eigenvalues, strict=True):
        exact = np.roots([2, 0, 7 - 2 * force, 0, 1])
        assert np.sort_complex(np.poly(found).real) == pytest.approx(np.sort_complex(np.poly(exact).real), abs=1e-9)
    assert (locus.growth > 0).tolist() == [False, False, False, True, True]


def test_damping_destabilizes_it(tmp_path):
    """With equal damping c at both joints, the limit is P = 41/28 + c²/2 (Ziegler 1952)."""
    factors, damping = [0.999, 1.001], [0.05, 0.4, 1.0]
    for c in damping:
        limit = 41 / 28 + c**2 / 2
        locus = eigenvalue_locus(
            parse_mechanism(COLUMN), {"P": [factor * limit for factor in factors], "c": [c]}, "start"
        )
        assert (np.max(locus.eigenvalues.real, axis=-1) > 0).ravel().tolist() == [False, True]
    draw_locus(
        tmp_path / "map.png", eigenvalue_locus(parse_mechanism(COLUMN), {"P": [1, 2, 3], "c": [0.1, 0.5]}, "start")
    )
    assert (tmp_path / "map.png").stat().st_size > 10_000


TILTED = """
mechanism: tilted
parameters: {alpha: 0}
parts: {ball: {mass: 1, center: [0, 0, -1], inertia: {xx: 0.5, yy: 0.5, zz: 0.5}}}
joints: {pin: {type: revolute, between: [ground, ball], axis: [0, cos(alpha), sin(alpha)], position: 0.1}}
"""


def test_values_that_cannot_be_live_are_built_anew():
    """A pendulum about a tilted axis: ω² = m g l cos² α / (I + m l² cos² α)."""
    locus = eigenvalue_locus(parse_mechanism(TILTED), {"alpha": [0.0, 0.6]})
    share = np.cos([0.0, 0.6]) ** 2
    exact = np.sqrt(9.81 * share / (0.5 + share))
    assert np.max(locus.eigenvalues.imag, axis=1) == pytest.approx(exact, rel=1e-9)


def test_mechanisms_without_equilibria_are_refused():
    driven = COLUMN.replace("stiffness: 1, damping: c}\nforces", 'drive: "sin(t)"}\nforces')
    with pytest.raises(InputError, match="depend on time"):
        eigenvalue_locus(parse_mechanism(driven), {"P": [1.0]})
