"""The slopes of earlier steps that an Adams method uses, as IR."""

from __future__ import annotations

from collections.abc import Sequence

from mbd_sim.compiler.ir.builder import DOUBLE, FALSE, TRUE, IRBuilder, element, integer, number
from mbd_sim.compiler.ir.lanes import LaneBuilder
from mbd_sim.compiler.ir.module import Value
from mbd_sim.compiler.ir.vectors import (
    Index,
    cells,
    copy,
    each_component,
    folded,
    for_each,
    load,
    looped,
    store,
    total,
    weighted,
)
from mbd_sim.compiler.steps.emitter import StepEmitter
from mbd_sim.integrators.explicit import PARTS, Adams

COUNT, LEVEL, WAIT, PAUSE, NEXT, SIZE, VECTORS = range(7)  # the numbers at the start of a history


class AdamsHistory:
    """The slopes of the last steps, and what they belong to, in memory behind the inputs of the system.

    First is the state of the policy (`AdamsPolicy`): `COUNT`, `LEVEL`, `WAIT` and `PAUSE`; then the number `NEXT` and
    the `SIZE` in s of the step that follows. Then come the state and the inputs at its start, the round-off of that
    state (see `lost`), and the slopes: those at the start of step k have the place 4 k of a ring, and those at its
    quarters the places 4 k + 1 to 4 k + 3.

    They count as none if that step, its size, the state or an input has changed in the meantime, for example by a
    command. So whoever sets a state or an input need not know of the history. `lost` (n,) is a copy during a call, and
    a single step replaces only slopes that its repetition would not use. So a call that fails leaves the history as it
    was, if one of several steps puts the slopes back.
    """

    def __init__(self, emitter: StepEmitter, method: Adams, counters: Sequence[Value]) -> None:
        """Allocate the arrays; the emitter's builder must be in the entry block of a function."""
        self._emitter, self._method, self._places = emitter, method, PARTS * method.length
        b, size, inputs_size = emitter.b, emitter.system.size, emitter.system.inputs_size
        self._start = element(b, emitter.inputs, inputs_size) if emitter.history is None else emitter.history
        self._kept_y = b.named(element(b, self._start, VECTORS), "kept_state")
        self._kept_inputs = b.named(element(b, self._start, VECTORS + size), "kept_inputs")
        self._kept_lost = b.named(element(b, self._start, VECTORS + size + inputs_size), "kept_lost")
        self.lost = emitter.array(size, "lost")
        self._slopes = b.named(element(b, self._start, VECTORS + inputs_size + 2 * size), "slopes")
        self._total = method.history_size(size, inputs_size)
        self._now = integer(0)  # the first number of the slopes of the present step, from the first of all slopes on
        self._backup = None if isinstance(b, LaneBuilder) else emitter.array(self._total)
        self._changes = emitter.array(cells(b, max(size, inputs_size)), "changes")
        self._counters = tuple(zip(counters, (COUNT, LEVEL, WAIT, PAUSE), strict=True))
        self.belongs: Value = FALSE
        emitter.kept = self

    def begin_step(self) -> None:
        """Emit where the slopes of a step that begins are in the ring, which all others in the ring follow."""
        b, size = self._emitter.b, self._emitter.system.size
        place = b.urem(self._emitter.index, integer(self._method.length))
        self._now = b.named(b.mul(place, integer(PARTS * size)), "now")

    def slopes(self, quarters: Index) -> Value:
        """The address of the slopes so many `quarters` of a step after its start, or before, if negative."""
        b, size = self._emitter.b, self._emitter.system.size
        places, ring = integer(self._places), integer(self._places * size)
        if isinstance(quarters, int):
            after = integer(quarters % self._places * size)
        else:
            after = b.mul(b.urem(b.add(quarters, places), places), integer(size))
        place = b.add(self._now, after)
        place = b.select(b.icmp_unsigned(">=", place, ring), b.sub(place, ring), place)
        return element(b, self._slopes, place)

    def refine(self, condition: Value, stride: Value, newest: Value) -> None:
        """Interpolate slopes halfway between those that are so many quarters apart, where a condition holds.

        :param newest: the slopes that follow those at the start of the step.
        """
        b, size, method = self._emitter.b, self._emitter.system.size, self._method
        b.comment("Slopes halfway between those that are known.")
        half = b.lshr(stride, integer(1))
        places = [b.mul(stride, integer(-back)) for back in range(method.length)]
        nodes = [newest, *(b.named(self.slopes(place), f"node{back}") for back, place in enumerate(places))]
        targets = [
            b.named(self.slopes(b.sub(place, half)), f"between{back}")
            for back, (place, _) in enumerate(zip(places, method.midpoints, strict=False))
        ]

        def component(i: Index) -> None:
            for target, weights in zip(targets, method.midpoints, strict=True):
                value = total(b, weighted(weights, nodes), i)
                store(b, b.select(condition, value, load(b, target, i)), target, i)

        with looped(b):
            for_each(b, size, component)

    def begin(self) -> None:
        """Read the history if it belongs to this state."""
        emitter, b, size = self._emitter, self._emitter.b, self._emitter.system.size
        if self._backup is not None:
            with b.if_then(self._may_need_backup()):
                self._copy_rarely(self._start, self._backup)
        b.comment("Slopes count only if they belong to this step, state and inputs.")
        same = b.fcmp_ordered("==", load(b, self._start, NEXT), b.sitofp(emitter.index, DOUBLE))
        same = b.and_(same, b.fcmp_ordered("==", load(b, self._start, SIZE), emitter.h))
        same = b.and_(same, self._equal(size, self._kept_y, emitter.y))
        same = b.and_(same, self._equal(emitter.system.inputs_size, self._kept_inputs, emitter.inputs))
        same = self.belongs = b.named(same, "same")
        zero = number(0.0)
        for address, index in self._counters:
            b.store(b.select(same, load(b, self._start, index), zero), address)
        each_component(b, size, lambda w, i: store(w, w.select(same, load(w, self._kept_lost, i), zero), self.lost, i))

    def _may_need_backup(self) -> Value:
        return self._emitter.b.icmp_unsigned("!=", self._emitter.steps, integer(1))

    def _copy_rarely(self, source: Value, target: Value) -> None:
        """Copy a whole history number by number, which is short code."""
        b = self._emitter.b
        for_each(b, self._total, lambda i: store(b, load(b, source, i), target, i))

    def _equal(self, size: int, kept: Value, present: Value) -> Value:
        """Whether two arrays, of at least one number if they are small, are equal."""
        b, one = self._emitter.b, number(1.0)
        if 0 < size <= b.unrolled:
            same = [b.fcmp_ordered("==", load(b, kept, i), load(b, present, i)) for i in range(size)]
            while len(same) > 1:
                same = [b.and_(*pair) for pair in zip(same[::2], same[1::2], strict=False)] + same[len(same) & ~1 :]
            return same[0]

        def changes(w: IRBuilder, before: Value, i: Index) -> Value:
            return w.select(w.fcmp_unordered("!=", load(w, kept, i), load(w, present, i)), one, before)

        return b.fcmp_ordered("==", folded(b, size, self._changes, changes), number(0.0))

    def end(self, finite: Value) -> None:
        """Say what the history belongs to; where the new state is not finite, restore it."""
        b = self._emitter.b
        if self._backup is None or finite == TRUE:
            self._keep()
            return
        with b.if_else(finite, likely=True) as (kept, failed):
            with kept:
                self._keep()
            with failed, b.if_then(self._may_need_backup()):
                self._copy_rarely(self._backup, self._start)

    def _keep(self) -> None:
        emitter, b, size = self._emitter, self._emitter.b, self._emitter.system.size
        b.comment("What the slopes belong to.")
        for address, index in self._counters:
            store(b, b.load(address, typ=DOUBLE), self._start, index)
        store(b, b.sitofp(emitter.index, DOUBLE), self._start, NEXT)
        store(b, emitter.h, self._start, SIZE)
        copy(b, size, emitter.y, self._kept_y)
        copy(b, emitter.system.inputs_size, emitter.inputs, self._kept_inputs)
        copy(b, size, self.lost, self._kept_lost)
