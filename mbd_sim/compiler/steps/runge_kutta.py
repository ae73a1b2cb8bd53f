"""A step of an explicit Runge–Kutta method, as IR."""

from __future__ import annotations

from mbd_sim.compiler.ir.builder import DOUBLE
from mbd_sim.compiler.ir.lanes import lanes_of, new_builder
from mbd_sim.compiler.ir.module import BOOL, POINTER, VOID, Function, FunctionType, Value
from mbd_sim.compiler.ir.vectors import combine, combine_at_once, copy, load, store, weighted
from mbd_sim.compiler.steps.emitter import EmitStep, Prepare, StepEmitter
from mbd_sim.integrators.explicit import Tableau


class ExplicitStep:
    """Emits steps of a tableau."""

    def __init__(self, method: Tableau, emitter: StepEmitter) -> None:
        """Allocate the arrays; the emitter's builder must be in the entry block of a function."""
        self._method, self._emitter = method, emitter
        self._slopes = [emitter.vector(f"k{stage + 1}") for stage in range(method.stages)]
        self._trial = emitter.vector("trial")
        self._emit_estimate = emitter.estimator(method.estimate, self._slopes)

    def emit(self, t: Value, first: Value | None = None) -> None:
        """Emit a step of the emitter's y from time t on.

        :param first: the slopes at the start of the step, if they are known.
        """
        emitter, method, trial, y = self._emitter, self._method, self._trial, self._emitter.y
        system, size = emitter.system, emitter.system.size
        still, unread = system.still | system.held, system.unread | system.held
        k = self._slopes
        if first is not None:
            k[0] = first
        for index in sorted(system.held - system.unread):
            store(emitter.b, load(emitter.b, y, index), trial, index)
        for stage, (weights, c) in enumerate(zip(method.a, method.c, strict=True)):
            stage_time, state = emitter.b.named(emitter.stage_time(t, c), f"t{stage + 1}"), y
            if any(weights):
                state = trial
                combine_at_once(emitter.b, size, trial, y, emitter.h, weighted(weights, k), still=still, unread=unread)
                emitter.project_stage(stage_time, trial)
            if stage or first is None:
                emitter.rates(stage_time, state, k[stage], first=stage == 0)
        self._emit_estimate(emitter.h)
        combine(emitter.b, size, y, y, emitter.h, weighted(method.b, k), still=still)


class CalledStep:
    """Calls of a function `advance_METHOD(t, h, y, inputs, k1 …)`, a step from known slopes k1.

    Arrays whose address is passed to a call cannot be kept in registers, so such a state is copied.
    """

    def __init__(self, method: Tableau, emitter: StepEmitter) -> None:
        """Allocate the arrays; the emitter's builder must be in the entry block of a function."""
        self._method, self._emitter = method, emitter
        self._state = emitter.array(emitter.system.size)
        self._slopes = emitter.array(emitter.system.size)

    def emit(self, t: Value, slopes: Value, state: Value | None = None) -> None:
        """Emit a step of a state, by default the emitter's y, from time t on."""
        emitter, b, size = self._emitter, self._emitter.b, self._emitter.system.size
        state = emitter.y if state is None else state
        more = [emitter.conditioning] if emitter.system.reports_conditioning else []
        more += [emitter.is_estimated, emitter.largest_error] if emitter.estimates else []
        own, first = state, slopes
        if emitter.system.in_registers:
            own, first = self._state, self._slopes
            copy(b, size, state, own)
            copy(b, size, slopes, first)
        b.call(self._function(), [t, emitter.h, own, emitter.inputs, first, *more])
        if own is not state:
            copy(b, size, own, state)

    def _function(self) -> Function:
        """The function, which is emitted once."""
        method, outer, module = self._method, self._emitter, self._emitter.b.module
        name = "_".join(filter(None, ("advance", method.name, outer.system.name)))
        if name in module.functions:
            return module.functions[name]
        names, types = ["t", "h", "y", "in", "k1"], [DOUBLE] * 2 + [POINTER] * 3
        if outer.system.reports_conditioning:
            names, types = [*names, "margin"], [*types, POINTER]
        if outer.estimates:
            names, types = [*names, "is_estimated", "largest_error"], [*types, BOOL, POINTER]
        function = Function(module, FunctionType(VOID, types), name, names)
        function.about = f"A step of {method.name}, order {method.order}, from time t on, with the slopes k1 at t."
        function.linkage, function.attributes, function.noalias = "internal", ["noinline"], True
        t, h, y, inputs, slopes, *more = function.args
        b = new_builder(function.append_basic_block("entry"), lanes_of(outer.b))
        emitter = StepEmitter(b, outer.system, inputs, h, y, estimates=outer.estimates, short=outer.short)
        if outer.system.reports_conditioning:
            emitter.conditioning = more.pop(0)
        if outer.estimates:
            emitter.is_estimated, emitter.largest_error = more
        ExplicitStep(method, emitter).emit(t, slopes)
        b.ret_void()
        return function


def explicit_step(method: Tableau) -> Prepare:
    """The step of a tableau, for `emit_advance`; in code that is short or not fast, it is a function of its own."""

    def prepare(emitter: StepEmitter) -> EmitStep:
        if emitter.b.module.fast and not emitter.short:
            return ExplicitStep(method, emitter).emit
        step, slopes = CalledStep(method, emitter), emitter.vector("k1")

        def emit(t: Value) -> None:
            emitter.rates(t, emitter.y, slopes, first=True)
            step.emit(t, slopes)

        return emit

    return prepare
