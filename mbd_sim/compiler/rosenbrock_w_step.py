"""A step of a Rosenbrock-W method, as IR: the linear systems are solved by functions of the caller."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from mbd_sim.compiler.ir import Function, Value
from mbd_sim.compiler.ir_types import local_array, number
from mbd_sim.compiler.ir_vectors import combine, weighted
from mbd_sim.compiler.rosenbrock_step import right_side, stage_slopes
from mbd_sim.compiler.step_emitter import Prepare, StepEmitter
from mbd_sim.integrators.rosenbrock import Rosenbrock


@dataclass(frozen=True, slots=True)
class PartialFunctions:
    """The functions of a partial system as IR: see `emit_partial_system`. The memory has `memory_size` numbers."""

    at: Function
    solve: Function
    memory_size: int


def emit_partial_system(
    at: ca.Function, solve: ca.Function, emit: Callable[[ca.Function], Function]
) -> PartialFunctions:
    """Emit the functions of a partial system.

    :param at: `at(t, y, inputs, g)` gives the memory (m,) of `solve`.
    :param solve: `solve(memory, r)` gives U with (I - g A) U = r.
    :param emit: emits or declares a function that is not inlined.
    """
    return PartialFunctions(emit(at), emit(solve), max(1, at.nnz_out(0)))


def rosenbrock_w_step(method: Rosenbrock, system: PartialFunctions) -> Prepare:
    """The step of a method that keeps its order with any approximation A of the Jacobian, for `emit_advance`."""
    return lambda emitter: _RosenbrockWStep(method, system, emitter).step


class _RosenbrockWStep:
    """The functions and the arrays of a step."""

    def __init__(self, method: Rosenbrock, system: PartialFunctions, emitter: StepEmitter) -> None:
        b = emitter.b
        self._method, self._emitter, self._system = method, emitter, system
        self._increments = [emitter.vector() for _ in range(method.stages)]
        self._trial, self._slopes, self._right = (emitter.vector() for _ in range(3))
        self._memory = local_array(b, system.memory_size)
        self._g = emitter.scalar()
        self._emit_estimate = emitter.estimator(method.estimate, self._increments)

    def step(self, t: Value) -> None:
        """Emit the step from time t on."""
        emitter, method, b = self._emitter, self._method, self._emitter.b
        emitter.rates(t, emitter.y, self._slopes, first=True)
        b.store(t, emitter.time)
        b.store(b.fmul(number(method.gamma), emitter.h), self._g)
        b.call(self._system.at, [emitter.time, emitter.y, emitter.inputs, self._g, self._memory])
        for stage in range(method.stages):
            if stage > 0:
                stage_slopes(emitter, method, t, stage, self._increments, self._trial, self._slopes)
            right_side(emitter, method, stage, self._increments, self._slopes, None, self._right)
            b.call(self._system.solve, [self._memory, self._right, self._increments[stage]])
        self._emit_estimate(None)
        combine(b, emitter.system.size, emitter.y, emitter.y, None, weighted(method.m, self._increments))
