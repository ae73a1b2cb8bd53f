"""A step of a Gauss method, as IR: sweeps over the stages until nothing changes, up to a given number."""

from __future__ import annotations

from mbd_sim.compiler.ir.builder import DOUBLE, integer, number
from mbd_sim.compiler.ir.lanes import LaneBuilder
from mbd_sim.compiler.ir.module import Value
from mbd_sim.compiler.ir.vectors import Index, add_square, combine, copy, for_each, load, store, weighted
from mbd_sim.compiler.steps.emitter import Prepare, StepEmitter
from mbd_sim.integrators.implicit import Gauss

SWEEPS_CONVERGED = 1e-17  # change of the scaled state below which the sweeps have converged
FIRST_SWEEPS = 3  # after these, a change that no longer falls is round-off


def gauss_step(method: Gauss) -> Prepare:
    """The step of a Gauss method, for `emit_advance`.

    Several members are swept together until the last of them has converged; one whose own sweeps have ended keeps its
    slopes, and so gets the same bits as alone.
    """
    return lambda emitter: _GaussStep(method, emitter).step


class _GaussStep:
    """The arrays of a step. Of several members, `swept` marks with 1 those whose sweeps have ended."""

    def __init__(self, method: Gauss, emitter: StepEmitter) -> None:
        self._method, self._emitter = method, emitter
        self._start, self._fresh, self._trial = (emitter.vector(name) for name in ("slopes", "fresh", "trial"))
        self._k = [emitter.vector(f"k{stage + 1}") for stage in range(method.stages)]
        self._change, self._before = emitter.scalar("change"), emitter.scalar("change_before")
        self._emit_estimate = emitter.estimator(method.estimate, [self._start, *self._k])
        self._swept = emitter.scalar() if isinstance(emitter.b, LaneBuilder) else None
        self._last_change = self._change if self._swept is None else emitter.scalar()

    def step(self, t: Value) -> None:
        """Emit the step from time t on."""
        emitter, b, size = self._emitter, self._emitter.b, self._emitter.system.size
        emitter.rates(t, emitter.y, self._start, first=True)
        for slopes in self._k:
            copy(b, size, self._start, slopes)
        b.store(number(0.0), self._change)
        if self._swept is not None:
            b.store(number(0.0), self._swept)

        def sweep(count: Value) -> Value:
            b.store(b.load(self._change, typ=DOUBLE), self._before)
            self._sweep(t)
            return emitter.any(self._goes_on(count))

        b.comment("Sweeps over the stages, until nothing changes beyond round-off.")
        b.repeat(integer(1), sweep)
        self._emit_estimate(emitter.h, emitter.square_root(b.load(self._change, typ=DOUBLE)))
        combine(b, size, emitter.y, emitter.y, emitter.h, weighted(self._method.b, self._k))

    def _sweep(self, t: Value) -> None:
        """Compute each stage from the newest slopes of the others; `_change` is the squared norm of the change."""
        emitter, method, b = self._emitter, self._method, self._emitter.b
        b.store(number(0.0), self._last_change)
        for stage, (weights, c) in enumerate(zip(method.a, method.c, strict=True)):
            stage_time, slopes = b.named(emitter.stage_time(t, c), f"t{stage + 1}"), self._k[stage]
            combine(b, emitter.system.size, self._trial, emitter.y, emitter.h, weighted(weights, self._k))
            emitter.project_stage(stage_time, self._trial)
            emitter.rates(stage_time, self._trial, self._fresh)

            def component(i: Index, slopes: Value = slopes) -> None:
                moved = b.fmul(emitter.h, b.fsub(load(b, self._fresh, i), load(b, slopes, i)))
                add_square(b, self._last_change, b.fmul(moved, emitter.scale(i)))
                self._replace(self._fresh, slopes, i)

            for_each(b, emitter.system.size, component)
        if self._swept is not None:
            self._replace(self._last_change, self._change, 0)

    def _replace(self, newest: Value, array: Value, index: Index) -> None:
        """Replace a component of an array by the newest one, but for members whose sweeps have ended."""
        b, value = self._emitter.b, load(self._emitter.b, newest, index)
        if self._swept is not None:
            ended = b.fcmp_ordered("!=", b.load(self._swept, typ=DOUBLE), number(0.0))
            value = b.select(ended, load(b, array, index), value)
        store(b, value, array, index)

    def _goes_on(self, count: Value) -> Value:
        """Whether the sweep of this number is followed by another one, for each member."""
        b = self._emitter.b
        moved = b.load(self._change, typ=DOUBLE)
        not_converged = b.fcmp_ordered(">", moved, number(SWEEPS_CONVERGED**2))
        falling = b.fcmp_ordered("<", moved, b.load(self._before, typ=DOUBLE))
        early = b.icmp_signed("<=", count, integer(FIRST_SWEEPS))
        allowed = b.or_(falling, early)
        more = b.and_(b.and_(not_converged, allowed), b.icmp_signed("<", count, integer(self._method.sweeps)))
        if self._swept is not None:
            more = b.and_(more, b.fcmp_ordered("==", b.load(self._swept, typ=DOUBLE), number(0.0)))
            b.store(b.select(more, number(0.0), number(1.0)), self._swept)
        return more
