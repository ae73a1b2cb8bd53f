"""When an Adams method takes a step at once, in parts, or by the other method: a small state machine, as IR.

Steps of level 0 are taken at once, those of 1 in halves and those of 2 in quarters. The state consists of the `count`
of slopes that are known at the distance of these parts, the `level`, the steps to `wait` before the next attempt, and
the `pause` if that fails. An attempt of a step leads to one of these states:

| attempt | count | level | wait, pause |
|---|---|---|---|
| succeeded | more by its parts | its own | the pause is 0 after many that succeeded |
| succeeded as a probe, in parts of twice the length | half, and more by its parts | its own | |
| failed as a probe | | | |
| failed by little: `REFINABLE` | all, interpolated | one finer | |
| failed by little at the finest level: `NEARLY`, after many that succeeded | all but one | | |
| failed otherwise | 0 | finer, if that promises to be enough, or 0 | waits for the pause, which doubles |

After the last one a new history begins: the slopes may be those of a force with a kink, which differences of lower
order no longer see after some steps.
"""

from __future__ import annotations

from mbd_sim.compiler.ir.builder import DOUBLE, INT, integer, number
from mbd_sim.compiler.ir.module import Value
from mbd_sim.compiler.steps.emitter import StepEmitter
from mbd_sim.integrators.explicit import PARTS, Adams

FINEST = PARTS.bit_length() - 1  # the level of the smallest parts of a step
DIVIDED = 5  # instructions of a rate on average, from which on parts of a step cost less than the other method
LONGEST_PAUSE = 255.0  # steps until the next attempt, after many that failed
# Errors in units of the tolerance: those up to which an attempt that fails now and then changes nothing,
NEARLY = 10.0
REFINABLE = 16.0  # up to which slopes are interpolated, so that the step can be taken in smaller parts,
DIVISIBLE = 1024.0  # and up to which parts of half the length are expected to succeed,
HALVED = 2048.0  # times smaller an error is then
PATIENCE = 16.0  # further slopes, after which one that fails may change nothing, and the pauses are short again
PROBED_EVERY = 8  # divided steps, a power of two, one is attempted in parts of twice the length first


def finest_level(instructions: int, size: int) -> int:
    """The level of the smallest parts in which a step is taken, for `size` rates of `instructions` together."""
    return FINEST if instructions >= DIVIDED * size else 0


