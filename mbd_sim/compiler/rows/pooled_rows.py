"""Rows of slots that many pairs of parts share: the pair of a slot is known when its values are computed.

A row is a combination of the wrenches on its two parts. The functions of a mechanism know wrenches on parts only, so
what connects these with rows is done here, in loops over the slots in use. The `coefficients` (rows, 12) are those of
the rows of pools, one after the other, and `blocks` (slots, 2) their parts; beyond these is ground.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca

from mbd_sim.compiler.ir.builder import INT, IRBuilder, element, integer, local_array, number
from mbd_sim.compiler.ir.module import Function, Module, Value
from mbd_sim.compiler.ir.python_functions import emit_function
from mbd_sim.compiler.ir.python_kinds import Array, Integers
from mbd_sim.compiler.ir.vectors import load, loop, store

TWIST = 6  # numbers of the wrench on a part


@dataclass(frozen=True, eq=False)
class CompiledPool:
    """Slots with the same number of `rows` each, whose values are `function(t, inputs, numbers, motion, motion)`.

    Slot k has `size` numbers from `first` + k `size` on among the inputs. The last one is not zero while it is in use
    by the pair whose number is the input `holder` + k. Its values are from `values` + k `stride` on.
    """

    function: ca.Function
    first: int
    holder: int
    values: int
    rows: tuple[tuple[int, ...], ...]
    pairs: tuple[tuple[int, int], ...]

    @property
    def size(self) -> int:
        """The numbers of a slot."""
        return int(self.function.nnz_in(2))

    @property
    def stride(self) -> int:
        """The values of a slot."""
        return int(self.function.nnz_out(0))


@dataclass(frozen=True, eq=False)
class PooledRows:
    """The rows of all `pools` of a system with some moving `parts`, whose wrenches are from `wrenches` on among values.

    The wrenches of forces are followed by those of what comes after forces in a solution.
    """

    pools: tuple[CompiledPool, ...]
    parts: int
    wrenches: int

    @cached_property
    def slots(self) -> list[tuple[int, ...]]:
        """The rows of all slots, one after the other."""
        return [rows for pool in self.pools for rows in pool.rows]

    @property
    def rows(self) -> list[int]:
        """All rows, slot by slot."""
        return [row for rows in self.slots for row in rows]


@dataclass(frozen=True)
class Coefficients:
    """The arrays of one call: the `left` and `right` coefficients, which are those of L and R, and the `blocks`."""

    left: Value
    right: Value
    blocks: Value

    @property
    def all(self) -> list[Value]:
        """For `mbd_sim.compiler.rows.row_factors.emit_product`."""
        return [self.left, self.right, self.blocks]


def fill(
    slots: int, k: int, inputs: Array, size: int, holders: Array, pairs: Integers, ground: int, values: Array,
    stride: int, left: Array, blocks: Integers,
) -> None:  # fmt: skip
    """The coefficients of the slots of a pool that are in use, with k rows each, and the parts of all.

    :param inputs: those from the numbers of the first slot on, and `holders` those from its pair on.
    :param values: those from the first slot on.
    """
    for slot in range(slots):
        blocks[2 * slot], blocks[2 * slot + 1] = ground, ground
        if inputs[size * (slot + 1) - 1] != 0.0:
            pair = int(holders[slot])
            blocks[2 * slot], blocks[2 * slot + 1] = pairs[2 * pair], pairs[2 * pair + 1]
            for i in range(12 * k):
                left[12 * k * slot + i] = values[stride * slot + 1 + 2 * k + i]


def is_used(blocks: Integers, ground: int, slot: int) -> bool:
    """Whether a slot is in use: one of its parts moves."""
    return blocks[2 * slot] < ground or blocks[2 * slot + 1] < ground


def combine(
    slots: int, k: int, ground: int, blocks: Integers, friction: Array, left: Array, right: Array
) -> None:  # fmt: skip
    """Right coefficients from left ones: each row with the friction that follows its force.

    :param friction: (k, k) of each slot, column by column.
    """
    for slot in range(slots):
        for j in range(k if is_used(blocks, ground, slot) else 0):
            for i in range(12):
                total = 0.0
                for row in range(k):
                    total += friction[k * (k * slot + j) + row] * left[12 * (k * slot + row) + i]
                right[12 * (k * slot + j) + i] = total


def gather(
    slots: int, k: int, rows: Integers, ground: int, blocks: Integers, left: Array, parts: Array, sign: float,
    out: Array,
) -> None:  # fmt: skip
    """Add to rows what their parts do.

    :param parts: (6,) of each part.
    :param sign: by which it is multiplied.
    """
    for slot in range(slots):
        for end in range(2):
            part = blocks[2 * slot + end]
            if part < ground:
                for j in range(k):
                    total, first = 0.0, 12 * (k * slot + j) + 6 * end
                    for i in range(6):
                        total += left[first + i] * parts[6 * part + i]
                    row = rows[k * slot + j]
                    out[row] = out[row] + sign * total


def scatter(
    slots: int, k: int, rows: Integers, ground: int, blocks: Integers, coefficients: Array, forces: Array, out: Array
) -> None:  # fmt: skip
    """Add to the wrenches on parts what the forces of rows do."""
    for slot in range(slots):
        for end in range(2):
            part = blocks[2 * slot + end]
            if part < ground:
                for j in range(k):
                    force, first = forces[rows[k * slot + j]], 12 * (k * slot + j) + 6 * end
                    for i in range(6):
                        out[6 * part + i] = out[6 * part + i] + force * coefficients[first + i]


class PooledCalls:
    """Emits the calls of the functions above for all pools, in one function with a builder."""

    def __init__(self, b: IRBuilder, pooled: PooledRows) -> None:
        self._b, self._pooled, count = b, pooled, len(pooled.rows)
        left, self._combined = local_array(b, 12 * count), local_array(b, 12 * count)
        self.coefficients = Coefficients(left, left, b.alloca(INT, integer(2 * len(pooled.slots))))
        self._ground = integer(pooled.parts)

    def begin(
        self, inputs: Value, values: Value, system: ca.Function, outputs: Sequence[Value], right: Value
    ) -> None:  # fmt: skip
        """Emit what follows the call of a system: the coefficients, and what parts do to its right sides.

        :param outputs: the last two of the system, which may be empty.
        """
        self.fill(inputs, values)
        if system.nnz_out(system.n_out() - 2):
            self.combine(outputs[0])
        if system.nnz_out(system.n_out() - 1):
            self.gather(outputs[1], -1.0, right)

    def end(self, solution: Value, rows: int, columns: int, values: Value) -> None:
        """Emit what precedes a result: the wrenches on parts by up to two columns (rows,) of a solution."""
        for column in range(columns):
            out = element(self._b, values, self._pooled.wrenches + column * TWIST * self._pooled.parts)
            self.scatter(element(self._b, solution, column * rows), out)

    def fill(self, inputs: Value, values: Value) -> None:
        """Emit the coefficients without friction and the blocks."""
        b, called = self._b, emit_function(self._b.module, fill)
        for index, (pool, slots, first, row) in enumerate(self._pools()):
            pairs = _pairs(b.module, index, pool)
            numbers, holders = element(b, inputs, pool.first), element(b, inputs, pool.holder)
            own = element(b, values, pool.values)
            left, blocks = element(b, self.coefficients.left, 12 * row), self._blocks(first)
            shape = [integer(len(slots)), integer(len(slots[0]))]
            sizes = integer(pool.size), integer(pool.stride)
            b.call(
                called,
                [*shape, numbers, sizes[0], holders, pairs, self._ground, own, sizes[1], left, blocks],
            )

    def combine(self, friction: Value) -> None:
        """Emit the right coefficients with friction."""
        b, called, at = self._b, emit_function(self._b.module, combine), 0
        self.coefficients = replace(self.coefficients, right=self._combined)
        for _, slots, first, row in self._pools():
            k = len(slots[0])
            left, right = (element(b, each, 12 * row) for each in (self.coefficients.left, self.coefficients.right))
            shape = integer(len(slots)), integer(k), self._ground
            b.call(called, [*shape, self._blocks(first), element(b, friction, at), left, right])
            at += k * k * len(slots)

    def gather(self, parts: Value, sign: float, out: Value) -> None:
        """Emit the addition of what parts do to rows."""
        b, called = self._b, emit_function(self._b.module, gather)
        for index, (_, slots, first, row) in enumerate(self._pools()):
            left = element(b, self.coefficients.left, 12 * row)
            shape = integer(len(slots)), integer(len(slots[0])), self._rows(index, slots), self._ground
            b.call(called, [*shape, self._blocks(first), left, parts, number(sign), out])

    def scatter(self, forces: Value, out: Value) -> None:
        """Emit the wrenches (6 parts,) on parts by the forces of rows, with the friction that follows them."""
        b, called = self._b, emit_function(self._b.module, scatter)
        loop(b, 0, TWIST * self._pooled.parts, lambda i: store(b, number(0.0), out, i))
        for index, (_, slots, first, row) in enumerate(self._pools()):
            own = element(b, self.coefficients.right, 12 * row)
            shape = integer(len(slots)), integer(len(slots[0])), self._rows(index, slots), self._ground
            b.call(called, [*shape, self._blocks(first), own, forces, out])

    def _pools(self) -> list[tuple[CompiledPool, Sequence[tuple[int, ...]], int, int]]:
        """Each pool with the rows of its slots, the number of the first one, and that of its first row."""
        found, slot, row = list[tuple[CompiledPool, Sequence[tuple[int, ...]], int, int]](), 0, 0
        for pool in self._pooled.pools:
            found.append((pool, pool.rows, slot, row))
            slot, row = slot + len(pool.rows), row + len(pool.rows) * len(pool.rows[0])
        return found

    def _blocks(self, slot: int) -> Value:
        return self._b.gep(self.coefficients.blocks, integer(2 * slot), INT)

    def _rows(self, index: int, slots: Sequence[tuple[int, ...]]) -> Value:
        return self._b.module.table(f"rows_of_pool_{index}", [row for rows in slots for row in rows])


def _pairs(module: Module, index: int, pool: CompiledPool) -> Value:
    return module.table(f"pairs_of_pool_{index}", [part for pair in pool.pairs for part in pair])


def emit_pool_values(
    b: IRBuilder, index: int, pool: CompiledPool, function: Function, given: tuple[Value, Value], motions: Value,
    values: Value, unused: float,
) -> None:  # fmt: skip
    """Emit the values of the slots of a pool: those of a slot that is not in use are `unused`, and then zeros.

    :param function: of their kind; it takes what is `given`, t and the inputs, and then its own numbers.
    :param motions: of all parts, and of ground.
    """
    t, inputs = given
    pairs, motion = _pairs(b.module, index, pool), int(pool.function.nnz_in(3))

    def entry(place: Value) -> Value:
        part = b.load(b.gep(pairs, place, INT), typ=INT)
        return element(b, motions, b.mul(part, integer(motion)))

    def one(slot: Value) -> None:
        numbers = element(b, inputs, b.add(integer(pool.first), b.mul(slot, integer(pool.size))))
        own = element(b, values, b.add(integer(pool.values), b.mul(slot, integer(pool.stride))))
        key = load(b, numbers, pool.size - 1)
        with b.if_else(b.fcmp_unordered("!=", key, number(0.0))) as (in_use, is_free):
            with in_use:
                pair = b.convert("fptosi", load(b, inputs, b.add(integer(pool.holder), slot)), INT)
                first = b.mul(pair, integer(2))
                parts = [entry(first), entry(b.add(first, integer(1)))]
                b.call(function, [t, inputs, numbers, *parts, own])
            with is_free:
                store(b, number(unused), own, 0)
                loop(b, 1, pool.stride, lambda i: store(b, number(0.0), own, i))

    loop(b, 0, len(pool.rows), one)
