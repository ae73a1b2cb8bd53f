"""The expansion that a Taylor method keeps between calls, as IR."""

from __future__ import annotations

from functools import partial

from mbd_sim.compiler.ir.module import Value
from mbd_sim.compiler.ir.types import DOUBLE, INT, element, integer, number
from mbd_sim.compiler.ir.vectors import copy, load, loop, store
from mbd_sim.compiler.steps.emitter import StepEmitter
from mbd_sim.integrators.taylor import Taylor

SPAN, POSITION, NEXT, SIZE, VECTORS = range(5)  # the numbers at the start of a history


class TaylorHistory:
    """The coefficients of an expansion and what they belong to, in memory behind the inputs of the system.

    First are the number of steps for which the expansion holds (`SPAN`), how many of them were taken (`POSITION`), and
    the number `NEXT` and the `SIZE` in s of the step that follows. Then come the state and the inputs at its start, and
    the coefficients.

    They count as used up if that step, its size, the state or an input has changed in the meantime, for example by a
    command. So whoever sets a state or an input need not know of the history.

    A new expansion is written into memory of the call, `fresh`, and kept only if the new state is finite.
    """

    def __init__(self, emitter: StepEmitter, method: Taylor) -> None:
        """Allocate the arrays; the emitter's builder must be in the entry block of a function."""
        b, size, inputs_size = emitter.b, emitter.system.size, emitter.system.inputs_size
        self._emitter, self._count = emitter, (1 + method.order) * size
        self._start = element(b, emitter.inputs, inputs_size)
        self._kept_y, self._kept_inputs = element(b, self._start, VECTORS), element(b, self._start, VECTORS + size)
        self._kept = element(b, self._start, VECTORS + size + inputs_size)
        self.fresh, self._changed = emitter.array(self._count), emitter.scalar()
        self.span, self.position, self.is_fresh = (b.alloca(INT) for _ in range(3))

    def begin(self) -> None:
        """Read the history if it belongs to this state; otherwise the expansion is used up."""
        emitter, b = self._emitter, self._emitter.b
        b.store(number(0.0), self._changed)
        self._compare(load(b, self._start, NEXT), b.sitofp(emitter.index, DOUBLE))
        self._compare(load(b, self._start, SIZE), emitter.h)
        for size, kept, present in (
            (emitter.system.size, self._kept_y, emitter.y),
            (emitter.system.inputs_size, self._kept_inputs, emitter.inputs),
        ):
            loop(b, 0, size, partial(self._compare_entry, kept, present))
        same = b.fcmp_ordered("==", b.load(self._changed, typ=DOUBLE), number(0.0))
        for address, index in ((self.span, SPAN), (self.position, POSITION)):
            b.store(b.select(same, b.fptosi(load(b, self._start, index), INT), integer(0)), address)
        b.store(integer(0), self.is_fresh)

    def coefficients(self) -> Value:
        """The address of the coefficients, c_0 first."""
        is_fresh = self._emitter.b.icmp_signed("!=", self._emitter.b.load(self.is_fresh, typ=INT), integer(0))
        return self._emitter.b.select(is_fresh, self.fresh, self._kept)

    def replace(self, span: Value) -> None:
        """Emit the beginning of the expansion in `fresh`, which holds for a number of steps."""
        b = self._emitter.b
        b.store(span, self.span)
        b.store(integer(0), self.position)
        b.store(integer(1), self.is_fresh)

    def clear(self) -> None:
        """Emit that there is no expansion, with the same numbers however the steps are divided into calls."""
        b = self._emitter.b
        loop(b, 0, self._count, lambda i: store(b, number(0.0), self.fresh, i))
        self.replace(integer(0))

    def end(self) -> None:
        """Say what the history belongs to, after steps to a finite state."""
        emitter, b = self._emitter, self._emitter.b
        with b.if_then(b.icmp_signed("!=", b.load(self.is_fresh, typ=INT), integer(0))):
            copy(b, self._count, self.fresh, self._kept)
        for address, index in ((self.span, SPAN), (self.position, POSITION)):
            store(b, b.sitofp(b.load(address, typ=INT), DOUBLE), self._start, index)
        store(b, b.sitofp(emitter.index, DOUBLE), self._start, NEXT)
        store(b, emitter.h, self._start, SIZE)
        copy(b, emitter.system.size, emitter.y, self._kept_y)
        copy(b, emitter.system.inputs_size, emitter.inputs, self._kept_inputs)

    def _compare_entry(self, kept: Value, present: Value, index: Value) -> None:
        self._compare(load(self._emitter.b, kept, index), load(self._emitter.b, present, index))

    def _compare(self, kept: Value, present: Value) -> None:
        b = self._emitter.b
        changed = b.fcmp_unordered("!=", kept, present)
        b.store(b.select(changed, number(1.0), b.load(self._changed, typ=DOUBLE)), self._changed)
