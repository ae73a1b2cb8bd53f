"""What changes in a state at the start of a step, as IR: see `BetweenSteps`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mbd_sim.compiler.ir import Function, Module, Value
from mbd_sim.compiler.ir_builder import IRBuilder
from mbd_sim.compiler.ir_types import integer, local_array
from mbd_sim.compiler.ir_vectors import load, store
from mbd_sim.compiler.lowering import lower
from mbd_sim.integrators.between_steps import BetweenSteps, DelayLine, Sampler


@dataclass(frozen=True, eq=False)
class Samples:
    """The delays of a system, and its samplers, each with its lowered function."""

    delays: Sequence[DelayLine]
    sampled: Sequence[tuple[Sampler, Function]]

    def results(self, b: IRBuilder) -> Value:
        """A new array for `emit`; only in the entry block of a function."""
        return local_array(b, max([1, *(len(sampler.components) for sampler, _ in self.sampled)]))

    def emit(self, b: IRBuilder, step: Value, arguments: Sequence[Value], results: Value) -> None:
        """Emit the changes of y before a step.

        :param step: its number.
        :param arguments: the addresses of t, y and the inputs.
        """
        _, y, inputs = arguments
        for delay in self.delays:
            slot = b.add(b.urem(step, integer(delay.length)), integer(delay.first))
            due = load(b, y, slot)
            store(b, load(b, inputs, delay.source), y, slot)
            store(b, due, y, delay.into)
        for sampler, function in self.sampled:
            if sampler.every == 1:
                _emit_sample(b, sampler, function, arguments, results)
                continue
            with b.if_then(b.icmp_unsigned("==", b.urem(step, integer(sampler.every)), integer(0))):
                _emit_sample(b, sampler, function, arguments, results)


def _emit_sample(
    b: IRBuilder, sampler: Sampler, function: Function, arguments: Sequence[Value], results: Value
) -> None:
    b.call(function, [*arguments, results])
    for index, component in enumerate(sampler.components):
        store(b, load(b, results, index), arguments[1], component)


def emit_samples(module: Module, between_steps: BetweenSteps | None, lanes: int = 1) -> Samples | None:
    """Emit the sampled functions; None if nothing changes between steps."""
    if between_steps is None or not (between_steps.delays or between_steps.samplers):
        return None
    lowered = [(s, lower(module, s.function, inline=False, lanes=lanes)) for s in between_steps.samplers]
    return Samples(between_steps.delays, lowered)
