"""The values of slots as IR: one function for each kind of slots, called for those that are in use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from mbd_sim.compiler.ir.builder import FALSE, IRBuilder, element, local_array, number
from mbd_sim.compiler.ir.module import POINTER, VOID, Function, FunctionType, Module, Value
from mbd_sim.compiler.ir.vectors import load, loop, store
from mbd_sim.compiler.lists.lowering import lower
from mbd_sim.compiler.lists.schedule import arranged


@dataclass(frozen=True, eq=False)
class CompiledSlot:
    """A slot, whose values are `function(t, inputs, numbers, motion…)`.

    Its numbers are those from `first` on among the inputs. The last one is not zero while it is in use. Its motions are
    at these places among all, and its values from `values` on.
    """

    function: ca.Function
    first: int
    motions: tuple[int, ...]
    values: int


@dataclass(frozen=True, eq=False)
class SlotSystem:
    """The slots of a system, with the `motions(t, y, inputs)` that they read.

    Their values are the first ones in an array of `size` components. Those of a slot that is not in use are `unused`,
    and then zeros.
    """

    motions: ca.Function
    slots: Sequence[CompiledSlot]
    size: int
    unused: float


def emit_slot_values(module: Module, system: SlotSystem) -> Function:
    """Emit `void slot_values(t, y, inputs, values)`, if it is not there yet."""
    if (known := module.functions.get("slot_values")) is not None:
        return known
    kinds = {slot.function.name(): slot.function for slot in system.slots}
    emitted = {name: lower(module, arranged(function), inline=False) for name, function in kinds.items()}
    motions_of = lower(module, arranged(system.motions), inline=False) if system.slots else None
    function = Function(module, FunctionType(VOID, [POINTER] * 4), "slot_values")
    function.linkage, function.attributes = "internal", ["noinline"]
    t, y, inputs, values = function.args
    b = IRBuilder(function.append_basic_block("entry"))
    motions = local_array(b, max(system.motions.nnz_out(0), 1))
    if motions_of is not None:
        keys = [_key(b, inputs, slot) for slot in system.slots]
        used = FALSE
        for key in keys:
            used = b.or_(used, b.fcmp_unordered("!=", key, number(0.0)))
        with b.if_then(used):
            b.call(motions_of, [t, y, inputs, motions])
        for slot, key in zip(system.slots, keys, strict=True):
            own, size = element(b, values, slot.values), slot.function.nnz_out(0)
            with b.if_else(b.fcmp_unordered("!=", key, number(0.0))) as (in_use, unused):
                with in_use:
                    parts = [element(b, motions, place) for place in slot.motions]
                    b.call(emitted[slot.function.name()], [t, inputs, element(b, inputs, slot.first), *parts, own])
                with unused:
                    store(b, number(system.unused), own, 0)
                    _clear(b, own, size)
    b.ret_void()
    return function


def _clear(b: IRBuilder, values: Value, size: int) -> None:
    loop(b, 1, size, lambda i: store(b, number(0.0), values, i))


def _key(b: IRBuilder, inputs: Value, slot: CompiledSlot) -> Value:
    return load(b, inputs, slot.first + slot.function.nnz_in(2) - 1)