class AdamsPolicy:
    """The addresses of the state, and what changes it. Conditions are those of each member if the code is for several.

    `refines` is 1 after an attempt that failed by little, until slopes are interpolated; `finest` is the finest level.
    """

    def __init__(self, method: Adams, emitter: StepEmitter) -> None:
        """Allocate the state; the emitter's builder must be in the entry block of a function."""
        self._emitter, self._length = emitter, float(method.length)
        self._tolerance = method.tolerance
        system = emitter.system
        self.finest = finest_level(system.instructions, system.size)
        self.count, self.level, self.wait, self.pause, self.refines = map(
            emitter.scalar, ("count", "level", "wait", "pause", "refines")
        )

    @property
    def state(self) -> tuple[Value, Value, Value, Value]:
        """The addresses of what is kept from step to step."""
        return self.count, self.level, self.wait, self.pause

    def read(self, address: Value) -> Value:
        """A number of the state."""
        return self._emitter.b.load(address, typ=DOUBLE)

    def enter(self, condition: Value, *changes: tuple[Value, Value]) -> None:
        """Emit a transition: where a condition holds, the numbers at these addresses change to these values."""
        b = self._emitter.b
        for address, value in changes:
            b.store(b.select(condition, value, self.read(address)), address)

    def begin_step(self) -> Value:
        """Emit the beginning of a step; returns whether its slopes count, so that attempts are made."""
        b = self._emitter.b
        wait = self.read(self.wait)
        counts = b.named(b.fcmp_ordered("<=", wait, number(0.0)), "counts")
        b.store(b.select(counts, b.fadd(self.read(self.count), number(1.0)), number(0.0)), self.count)
        b.store(b.select(counts, number(0.0), b.fsub(wait, number(1.0))), self.wait)
        b.store(number(0.0), self.refines)
        return counts

    def is_at_level(self, level: Value) -> Value:
        """Whether steps are at a level."""
        b = self._emitter.b
        return b.fcmp_ordered("==", self.read(self.level), b.sitofp(level, DOUBLE))

    def is_known(self, level: Value) -> Value:
        """Whether steps are at a level, and there are enough slopes for it."""
        b = self._emitter.b
        return b.and_(self.is_at_level(level), b.fcmp_ordered(">=", self.read(self.count), number(self._length)))

    def is_probe(self, level: Value) -> Value:
        """Whether steps are in parts of half the length of this level, and one is now attempted at this level first."""
        b, count = self._emitter.b, self.read(self.count)
        finer = b.add(level, integer(1))
        due = b.and_(b.fptosi(count, INT), b.shl(integer(PROBED_EVERY - 1), finer))
        known = b.fcmp_ordered(">=", count, number(2.0 * self._length))
        return b.and_(self.is_at_level(finer), b.and_(known, b.icmp_unsigned("==", due, integer(0))))

    def parts(self, level: Value) -> Value:
        """The number of parts of a step at a level."""
        return self._emitter.b.shl(integer(1), level)

    def add_slopes(self, condition: Value, parts: Value) -> None:
        """Count the slopes within a step of so many parts, where a condition holds."""
        b = self._emitter.b
        further = b.sitofp(b.sub(parts, integer(1)), DOUBLE)
        self.enter(condition, (self.count, b.fadd(self.read(self.count), further)))

    def judge(self, level: Value, error: Value, active: Value, probes: Value) -> Value:
        """Emit the transition after an attempt at a level, where it is `active`; returns whether it succeeded."""
        b, count = self._emitter.b, self.read(self.count)
        passed = b.named(b.and_(active, self._is_below(error, 1.0)), "passed")
        lasts = b.named(b.fcmp_ordered(">=", count, number(self._length + PATIENCE)), "lasts")
        self.enter(b.and_(passed, lasts), (self.pause, number(0.0)))
        half = b.sitofp(b.fptosi(b.fmul(number(0.5), count), INT), DOUBLE)
        self.enter(b.and_(passed, probes), (self.count, half))
        self.add_slopes(passed, self.parts(level))
        self.enter(passed, (self.level, b.sitofp(level, DOUBLE)))
        failed = b.named(b.and_(active, b.not_(b.or_(passed, probes))), "failed")
        with b.if_then(self._emitter.any(failed)):
            self._fail(level, error, failed, lasts)
        return passed

    def _is_below(self, error: Value, factor: float) -> Value:
        return self._emitter.b.fcmp_ordered("<=", error, number(factor * self._tolerance))

    def _fail(self, level: Value, error: Value, failed: Value, lasts: Value) -> None:
        """Emit the transition after an attempt that failed, and was not a probe."""
        b = self._emitter.b
        is_finest = b.icmp_unsigned("==", level, integer(self.finest))
        if self.finest:
            refines = b.and_(b.and_(failed, self._is_below(error, REFINABLE)), b.not_(is_finest))
            finer = b.sitofp(b.add(level, integer(1)), DOUBLE)
            self.enter(refines, (self.refines, number(1.0)), (self.count, number(self._length)), (self.level, finer))
            failed = b.and_(failed, b.not_(refines))
        patient = b.and_(b.and_(failed, is_finest), b.and_(self._is_below(error, NEARLY), lasts))
        self.enter(patient, (self.count, number(self._length - 1.0)))
        failed = b.named(b.and_(failed, b.not_(patient)), "ended")
        pause = self.read(self.pause)
        longer = b.fadd(b.fadd(pause, pause), number(1.0))
        longer = b.select(b.fcmp_ordered("<", longer, number(LONGEST_PAUSE)), longer, number(LONGEST_PAUSE))
        self.enter(failed, (self.count, number(0.0)), (self.level, number(0.0)))
        self.enter(failed, (self.wait, pause), (self.pause, longer))
        if self.finest:
            for levels, factor in ((2, DIVISIBLE * HALVED), (1, DIVISIBLE)):
                finer = b.add(level, integer(levels))
                exists = b.icmp_signed("<=", finer, integer(self.finest))
                divides = b.and_(failed, b.and_(self._is_below(error, factor), exists))
                self.enter(divides, (self.level, b.sitofp(finer, DOUBLE)))
