"""A step of a Rosenbrock method, as IR: one derivative and one factorization, then a linear solve for each stage."""

from __future__ import annotations

from collections.abc import Sequence

from mbd_sim.compiler.dense_solver import emit_dense_solver
from mbd_sim.compiler.ir import Value
from mbd_sim.compiler.ir_types import local_array, number
from mbd_sim.compiler.ir_vectors import (
    Index,
    combine,
    copy,
    for_each,
    load,
    store,
    total,
    weighted,
)
from mbd_sim.compiler.linearized_system import Linearized
from mbd_sim.compiler.lowering import lower
from mbd_sim.compiler.runge_kutta_step import explicit_step
from mbd_sim.compiler.simd_builder import LaneBuilder, lanes_of
from mbd_sim.compiler.step_emitter import EmitStep, Prepare, StepEmitter
from mbd_sim.integrators.rosenbrock import Rosenbrock
from mbd_sim.integrators.tableau import EXPLICIT


def rosenbrock_step(method: Rosenbrock, linearized: Linearized) -> Prepare:
    """The step of a Rosenbrock method, for `emit_advance`.

    In steps that start with ill-conditioned constraints the derivative across the constraints is unbounded, and says
    nothing about the motion along them. Such a step is taken by RK4.
    """
    return lambda emitter: _RosenbrockStep(method, linearized, emitter).step


class _RosenbrockStep:
    """The functions and the arrays of a Rosenbrock step."""

    def __init__(self, method: Rosenbrock, linearized: Linearized, emitter: StepEmitter) -> None:
        b, core = emitter.b, linearized.expand.nnz_in(2)
        self._method, self._emitter, self._timeless = method, emitter, linearized.timeless
        self._linearize, self._reduce, self._expand = (
            lower(b.module, function, inline=False, lanes=lanes_of(b))
            for function in (linearized.at, linearized.reduce, linearized.expand)
        )
        self._solver = emit_dense_solver(b.module, core, lanes=lanes_of(b))
        self._increments = [emitter.vector() for _ in range(method.stages)]
        self._trial, self._slopes, self._right, self._time_rates = (emitter.vector() for _ in range(4))
        self._memory, self._matrix = local_array(b, linearized.at.nnz_out(0)), local_array(b, core * core)
        self._rows, self._small, self._solution = (local_array(b, core) for _ in range(3))
        self._g = emitter.scalar()
        self._emit_estimate = emitter.estimator(method.estimate, self._increments)
        self._explicit = explicit_step(EXPLICIT["rk4"])(emitter) if emitter.system.reports_conditioning else None
        if isinstance(b, LaneBuilder):
            self._explicit_y, self._explicit_error = emitter.vector(), emitter.scalar()

    def step(self, t: Value) -> None:
        """Emit the step from time t on."""
        emitter = self._emitter
        emitter.rates(t, emitter.y, self._slopes, first=True)
        if self._explicit is None:
            self._implicit(t)
            return
        if isinstance(emitter.b, LaneBuilder):
            self._members(t, emitter.b, self._explicit)
            return
        with emitter.b.if_else(emitter.is_ill_conditioned(), likely=False) as (ill_conditioned, otherwise):
            with ill_conditioned:
                self._explicit(t)
            with otherwise:
                self._implicit(t)

    def _members(self, t: Value, b: LaneBuilder, explicit: EmitStep) -> None:
        """Take the step both ways if any member needs RK4, and give each member the one it takes alone."""
        emitter, size = self._emitter, self._emitter.system.size
        y, error, explicit_y, explicit_error = emitter.y, emitter.largest_error, self._explicit_y, self._explicit_error
        condition = emitter.is_ill_conditioned()
        any_condition = b.any_lane(condition)

        def exchange(one: Value, other: Value, index: Index) -> None:
            first, second = load(b, one, index), load(b, other, index)
            store(b, second, one, index)
            store(b, first, other, index)

        def selected(one: Value, other: Value, index: Index) -> None:
            store(b, b.select(condition, load(b, one, index), load(b, other, index)), other, index)

        with b.if_then(any_condition, likely=False):
            copy(b, size, y, explicit_y)
            copy(b, 1, error, explicit_error)
            explicit(t)
            for_each(b, size, lambda i: exchange(y, explicit_y, i))
            exchange(error, explicit_error, 0)
        self._implicit(t)
        with b.if_then(any_condition, likely=False):
            for_each(b, size, lambda i: selected(explicit_y, y, i))
            selected(explicit_error, error, 0)

    def _implicit(self, t: Value) -> None:
        """Linearize, factorize, and solve for the increment of each stage."""
        emitter, method, b = self._emitter, self._method, self._emitter.b
        b.store(t, emitter.time)
        b.store(b.fmul(number(method.gamma), emitter.h), self._g)
        outputs = [self._memory, self._matrix, self._time_rates]
        b.call(self._linearize, [emitter.time, emitter.y, emitter.inputs, self._g, *outputs])
        b.call(self._solver.factorize, [self._matrix, self._rows])
        for stage in range(method.stages):
            if stage > 0:
                stage_slopes(emitter, method, t, stage, self._increments, self._trial, self._slopes)
            time_rates = None if self._timeless else self._time_rates
            right_side(emitter, method, stage, self._increments, self._slopes, time_rates, self._right)
            b.call(self._reduce, [self._memory, self._right, self._small])
            b.call(self._solver.solve, [self._matrix, self._rows, self._small, self._solution])
            b.call(self._expand, [self._memory, self._right, self._solution, self._increments[stage]])
        self._emit_estimate(None)
        combine(b, emitter.system.size, emitter.y, emitter.y, None, weighted(method.m, self._increments))


def stage_slopes(
    emitter: StepEmitter,
    method: Rosenbrock,
    t: Value,
    stage: int,
    increments: Sequence[Value],
    trial: Value,
    slopes: Value,
) -> None:
    """Emit `slopes` = f(t + c h, y + Σ a U) of a stage; `trial` receives the state."""
    weights = method.a[stage]
    time, state = emitter.stage_time(t, method.c[stage]), emitter.y
    if any(weights):
        state, terms = trial, weighted(weights, increments)
        combine(emitter.b, emitter.system.size, state, emitter.y, None, terms)
    emitter.rates(time, state, slopes)


def right_side(
    emitter: StepEmitter,
    method: Rosenbrock,
    stage: int,
    increments: Sequence[Value],
    slopes: Value,
    time_rates: Value | None,
    right: Value,
) -> None:
    """Emit `right` = γ (h f + Σ g U + d h² f_t) of a stage; f_t is zero if `time_rates` is None."""
    b = emitter.b
    sums = weighted(method.g[stage], increments)
    d = 0.0 if time_rates is None else method.d[stage]
    d_h_squared = b.fmul(number(d), b.fmul(emitter.h, emitter.h)) if d else None

    def component(i: Index) -> None:
        value = b.fmul(emitter.h, load(b, slopes, i))
        if sums:
            value = b.fadd(value, total(b, sums, i))
        if time_rates is not None and d_h_squared is not None:
            value = b.fadd(value, b.fmul(d_h_squared, load(b, time_rates, i)))
        store(b, b.fmul(number(method.gamma), value), right, i)

    for_each(b, emitter.system.size, component)
