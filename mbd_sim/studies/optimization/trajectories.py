"""Trajectories as differentiable CasADi functions of start state, efforts and parameters.

The steps are those of the simulation with the same explicit method: the derivatives are those of the computed
trajectory, not of the exact one (differentiation of the discretized equations).
"""

from __future__ import annotations

from operator import index

import casadi as ca

from mbd_sim.base.errors import InputError, nearest
from mbd_sim.base.interrupts import interruptible_tracing
from mbd_sim.integrators.tableau import EXPLICIT, Tableau
from mbd_sim.studies.optimization.casadi_functions import CasadiFunctions

DEFAULT = "tsitouras8"


@interruptible_tracing()
def one_step(functions: CasadiFunctions, step: float, method: str = DEFAULT) -> ca.Function:
    """(t, x, e, p) -> `x_next` (nx,), the state `step` s later under constant efforts.

    With constraints and unit quaternions the state is projected onto them, as in the simulation.

    :param method: an explicit method, see `integrator.method` in mechanism files.
    :raises InputError: there is no such method.
    """
    if method not in EXPLICIT:
        raise InputError(f"there is no explicit method '{method}'", nearest(method, EXPLICIT))
    t, x = ca.SX.sym("t"), ca.SX.sym("x", len(functions.start))
    e, p = ca.SX.sym("e", len(functions.efforts)), ca.SX.sym("p", len(functions.values))
    after = _runge_kutta(functions.f, EXPLICIT[method], t, x, e, p, step)
    after = functions.project.call([t + step, after, p])[0]
    return ca.Function("one_step", [t, x, e, p], [after], ["t", "x", "e", "p"], ["x_next"], {"cse": True})


@interruptible_tracing()
def trajectory(functions: CasadiFunctions, steps: int, step: float, method: str = DEFAULT) -> ca.Function:
    """(t0, x0, e, p) -> `x` (nx, steps + 1), the states from x0 at the time t0 on, `step` s apart.

    `e` (ne, steps) are the efforts, constant during each step. `function.factory("name", function.name_in(),
    ["jac:x:p"])` differentiates it.

    :param method: see `one_step`.
    :raises InputError: there is no such method, or no step.
    :raises TypeError: `steps` is not an integer.
    """
    if (steps := index(steps)) < 1 or not step > 0.0:
        raise InputError(f"{steps} steps of {step} s are no trajectory", "Give at least one step, of a positive size.")
    next_state = one_step(functions, step, method)
    x0, e = ca.MX.sym("x0", len(functions.start)), ca.MX.sym("e", len(functions.efforts), steps)
    t0, p = ca.MX.sym("t0"), ca.MX.sym("p", len(functions.values))
    times = t0 + ca.DM([step * number for number in range(steps)]).T
    states = _state_first(next_state).mapaccum(steps)(x0, times, e, ca.repmat(p, 1, steps))
    return ca.Function("trajectory", [t0, x0, e, p], [ca.horzcat(x0, states)], ["t0", "x0", "e", "p"], ["x"])


def _state_first(function: ca.Function) -> ca.Function:
    """A copy of a function with its state as the first input, as `mapaccum` needs it."""
    t, x, e, p = function.sx_in()
    return ca.Function("state_first", [x, t, e, p], function.call([t, x, e, p]))


def _runge_kutta(f: ca.Function, method: Tableau, t: ca.SX, x: ca.SX, e: ca.SX, p: ca.SX, step: float) -> ca.SX:
    rates: list[ca.SX] = []
    for row, c in zip(method.a, method.c, strict=True):
        place = x + step * sum((a * k for a, k in zip(row, rates, strict=False) if a), ca.SX.zeros(x.shape[0], 1))
        rates.append(f.call([t + c * step, place, e, p])[0])
    return x + step * sum((b * k for b, k in zip(method.b, rates, strict=True) if b), ca.SX.zeros(x.shape[0], 1))
