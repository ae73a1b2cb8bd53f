"""A step of a Rosenbrock-W method, as IR: the linear systems are solved by functions of the caller."""

from __future__ import annotations

import casadi as ca

from mbd_sim.compiler.ir import Value
from mbd_sim.compiler.ir_types import local_array, number
from mbd_sim.compiler.ir_vectors import combine, weighted
from mbd_sim.compiler.lowering import lower
from mbd_sim.compiler.rosenbrock_step import right_side, stage_slopes
from mbd_sim.compiler.simd_builder import lanes_of
from mbd_sim.compiler.step_emitter import Prepare, StepEmitter
from mbd_sim.integrators.rosenbrock import Rosenbrock


def rosenbrock_w_step(method: Rosenbrock, at: ca.Function, solve: ca.Function) -> Prepare:
    """The step of a method that keeps its order with any approximation A of the Jacobian, for `emit_advance`.

    :param at: `at(t, y, inputs, g)` gives the memory (m,) of `solve`.
    :param solve: `solve(memory, r)` gives U with (I - g A) U = r.
    """
    return lambda emitter: _RosenbrockWStep(method, at, solve, emitter).step


class _RosenbrockWStep:
    """The functions and the arrays of a step."""

    def __init__(self, method: Rosenbrock, at: ca.Function, solve: ca.Function, emitter: StepEmitter) -> None:
        b = emitter.b
        self._method, self._emitter = method, emitter
        self._at, self._solve = (lower(b.module, function, inline=False, lanes=lanes_of(b)) for function in (at, solve))
        self._increments = [emitter.vector() for _ in range(method.stages)]
        self._trial, self._slopes, self._right = (emitter.vector() for _ in range(3))
        self._memory = local_array(b, max(1, at.nnz_out(0)))
        self._g = emitter.scalar()
        self._emit_estimate = emitter.estimator(method.estimate, self._increments)

    def step(self, t: Value) -> None:
        """Emit the step from time t on."""
        emitter, method, b = self._emitter, self._method, self._emitter.b
        emitter.rates(t, emitter.y, self._slopes, first=True)
        b.store(t, emitter.time)
        b.store(b.fmul(number(method.gamma), emitter.h), self._g)
        b.call(self._at, [emitter.time, emitter.y, emitter.inputs, self._g, self._memory])
        for stage in range(method.stages):
            if stage > 0:
                stage_slopes(emitter, method, t, stage, self._increments, self._trial, self._slopes)
            right_side(emitter, method, stage, self._increments, self._slopes, None, self._right)
            b.call(self._solve, [self._memory, self._right, self._increments[stage]])
        self._emit_estimate(None)
        combine(b, emitter.system.size, emitter.y, emitter.y, None, weighted(method.m, self._increments))
