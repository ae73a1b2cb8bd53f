"""A step of an explicit Runge–Kutta method, as IR."""

from __future__ import annotations

from mbd_sim.compiler.ir.module import Value
from mbd_sim.compiler.ir.vectors import combine, combine_at_once, copy, load, looped, store, weighted
from mbd_sim.compiler.steps.emitter import EmitStep, Prepare, StepEmitter
from mbd_sim.integrators.tableau import Tableau


class ExplicitStep:
    """Emits steps of a tableau; those that are `rare` are shorter code, slower, and without an error estimate."""

    def __init__(self, method: Tableau, emitter: StepEmitter, *, rare: bool = False) -> None:
        """Allocate the arrays; the emitter's builder must be in the entry block of a function."""
        self._method, self._emitter, self._rare = method, emitter, rare
        size = emitter.system.size
        arrays = [emitter.array(size) if rare else emitter.vector() for _ in range(method.stages + 1)]
        self._slopes, self._trial = arrays[1:], arrays[0]
        self._start = emitter.array(size) if rare else emitter.y
        self._emit_estimate = None if rare else emitter.estimator(method.estimate, self._slopes)

    def emit(self, t: Value, first: Value | None = None, target: Value | None = None) -> None:
        """Emit a step of the emitter's y from time t on, into `target`, by default y itself.

        :param first: the slopes at the start of the step, if they are known.
        """
        if not self._rare:
            self._emit(t, first, self._emitter.y if target is None else target)
            return
        b, size, y = self._emitter.b, self._emitter.system.size, self._emitter.y
        copy(b, size, y, self._start)
        if first is not None:
            copy(b, size, first, self._slopes[0])
        with looped(b):
            self._emit(t, None if first is None else self._slopes[0], self._start)
        copy(b, size, self._start, y if target is None else target)

    def _emit(self, t: Value, first: Value | None, target: Value) -> None:
        emitter, method, trial, start = self._emitter, self._method, self._trial, self._start
        system, size = emitter.system, emitter.system.size
        still, unread = system.still | system.held, system.unread | system.held
        k = self._slopes
        if first is not None:
            k[0] = first
        for index in sorted(system.held - system.unread):
            store(emitter.b, load(emitter.b, start, index), trial, index)
        for stage, (weights, c) in enumerate(zip(method.a, method.c, strict=True)):
            stage_time, state = emitter.stage_time(t, c), start
            if any(weights):
                state = trial
                combine_at_once(
                    emitter.b, size, trial, start, emitter.h, weighted(weights, k), still=still, unread=unread
                )
                emitter.project_stage(stage_time, trial)
            if stage or first is None:
                if self._rare:
                    emitter.rates_rarely(stage_time, state, k[stage])
                else:
                    emitter.rates(stage_time, state, k[stage], first=stage == 0)
        if self._emit_estimate is not None:
            self._emit_estimate(emitter.h)
        combine(emitter.b, size, target, start, emitter.h, weighted(method.b, k), still=still)


def explicit_step(method: Tableau) -> Prepare:
    """The step of a tableau, for `emit_advance`."""

    def prepare(emitter: StepEmitter) -> EmitStep:
        return ExplicitStep(method, emitter).emit

    return prepare
