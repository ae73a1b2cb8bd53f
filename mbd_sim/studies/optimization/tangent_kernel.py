"""A kernel that integrates a state together with its derivatives.

Its state is z = (x, S), with S = ∂x/∂(x₀, e, p) by columns, and its rates are x' = f(t, x, e, p) and
S' = ∂f/∂x S + ∂f/∂(x₀, e, p); it is projected by P(t, x, p) and ∂P/∂x S + ∂P/∂(x₀, e, p). Integration methods commute
with differentiation (Hairer, Lubich & Wanner, *Geometric Numerical Integration*, lemma VI.4.1): a step of z is the step
of x and the exact derivative of that step.
"""

from __future__ import annotations

from itertools import accumulate, pairwise

import casadi as ca
import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.compiler.kernel import compile_kernel
from mbd_sim.compiler.python.bound_kernel import Kernel
from mbd_sim.integrators.method import Method
from mbd_sim.integrators.methods import METHODS
from mbd_sim.simulation.model.method_choice import DEFAULT, STIFF, choose_method
from mbd_sim.simulation.model.prepared import AUTO, require_method
from mbd_sim.studies.optimization.casadi_functions import CasadiFunctions


class TangentKernel:
    """A compiled system (x, S). `method` is that of its steps; the columns of S are `starts`, `efforts`, `parameters`.

    Without start states or efforts among the columns, their slices are empty.
    """

    def __init__(self, functions: CasadiFunctions, method: Method, *, by_start: bool, by_efforts: bool) -> None:
        self._functions, self.method = functions, method
        self.nx = len(functions.start)
        counts = [self.nx * by_start, len(functions.efforts) * by_efforts, len(functions.values)]
        ends = accumulate(counts, initial=0)
        self.starts, self.efforts, self.parameters = (slice(*pair) for pair in pairwise(ends))
        rates, projection = self._traced(by_efforts)
        self._kernel = compile_kernel(rates, projection, {}, method)
        self._history = method.history_size(rates.nnz_in(1), rates.nnz_in(2))
        self.columns = sum(counts)
        self.instructions = self._kernel.instructions

    def _traced(self, by_efforts: bool) -> tuple[ca.Function, ca.Function | None]:
        """The rates and the projection of z for inputs (time offset, e, p)."""
        own, nx = self._functions, self.nx
        t, x, offset = ca.SX.sym("t"), ca.SX.sym("x", nx), ca.SX.sym("offset")
        e, p = ca.SX.sym("e", len(own.efforts)), ca.SX.sym("p", len(own.values))
        s = ca.SX.sym("S", nx, self.parameters.stop)
        arguments, time = [t, ca.vertcat(x, ca.vec(s)), ca.vertcat(offset, e, p)], t + offset

        by = {"x": x, "e": e if by_efforts else ca.SX(0, 1), "p": p}

        def with_derivatives(values: ca.SX) -> ca.SX:
            return ca.vertcat(values, ca.vec(ca.densify(_tangents(values, s, **by))))

        outputs = [with_derivatives(own.f.call([time, x, e, p])[0])]
        if own.margin is not None:
            outputs += own.margin.call([time, x, e, p])
        rates = ca.Function("tangent_rates", arguments, outputs, {"cse": True})
        if own.equations.project is None:
            return rates, None
        projected = own.project.call([time, x, p])[0]
        projection = ca.Function("tangent_projection", arguments, [with_derivatives(projected)], {"cse": True})
        return rates, projection

    def memory(self, offset: float, e: Array, p: Array) -> TangentMemory:
        """Memory for a run whose step k begins at the time `offset` + k h, under efforts e; all of (x, S) is zero."""
        inputs = np.concatenate([[offset], e, p, np.zeros(self._history)])
        return TangentMemory(
            self._kernel, np.zeros(self.nx * (1 + self.columns)), self.nx, inputs, inputs[1 : 1 + len(e)]
        )


class TangentMemory:
    """The arrays of a run, which the kernel changes in place: `z` (nx (1 + columns),), and views of it and the inputs.

    The state `x` (nx,), its derivatives `columns` (nx, columns), and the `efforts` (ne,).
    """

    def __init__(self, kernel: Kernel, z: Array, nx: int, inputs: Array, efforts: Array) -> None:
        self.z, self.x, self.columns, self.efforts = z, z[:nx], z[nx:].reshape(-1, nx).T, efforts
        self._advance, self._inputs = kernel.advance, inputs
        self._addresses = z.ctypes.data, inputs.ctypes.data

    def advance(self, first: int, step: float, steps: int) -> bool:
        """Take some steps of size `step`; False where z would not stay finite, and then nothing is changed."""
        return bool(self._advance(*self._addresses, first, step, steps))


def _tangents(values: ca.SX, s: ca.SX, x: ca.SX, e: ca.SX, p: ca.SX) -> ca.SX:
    """∂values/∂x S + ∂values/∂(x₀, e, p), where the first columns of S are by x₀ if there are more than those by e, p.

    With few columns, directional derivatives take fewer operations than the product with the matrix ∂values/∂x.
    """
    direct = ca.SX(e.shape[0] + p.shape[0], s.shape[1])
    direct[:, s.shape[1] - direct.shape[0] :] = ca.SX.eye(direct.shape[0])
    inputs = ca.vertcat(e, p)
    found = ca.jacobian(values, x) @ s + ca.jacobian(values, inputs) @ direct
    if s.shape[1] <= x.shape[0]:
        directional = ca.jtimes(values, ca.vertcat(x, inputs), ca.vertcat(s, direct))
        return min(found, directional, key=lambda expression: _operations(values, expression))
    return found


def _operations(*expressions: ca.SX) -> int:
    symbols = ca.symvar(ca.veccat(*expressions))
    return int(ca.Function("count", symbols, list(expressions), {"cse": True}).n_instructions())


def tangent_method(functions: CasadiFunctions, name: str | None, step: float) -> Method:
    """The method of integration by its name, by default that of the file; `auto` chooses as for a simulation.

    Where that chooses `rosenbrock_w`, it is `rosenbrock` instead.

    :raises MechanismError: there is no such method.
    :raises InputError: the method is `rosenbrock_w`, whose steps use derivatives of some forces only, or `taylor`,
        which needs series of the derivatives.
    """
    mechanism, equations = functions.mechanism, functions.equations
    name = require_method(mechanism, name)
    method = choose_method(mechanism, equations, equations.inputs_without_commands, name, step).method
    if method.uses_series:
        raise InputError(f"method {name} has no derivatives", f"Use {DEFAULT}, or another method.")
    if not method.uses_joints:
        return method
    if name == AUTO:
        return METHODS[STIFF]
    raise InputError(f"method {name} has no derivatives", f"Use {STIFF}, or another method.")
