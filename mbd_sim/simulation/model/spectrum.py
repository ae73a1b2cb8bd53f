"""The fastest motion of a mechanism near a state: the eigenvalue of the equations that is largest in size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mbd_sim.base.geometry.pose import Array

if TYPE_CHECKING:
    from mbd_sim.dynamics.equations import Equations

DIFFERENCE = 1e-7  # of the components of a state, relative to their scales and to themselves
SQUARINGS = 6  # of a matrix, to estimate its eigenvalues: ‖A⁶⁴‖^(1/64) is within some percent of the largest


@dataclass(frozen=True, slots=True)
class FastestMode:
    """The largest |λ| of ∂f/∂y in 1/s, and the index of the speed u that takes the largest part in it."""

    rate: float
    speed: int


def fastest_mode(equations: Equations, time: float, y: Array, inputs: Array) -> FastestMode:
    """The fastest mode at a state, from finite differences; the rate is 0 if it cannot be found."""
    if equations.layout.nv == 0:
        return FastestMode(0.0, 0)
    return _largest(equations, _jacobian(equations, time, y, inputs))


def is_slower(equations: Equations, time: float, y: Array, inputs: Array, rate: float) -> bool:
    """Whether the fastest mode at a state is surely not faster than a rate in 1/s; False if that remains unknown.

    It takes a tenth of the time of the eigenvalues: the largest |λ| of A is at most ‖Aᵏ‖^(1/k), and close to it for
    large k.
    """
    if equations.layout.nv == 0:
        return True
    power = _scaled(equations, _jacobian(equations, time, y, inputs)) / rate
    if not np.all(np.isfinite(power)):
        return True  # as in `fastest_mode`
    with np.errstate(all="ignore"):
        for _ in range(SQUARINGS):
            power = power @ power
            if np.linalg.norm(power) <= 1.0:
                return True
    return False


def fastest_without_joints(equations: Equations, time: float, y: Array, inputs: Array) -> FastestMode:
    """The fastest mode without what the forces within joints contribute to the derivatives."""
    nq, nv = equations.layout.nq, equations.layout.nv
    pushed = np.tile(inputs[:, None], nv + 1)  # the last column are the inputs themselves
    pushed[:nv, :nv] += np.eye(nv)  # one effort each: the equations are linear in them
    rates = np.array(equations.rates.call([time, y, pushed])[0])[nq : nq + nv]
    inverse_mass = rates[:, :-1] - rates[:, -1:]
    damping, stiffness = (np.array(value) for value in equations.joint_linearization.slopes(time, y, inputs))
    jacobian = _jacobian(equations, time, y, inputs)
    with np.errstate(all="ignore"):
        jacobian[nq : nq + nv, nq : nq + nv] += inverse_mass * damping.ravel()
        jacobian[nq : nq + nv, :nq] += inverse_mass @ stiffness
    return _largest(equations, jacobian)


def _speeds(equations: Equations) -> slice:
    return slice(equations.layout.nq, equations.layout.nq + equations.layout.nv)


def _jacobian(equations: Equations, time: float, y: Array, inputs: Array) -> Array:
    size = equations.core.stop
    states = np.tile(y[:, None], size + 1)  # the last one is the state itself
    steps = np.arange(size)
    with np.errstate(all="ignore"):  # the state or the efforts may be close to infinity
        states[steps, steps] += DIFFERENCE * (np.array(equations.scales[:size]) + np.abs(y[:size]))
        rates = np.array(equations.rates.call([time, states, inputs])[0])[:size]
        jacobian: Array = (rates[:, :-1] - rates[:, -1:]) / (states[steps, steps] - y[:size])
    return jacobian


def _scaled(equations: Equations, jacobian: Array) -> Array:
    """The derivatives of the components divided by their scales: it has the same eigenvalues."""
    scales = np.array(equations.scales[: len(jacobian)])
    scaled: Array = jacobian * scales / scales[:, None]
    return scaled


def _largest(equations: Equations, jacobian: Array) -> FastestMode:
    if not np.all(np.isfinite(jacobian)):
        return FastestMode(0.0, 0)
    values, vectors = np.linalg.eig(_scaled(equations, jacobian))
    fastest = int(np.argmax(np.abs(values)))
    return FastestMode(float(np.abs(values[fastest])), int(np.argmax(np.abs(vectors[_speeds(equations), fastest]))))
