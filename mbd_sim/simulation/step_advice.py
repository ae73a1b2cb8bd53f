"""What to change where a step is too large for a mechanism: for its accuracy, or for the method's stability."""

from __future__ import annotations

import math

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.integrators.rosenbrock import Rosenbrock
from mbd_sim.integrators.tableau import Tableau
from mbd_sim.simulation.compiled_model import Model

TOLERATED = 1e-5  # estimated error of a step, as a part of 1 + |q| and 1 + |u|; shipped mechanisms stay below 1e-6
AIM = 1e-7  # error of a step that a proposed step size should have
MARGIN = 0.5  # of the largest stable step, what is proposed
HOPELESS = 100.0  # times smaller than now: such a step is not proposed beside another method


def step_advice(model: Model, time: float, y: Array, inputs: Array, step: float, estimate: float) -> str | None:
    """A sentence that names a better step or method, or None where the estimated error of a step is small enough."""
    if estimate <= TOLERATED:
        return None
    method = model.method
    lost = not estimate < 1.0  # then the state itself means nothing any more
    fastest = fastest_rate(model, 0.0, model.start, inputs) if lost else fastest_rate(model, time, y, inputs)
    stiff = step * fastest > method.reach
    better = step * (AIM / estimate) ** (1.0 / (method.order + 1)) if math.isfinite(estimate) else 0.1 * step
    if stiff:
        better = min(better, MARGIN * method.reach / fastest)
    others = []
    if stiff or (not math.isfinite(estimate) and not isinstance(method, Rosenbrock)):
        others.append("method rosenbrock")
    elif method.order < 8 and isinstance(method, Tableau):
        others.append("method tsitouras8")
    if not others or better * HOPELESS >= step:
        others.insert(0, f"step {round_down(better):g}")
    size = f"is estimated at {estimate:.1g}" if math.isfinite(estimate) else "is beyond all bounds"
    why = f", as it has rates of {fastest:.1g}/s" if stiff else ""
    return (
        f"a step of {step:g} s is too large for {model.mechanism.name}{why}: the error of a step {size}. "
        f"Try {' or '.join(others)}."
    )


def fastest_rate(model: Model, time: float, y: Array, inputs: Array) -> float:
    """The largest eigenvalue of ∂f/∂y by size, 1/s, from differences; 0 where it cannot be found."""
    size = model.u_range.stop

    def rates(state: Array) -> Array:
        return np.array(model.equations.rates.call([time, state, inputs])[0]).ravel()[:size]

    base, jacobian = rates(y), np.zeros((size, size))
    with np.errstate(all="ignore"):  # the state or the efforts may be close to infinity
        for index in range(size):
            moved = y.copy()
            moved[index] += 1e-7 * (1.0 + abs(y[index]))
            jacobian[:, index] = (rates(moved) - base) / (moved[index] - y[index])
    if not np.all(np.isfinite(jacobian)):
        return 0.0
    return float(np.max(np.abs(np.linalg.eigvals(jacobian)), initial=0.0))


def round_down(value: float) -> float:
    """The next number below of the form 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(lead for lead in (5.0, 2.0, 1.0) if lead * power <= value * (1.0 + 1e-9)) * power
