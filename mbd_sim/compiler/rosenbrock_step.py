"""A step of a Rosenbrock method, as IR: one derivative and one factorization, then a solution for each stage."""

from __future__ import annotations

import llvmlite.ir as ir

from mbd_sim.compiler.dense_solver import emit_dense_solver
from mbd_sim.compiler.ir_types import local_array, number
from mbd_sim.compiler.ir_vectors import (
    Index,
    combine,
    each,
    load,
    store,
    total,
    weighted,
)
from mbd_sim.compiler.linearized_system import Linearized
from mbd_sim.compiler.lowering import lower
from mbd_sim.compiler.runge_kutta_step import explicit_step
from mbd_sim.compiler.stepping import Frame, Prepare, Step
from mbd_sim.integrators.rosenbrock import Rosenbrock
from mbd_sim.integrators.tableau import EXPLICIT


def rosenbrock_step(method: Rosenbrock, linearized: Linearized) -> Prepare:
    """The step of a Rosenbrock method, for `emit_advance`.

    Where the system asks for stages to be settled, its derivative across the constraints is without bound, and means
    nothing for the motion along them. Such a step is taken by RK4.
    """
    core = linearized.expand.nnz_in(2)

    def prepare(frame: Frame) -> Step:
        b, size = frame.b, frame.system.size
        linearize, reduce, expand = (
            lower(b.module, function, inline=False)
            for function in (linearized.at, linearized.reduce, linearized.expand)
        )
        solver = emit_dense_solver(b.module, core)
        increments = [frame.vector() for _ in range(method.stages)]
        trial, slopes, right, time_rates = (frame.vector() for _ in range(4))
        memory, matrix = local_array(b, linearized.at.nnz_out(0)), local_array(b, core * core)
        rows, small, solution = (local_array(b, core) for _ in range(3))
        g = frame.scalar()
        estimate = frame.estimator(method.estimate, increments)
        explicit = explicit_step(EXPLICIT["rk4"])(frame) if frame.system.judging else lambda t: None

        def right_side(stage: int) -> None:
            """γ (h f + Σ g U + d h² f_t)."""
            sums = weighted(method.g[stage], increments)
            turning = 0.0 if linearized.timeless else method.d[stage]
            squared = b.fmul(number(turning), b.fmul(frame.h, frame.h)) if turning else None

            def component(i: Index) -> None:
                value = b.fmul(frame.h, load(b, slopes, i))
                if sums:
                    value = b.fadd(value, total(b, sums, i))
                if squared is not None:
                    value = b.fadd(value, b.fmul(squared, load(b, time_rates, i)))
                store(b, b.fmul(number(method.gamma), value), right, i)

            each(b, size, component)

        def implicit(t: ir.Value) -> None:
            b.store(t, frame.time)
            b.store(b.fmul(number(method.gamma), frame.h), g)
            b.call(linearize, [frame.time, frame.y, frame.inputs, g, memory, matrix, time_rates])
            b.call(solver.factorize, [matrix, rows])
            for stage in range(method.stages):
                if stage > 0:
                    moment, at = frame.later(t, method.c[stage]), frame.y
                    if any(method.a[stage]):
                        at = trial
                        combine(b, size, trial, frame.y, None, weighted(method.a[stage], increments))
                    frame.rates(moment, at, slopes)
                right_side(stage)
                b.call(reduce, [memory, right, small])
                b.call(solver.solve, [matrix, rows, small, solution])
                b.call(expand, [memory, right, solution, increments[stage]])
            estimate(None)
            combine(b, size, frame.y, frame.y, None, weighted(method.m, increments))

        def step(t: ir.Value) -> None:
            frame.rates(t, frame.y, slopes, first=True)
            if not frame.system.judging:
                implicit(t)
                return
            with b.if_else(frame.asked_to_settle(), likely=False) as (doubtful, good):
                with doubtful:
                    explicit(t)
                with good:
                    implicit(t)

        return step

    return prepare
