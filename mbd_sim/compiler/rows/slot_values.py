"""The values of slots as IR: one function for each kind of slots, called for those that are in use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import casadi as ca

from mbd_sim.compiler.ir.builder import FALSE, IRBuilder, element, integer, local_array, number
from mbd_sim.compiler.ir.module import POINTER, VOID, Function, FunctionType, Module, Value
from mbd_sim.compiler.ir.vectors import load, loop, store
from mbd_sim.compiler.lists.lowering import lower
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.compiler.rows.pooled_rows import CompiledPool, PooledRows, emit_pool_values

GROUND = 24  # numbers of the motion of ground, behind those of parts


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
    and then zeros. The slots of `pooled` rows follow the others.
    """

    motions: ca.Function
    slots: Sequence[CompiledSlot]
    size: int
    unused: float
    pooled: PooledRows | None = None

    @property
    def has_values(self) -> bool:
        """Whether there are slots."""
        return bool(self.slots) or self.pooled is not None

    @property
    def pools(self) -> Sequence[CompiledPool]:
        """Those of the pooled rows."""
        return () if self.pooled is None else self.pooled.pools


def emit_slot_values(module: Module, system: SlotSystem) -> Function:
    """Emit `void slot_values(t, y, inputs, values)`, if it is not there yet."""
    if (known := module.functions.get("slot_values")) is not None:
        return known
    functions = [*(slot.function for slot in system.slots), *(pool.function for pool in system.pools)]
    kinds = {each.name(): each for each in functions}
    emitted = {name: lower(module, arranged(function), inline=False) for name, function in kinds.items()}
    function = Function(module, FunctionType(VOID, [POINTER] * 4), "slot_values")
    function.linkage, function.attributes = "internal", ["noinline"]
    if system.has_values:
        _emit_all(IRBuilder(function.append_basic_block("entry")), function.args, system, emitted)
    else:
        IRBuilder(function.append_basic_block("entry")).ret_void()
    return function


def _emit_all(b: IRBuilder, arguments: Sequence[Value], system: SlotSystem, emitted: Mapping[str, Function]) -> None:
    t, y, inputs, values = arguments
    motions_of = lower(b.module, arranged(system.motions), inline=False)
    size = system.motions.nnz_out(0)
    motions = local_array(b, size + GROUND)
    keys, used = [_key(b, inputs, slot) for slot in system.slots], FALSE
    for key in keys:
        used = b.or_(used, b.fcmp_unordered("!=", key, number(0.0)))
    if system.pools:
        used = b.or_(used, _emit_any_used(b, system.pools, inputs))
    with b.if_then(used):
        b.call(motions_of, [t, y, inputs, motions])
    for slot, key in zip(system.slots, keys, strict=True):
        own, count = element(b, values, slot.values), slot.function.nnz_out(0)
        with b.if_else(b.fcmp_unordered("!=", key, number(0.0))) as (in_use, unused):
            with in_use:
                parts = [element(b, motions, place) for place in slot.motions]
                b.call(emitted[slot.function.name()], [t, inputs, element(b, inputs, slot.first), *parts, own])
            with unused:
                store(b, number(system.unused), own, 0)
                _clear(b, own, count)
    if system.pools:
        ground = element(b, motions, size)
        loop(b, 0, GROUND, lambda i: store(b, number(0.0), ground, i))
        for place in (3, 7, 11):  # of its rotation, after its position
            store(b, number(1.0), ground, place)
    for index, pool in enumerate(system.pools):
        own_function = emitted[pool.function.name()]
        emit_pool_values(b, index, pool, own_function, (t, inputs), motions, values, system.unused)
    b.ret_void()


def _emit_any_used(b: IRBuilder, pools: Sequence[CompiledPool], inputs: Value) -> Value:
    """Whether a slot of a pool is in use."""
    found = local_array(b, 1)
    store(b, number(0.0), found, 0)

    def add(slot: Value, pool: CompiledPool) -> None:
        place = b.add(integer(pool.first + pool.size - 1), b.mul(slot, integer(pool.size)))
        store(b, b.fadd(load(b, found, 0), b.intrinsic("llvm.fabs", load(b, inputs, place))), found, 0)

    for pool in pools:
        loop(b, 0, len(pool.rows), partial(add, pool=pool))
    return b.fcmp_unordered("!=", load(b, found, 0), number(0.0))


def _clear(b: IRBuilder, values: Value, size: int) -> None:
    loop(b, 1, size, lambda i: store(b, number(0.0), values, i))


def _key(b: IRBuilder, inputs: Value, slot: CompiledSlot) -> Value:
    return load(b, inputs, slot.first + slot.function.nnz_in(2) - 1)
