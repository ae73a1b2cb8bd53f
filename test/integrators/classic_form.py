"""Rosenbrock methods in the form with products with the Jacobian, and their stability."""

from __future__ import annotations

import numpy as np
import pytest


def lower(rows):
    matrix = np.zeros((len(rows), len(rows)))
    for row, values in enumerate(rows):
        matrix[row, : len(values)] = values
    return matrix


def classic(method):
    """α, Γ, b and the embedded weights' difference, in the form with products with J (Hairer & Wanner II, eq. IV.7.4)."""
    gamma = np.linalg.inv(np.eye(method.stages) / method.gamma - lower(method.g))
    return lower(method.a) @ gamma, gamma, np.array(method.m) @ gamma, np.array(method.estimate.fine) @ gamma


def require_l_stable(method, frequencies):
    """Require |R(iy)| <= 1 at these frequencies y, R(z) -> 0 for z -> -inf, and stiff accuracy."""
    alpha, gamma, b, _ = classic(method)
    beta, one = alpha + gamma, np.ones(method.stages)

    def stability(z):
        return 1.0 + z * b @ np.linalg.solve(np.eye(method.stages) - z * beta, one)

    assert max(abs(stability(1j * y)) for y in frequencies) < 1.0 + 1e-9
    assert abs(stability(-1e9)) < 1e-6
    assert b == pytest.approx(beta[-1], abs=1e-12)
