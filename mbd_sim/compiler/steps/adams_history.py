"""The slopes of earlier steps that an Adams method uses, as IR."""

from __future__ import annotations

from mbd_sim.compiler.ir.builder import IRBuilder
from mbd_sim.compiler.ir.lanes import LaneBuilder
from mbd_sim.compiler.ir.module import Value
from mbd_sim.compiler.ir.types import DOUBLE, element, integer, number
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
from mbd_sim.integrators.adams import PARTS, Adams

COUNT, LEVEL, WAIT, PAUSE, NEXT, SIZE, VECTORS = range(7)  # the numbers at the start of a history
FINEST = PARTS.bit_length() - 1  # the level of the smallest parts of a step
DIVIDED = 5  # instructions of a rate on average, from which on parts of a step cost less than the other method


def finest_level(instructions: int, size: int) -> int:
    """The level of the smallest parts in which a step is taken, for `size` rates of `instructions` together."""
    return FINEST if instructions >= DIVIDED * size else 0


class AdamsHistory:
    """The slopes of the last steps, and what they belong to, in memory behind the inputs of the system.

    Steps of `LEVEL` 0 are taken at once, those of 1 in halves and those of 2 in quarters. First are the number `COUNT`
    of consecutive slopes that are known at the distance of these parts, the level, the steps to `WAIT` before the next
    attempt, the `PAUSE` if that fails, and the number `NEXT` and the `SIZE` in s of the step that follows. Then come
    the state and the inputs at its start, the round-off of that state (see `lost`), and the slopes: those at the start
    of step k have the place 4 k of a ring, and those at its quarters the places 4 k + 1 to 4 k + 3.

    They count as none if that step, its size, the state or an input has changed in the meantime, for example by a
    command. So whoever sets a state or an input need not know of the history.
    """

    def __init__(self, emitter: StepEmitter, method: Adams) -> None:
        """Allocate the arrays; the emitter's builder must be in the entry block of a function."""
        self._emitter, self._method, self._places = emitter, method, PARTS * method.length
        b, size, inputs_size = emitter.b, emitter.system.size, emitter.system.inputs_size
        self._start = element(b, emitter.inputs, inputs_size)
        self._kept_y, self._kept_inputs = element(b, self._start, VECTORS), element(b, self._start, VECTORS + size)
        self.lost = element(b, self._start, VECTORS + size + inputs_size)
        self._first_slope = VECTORS + inputs_size + 2 * size
        self._total = method.history_size(size, inputs_size)
        self._now = integer(0)  # the first number of the slopes of the present step, from the first of all slopes on
        self._backup = None if isinstance(b, LaneBuilder) else emitter.array(self._total)
        self.count, self.level, self.wait, self.pause = (emitter.scalar() for _ in range(4))
        self._changes = emitter.array(cells(b, max(size, inputs_size)))
        addresses = (self.count, self.level, self.wait, self.pause)
        self._counters = tuple(zip(addresses, (COUNT, LEVEL, WAIT, PAUSE), strict=True))
        emitter.begin, emitter.end = self._emit_begin, self._emit_end

    def begin_step(self) -> None:
        """Emit where the slopes of a step that begins are in the ring, which all others in the ring follow."""
        b, size = self._emitter.b, self._emitter.system.size
        place = b.urem(self._emitter.index, integer(self._method.length))
        self._now = b.mul(place, integer(PARTS * size))

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
        return element(b, self._start, b.add(integer(self._first_slope), place))

    def refine(self, condition: Value, stride: Value, newest: Value) -> None:
        """Interpolate slopes halfway between those that are so many quarters apart, where a condition holds.

        :param newest: the slopes that follow those at the start of the step.
        """
        b, size, method = self._emitter.b, self._emitter.system.size, self._method
        half = b.lshr(stride, integer(1))
        places = [b.mul(stride, integer(-back)) for back in range(method.length)]
        nodes = [newest, *map(self.slopes, places)]
        targets = [self.slopes(b.sub(place, half)) for place, _ in zip(places, method.midpoints, strict=False)]

        def component(i: Index) -> None:
            for target, weights in zip(targets, method.midpoints, strict=True):
                value = total(b, weighted(weights, nodes), i)
                store(b, b.select(condition, value, load(b, target, i)), target, i)

        with looped(b):
            for_each(b, size, component)

    def _emit_begin(self) -> None:
        """Read the history if it belongs to this state."""
        emitter, b, size = self._emitter, self._emitter.b, self._emitter.system.size
        if self._backup is not None:
            with b.if_then(self._may_need_backup()):
                self._copy_rarely(self._start, self._backup)
        same = b.fcmp_ordered("==", load(b, self._start, NEXT), b.sitofp(emitter.index, DOUBLE))
        same = b.and_(same, b.fcmp_ordered("==", load(b, self._start, SIZE), emitter.h))
        same = b.and_(same, self._equal(size, self._kept_y, emitter.y))
        same = b.and_(same, self._equal(emitter.system.inputs_size, self._kept_inputs, emitter.inputs))
        zero = number(0.0)
        for address, index in self._counters:
            b.store(b.select(same, load(b, self._start, index), zero), address)
        each_component(b, size, lambda w, i: store(w, w.select(same, load(w, self.lost, i), zero), self.lost, i))

    def _may_need_backup(self) -> Value:
        """A single step replaces only slopes that its repetition would not use, should the new state not be finite."""
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

    def _emit_end(self, finite: Value) -> None:
        """Say what the history belongs to; where the new state is not finite, restore it."""
        emitter, b = self._emitter, self._emitter.b
        for address, index in self._counters:
            store(b, b.load(address, typ=DOUBLE), self._start, index)
        store(b, b.sitofp(emitter.index, DOUBLE), self._start, NEXT)
        store(b, emitter.h, self._start, SIZE)
        copy(b, emitter.system.size, emitter.y, self._kept_y)
        copy(b, emitter.system.inputs_size, emitter.inputs, self._kept_inputs)
        if self._backup is not None:
            with b.if_then(b.and_(self._may_need_backup(), b.not_(finite)), likely=False):
                self._copy_rarely(self._backup, self._start)
