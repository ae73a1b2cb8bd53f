"""A step of an explicit Runge–Kutta method, as IR."""

from __future__ import annotations

import llvmlite.ir as ir

from mbd_sim.compiler.ir_vectors import combine, combine_at_once, weighted
from mbd_sim.compiler.stepping import Frame, Prepare, Step
from mbd_sim.integrators.tableau import Tableau


def explicit_step(method: Tableau) -> Prepare:
    """The step of a tableau, for `emit_advance`."""

    def prepare(frame: Frame) -> Step:
        k, trial = [frame.vector() for _ in range(method.stages)], frame.vector()
        estimate = frame.estimator(method.estimate, k)
        size, y = frame.system.size, frame.y

        def step(t: ir.Value) -> None:
            for stage, (weights, c) in enumerate(zip(method.a, method.c, strict=True)):
                moment, at = frame.later(t, c), y
                if any(weights):
                    at = trial
                    combine_at_once(frame.b, size, trial, y, frame.h, weighted(weights, k))
                    frame.settle_stage(moment, trial)
                frame.rates(moment, at, k[stage], first=stage == 0)
            estimate(frame.h)
            combine(frame.b, size, y, y, frame.h, weighted(method.b, k))

        return step

    return prepare
