"""A step of an explicit Runge–Kutta method, as IR."""

from __future__ import annotations

from mbd_sim.compiler.ir import Value
from mbd_sim.compiler.ir_vectors import combine, combine_at_once, load, store, weighted
from mbd_sim.compiler.step_emitter import EmitStep, Prepare, StepEmitter
from mbd_sim.integrators.tableau import Tableau


class ExplicitStep:
    """Emits steps of a tableau."""

    def __init__(self, method: Tableau, emitter: StepEmitter) -> None:
        """Allocate the arrays; the emitter's builder must be in the entry block of a function."""
        self._method, self._emitter = method, emitter
        self._slopes, self._trial = [emitter.vector() for _ in range(method.stages)], emitter.vector()
        self._emit_estimate = emitter.estimator(method.estimate, self._slopes)

    def emit(self, t: Value, first: Value | None = None, target: Value | None = None) -> None:
        """Emit a step of the emitter's y from time t on, into `target`, by default y itself.

        :param first: the slopes at the start of the step, if they are known.
        """
        emitter, method, trial = self._emitter, self._method, self._trial
        system, size, y = emitter.system, emitter.system.size, emitter.y
        still, unread = system.still | system.held, system.unread | system.held
        k = self._slopes
        if first is not None:
            k[0] = first
        for index in sorted(system.held - system.unread):
            store(emitter.b, load(emitter.b, y, index), trial, index)
        for stage, (weights, c) in enumerate(zip(method.a, method.c, strict=True)):
            stage_time, state = emitter.stage_time(t, c), y
            if any(weights):
                state = trial
                combine_at_once(emitter.b, size, trial, y, emitter.h, weighted(weights, k), still=still, unread=unread)
                emitter.project_stage(stage_time, trial)
            if stage or first is None:
                emitter.rates(stage_time, state, k[stage], first=stage == 0)
        self._emit_estimate(emitter.h)
        combine(emitter.b, size, y if target is None else target, y, emitter.h, weighted(method.b, k), still=still)


def explicit_step(method: Tableau) -> Prepare:
    """The step of a tableau, for `emit_advance`."""

    def prepare(emitter: StepEmitter) -> EmitStep:
        return ExplicitStep(method, emitter).emit

    return prepare
