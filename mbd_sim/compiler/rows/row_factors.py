"""Factors of the matrix of one-sided rows, of which only what active rows need is multiplied out, as IR.

The matrix is Lᵀ R. The columns of both factors, one for each row, combine columns of blocks with coefficients: a block
is what the wrenches on a part do, and the coefficients are the wrench of a row, or a block is one column of its own.
So many rows share few blocks. What is computed runs in loops over tables, whatever the number of rows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TypeAlias

from mbd_sim.compiler.ir.builder import FALSE, INT, TRUE, IRBuilder, element, integer, local_array, number
from mbd_sim.compiler.ir.dense_solver import where_coupled
from mbd_sim.compiler.ir.module import POINTER, VOID, Function, FunctionType, Module, Value
from mbd_sim.compiler.ir.python_functions import emit_function
from mbd_sim.compiler.ir.python_kinds import Integers
from mbd_sim.compiler.ir.vectors import Index, for_span, load, loop, store
from mbd_sim.compiler.rows.islands import MANY
from mbd_sim.compiler.rows.pooled_rows import TWIST, PooledRows
from mbd_sim.compiler.rows.shared_rows import ActiveRows


@dataclass(frozen=True)
class FactorBlock:
    """Some `columns` of a factor, with their entries at these `places` and zeros elsewhere."""

    places: tuple[int, ...]
    columns: int

    @property
    def size(self) -> int:
        """The number of its entries, which are stored column by column."""
        return len(self.places) * self.columns


@dataclass(frozen=True)
class RowFactor:
    """A matrix (size, rows) whose columns combine those of `blocks`.

    The `terms` of each row are blocks with the places of their first coefficients. The numbers of a factor are the
    entries of all blocks, one after the other, and then `coefficients`.
    """

    size: int
    blocks: tuple[FactorBlock, ...]
    terms: tuple[tuple[tuple[int, int], ...], ...]
    coefficients: int

    @cached_property
    def starts(self) -> tuple[int, ...]:
        """Where the entries of each block begin, and the coefficients after them."""
        found = [0]
        for block in self.blocks:
            found.append(found[-1] + block.size)
        return tuple(found)


Factors: TypeAlias = tuple[RowFactor, RowFactor]  # L and R, of the same blocks


class _DenseRows:
    """The entries (size, count) of chosen columns of L, row by row."""

    def __init__(self, b: IRBuilder, n: int, size: int, count: Value) -> None:
        self._b, self._n, self._count, self._entries = b, n, count, local_array(b, size * n)

    def put(self, k: Value, i: Value, value: Value) -> None:
        """Emit the storage of an entry."""
        store(self._b, value, self._entries, self._b.add(i, self._b.mul(k, integer(self._n))))

    def add(self, k: Value, weight: Value, total: Value) -> None:
        """Emit the addition of row k times a weight to a total (count,)."""
        b, row = self._b, element(self._b, self._entries, self._b.mul(k, integer(self._n)))

        def add(w: IRBuilder, i: Index) -> None:
            store(w, w.fma(weight, load(w, row, i), load(w, total, i)), total, i)

        with where_coupled(b, self._n, weight):
            for_span(b, self._n, 0, self._count, add)


class _SparseRows:
    """The same with the same results, without entries that are zero: of many rows, each acts on few parts."""

    def __init__(self, b: IRBuilder, n: int, size: int) -> None:
        self._b, self._n = b, n
        self._entries, self._columns, self._counts = (local_array(b, count) for count in (size * n, size * n, size))
        loop(b, 0, size, lambda k: b.store(integer(0), b.gep(self._counts, k, INT)))

    def put(self, k: Value, i: Value, value: Value) -> None:
        """See `_DenseRows`."""
        b = self._b
        with b.if_then(b.fcmp_unordered("!=", value, number(0.0))):
            at = b.gep(self._counts, k, INT)
            place = b.add(b.load(at, typ=INT), b.mul(k, integer(self._n)))
            store(b, value, self._entries, place)
            b.store(i, b.gep(self._columns, place, INT))
            b.store(b.add(b.load(at, typ=INT), integer(1)), at)

    def add(self, k: Value, weight: Value, total: Value) -> None:
        """See `_DenseRows`."""
        b = self._b

        def add(index: Value) -> None:
            place = b.add(index, b.mul(k, integer(self._n)))
            i = b.load(b.gep(self._columns, place, INT), typ=INT)
            store(b, b.fma(weight, load(b, self._entries, place), load(b, total, i)), total, i)

        with b.if_then(b.fcmp_unordered("!=", weight, number(0.0))):
            loop(b, 0, b.load(b.gep(self._counts, k, INT), typ=INT), add)


def merge(count: int, places: Integers, known: int, touched: Integers, spare: Integers) -> int:
    """Add places (count,), which ascend, to those that are touched (known,), which do so too; how many these are then.

    :param spare: memory for as many.
    """
    i, total = 0, 0
    for k in range(known):
        while i < count and places[i] < touched[k]:
            spare[total] = places[i]
            total += 1
            i += 1
        if i < count and places[i] == touched[k]:
            i += 1
        spare[total] = touched[k]
        total += 1
    for rest in range(i, count):
        spare[total] = places[rest]
        total += 1
    for k in range(total):
        touched[k] = spare[k]
    return total


class _AllPlaces:
    """The entries of one column of a factor, or of several at once, one after the other."""

    def __init__(self, b: IRBuilder, size: int) -> None:
        self._b, self._size = b, size

    def begin(self, columns: Sequence[Value]) -> None:
        """Emit columns of zeros."""
        for column in columns:
            loop(self._b, 0, self._size, partial(store, self._b, number(0.0), column))

    def add(self, places: Value, count: Value) -> None:
        """Say that there are entries at these places (count,)."""

    def each(self, columns: Sequence[Value], act: Callable[[Value], None]) -> None:
        """Emit what is done at each place of these columns, which then are not used any more."""
        loop(self._b, 0, self._size, act)


class _TouchedPlaces:
    """The same in the same order, without entries that are zero: of many rows, each acts on few parts."""

    def __init__(self, b: IRBuilder, size: int, columns: Sequence[Value]) -> None:
        """:param columns: memory, which is zero between uses."""
        self._b = b
        self._touched, self._spare = (b.alloca(INT, integer(max(size, 1))) for _ in range(2))
        self._count = b.alloca(INT)
        for column in columns:
            loop(b, 0, size, partial(store, b, number(0.0), column))

    def begin(self, columns: Sequence[Value]) -> None:
        """See `_AllPlaces`."""
        self._b.store(integer(0), self._count)

    def add(self, places: Value, count: Value) -> None:
        """See `_AllPlaces`."""
        b, called = self._b, emit_function(self._b.module, merge)
        known = b.load(self._count, typ=INT)
        b.store(b.call(called, [count, places, known, self._touched, self._spare]), self._count)

    def each(self, columns: Sequence[Value], act: Callable[[Value], None]) -> None:
        """See `_AllPlaces`."""
        b = self._b

        def at(index: Value) -> None:
            place = b.load(b.gep(self._touched, index, INT), typ=INT)
            act(place)
            for column in columns:
                store(b, number(0.0), column, place)

        loop(b, 0, b.load(self._count, typ=INT), at)


_Places: TypeAlias = _AllPlaces | _TouchedPlaces


class _Tables:
    """The tables of a factor in a module, and the coefficients of its rows of pools."""

    def __init__(
        self, module: Module, name: str, factor: RowFactor, pooled: PooledRows | None, coefficients: Sequence[Value]
    ) -> None:
        """:param coefficients: those of pools, and the blocks of their slots."""
        first, places, flat, begins = list[int](), list[int](), list[int](), [0]
        for block in factor.blocks:
            first.append(len(places))
            places += block.places
        for terms in factor.terms:
            flat += [number for term in terms for number in term]
            begins.append(len(flat) // 2)
        blocks = zip(factor.blocks, factor.starts, first, strict=False)
        shapes = [number for block, start, at in blocks for number in (len(block.places), block.columns, start, at)]
        self.places, self.terms, self.begins, self.blocks = (
            module.table(f"{name}.{label}", numbers or [0])
            for label, numbers in (("places", places), ("terms", flat), ("begins", begins), ("blocks", shapes))
        )
        self.most = max((len(block.places) for block in factor.blocks), default=1)
        self.factor, self.parts = factor, 0 if pooled is None else pooled.parts
        self.of_pools: tuple[Value, Value, Value] | None = None
        if pooled is not None:
            numbers = [-1] * (2 * len(factor.terms))  # of each row its number among those of pools, and its slot
            in_pools = [(row, slot) for slot, rows in enumerate(pooled.slots) for row in rows]
            for index, (row, slot) in enumerate(in_pools):
                numbers[2 * row : 2 * row + 2] = index, slot
            own, slots = coefficients
            self.of_pools = module.table(f"{name}.in_pools", numbers), own, slots


def _entry(b: IRBuilder, table: Value, index: Value) -> Value:
    return b.load(b.gep(table, index, INT), typ=INT)


def _column(
    b: IRBuilder,
    tables: _Tables,
    numbers: Value,
    coefficients: Value,
    row: Value,
    column: Value,
    part: Value,
    among: _Places,
) -> None:
    """Emit a column (size,) of a factor, which has begun; `part` is memory for that of one block."""

    def add_block(block: Value, weights: Value) -> None:
        count, columns, start, at = (_entry(b, tables.blocks, b.add(block, integer(k))) for k in range(4))
        loop(b, 0, count, lambda i: store(b, number(0.0), part, i))

        def add_column(j: Value) -> None:
            weight, source = load(b, weights, j), element(b, numbers, b.add(start, b.mul(j, count)))

            def add(w: IRBuilder, i: Index) -> None:
                store(w, w.fma(weight, load(w, source, i), load(w, part, i)), part, i)

            for_span(b, tables.most, 0, count, add)

        def scatter(i: Value) -> None:
            place = _entry(b, tables.places, b.add(at, i))
            store(b, b.fadd(load(b, column, place), load(b, part, i)), column, place)

        loop(b, 0, columns, add_column)
        loop(b, 0, count, scatter)
        among.add(b.gep(tables.places, at, INT), count)

    def add_term(term: Value) -> None:
        two = b.mul(term, integer(2))
        block = b.mul(_entry(b, tables.terms, two), integer(4))
        add_block(block, element(b, coefficients, _entry(b, tables.terms, b.add(two, integer(1)))))

    loop(b, _entry(b, tables.begins, row), _entry(b, tables.begins, b.add(row, integer(1))), add_term)
    if tables.of_pools is None:
        return
    (in_pools, own, blocks), two = tables.of_pools, b.mul(row, integer(2))
    index, slot = _entry(b, in_pools, two), _entry(b, in_pools, b.add(two, integer(1)))

    def add_end(end: Value) -> None:
        block = _entry(b, blocks, b.add(b.mul(slot, integer(2)), end))
        with b.if_then(b.icmp_signed("<", block, integer(tables.parts))):  # not ground
            first = b.add(b.mul(index, integer(2 * TWIST)), b.mul(end, integer(TWIST)))
            add_block(b.mul(block, integer(4)), element(b, own, first))

    with b.if_then(b.icmp_signed(">=", index, integer(0))):
        loop(b, 0, 2, add_end)


def emit_product(
    module: Module, name: str, factors: Factors, active: ActiveRows | None, pooled: PooledRows | None = None,
    of_marked: bool = False,
) -> Function:  # fmt: skip
    """Emit `void name(inputs, left, right, matrix, mobility)`, if it is not there yet.

    Where it is that `of_marked` rows, `mobility` are marks (rows,) that are not zero for these, and the matrix has
    those rows only. Otherwise:

    With `pooled` rows their left and right coefficients follow, and the blocks of their slots.

    Of the matrix (rows, rows) those entries are computed whose row and column are active, closed or have a given force;
    without `active` all of them, but for slots of pools that are not in use. The `mobility` (rows,) is the diagonal
    without friction, for rows of friction that slide: those with a direction, whose number follows those of the active
    rows.
    """
    if (known := module.functions.get(name)) is not None:
        return known
    n, size = len(factors[0].terms), factors[0].size
    function = Function(module, FunctionType(VOID, [POINTER] * (5 if pooled is None else 8)), name)
    function.linkage, function.attributes, function.noalias = "internal", ["noinline"], pooled is None
    inputs, left, right, matrix, mobility, *of_pools = function.args
    b = IRBuilder(function.append_basic_block("entry"))
    by_left, by_right = (
        _Tables(module, f"{name}.{side}", one, pooled, [of_pools[index], of_pools[2]] if of_pools else [])
        for index, (side, one) in enumerate(zip(("left", "right"), factors, strict=True))
    )
    own, other, part = (local_array(b, max(count, 1)) for count in (size, size, max(by_left.most, by_right.most)))
    total = local_array(b, n)
    by_row, by_column = (element(b, each, factors[0].starts[-1]) for each in (left, right))
    is_needed = partial(_is_set, b, mobility, 0) if of_marked else partial(_is_needed, b, by_left)
    chosen, count = _chosen(b, n, inputs, active, is_needed)
    place = (lambda i: i) if of_marked else chosen
    entries = _SparseRows(b, n, size) if n >= MANY else _DenseRows(b, n, size, count)
    among = _TouchedPlaces(b, size, [own, other]) if n >= MANY else _AllPlaces(b, size)

    def gather(i: Value) -> None:
        among.begin([own])
        _column(b, by_left, left, by_row, chosen(i), own, part, among)
        among.each([own], lambda k: entries.put(k, i, load(b, own, k)))

    def multiply(j: Value) -> None:
        among.begin([other])
        _column(b, by_right, right, by_column, chosen(j), other, part, among)
        loop(b, 0, count, lambda i: store(b, number(0.0), total, i))
        among.each([other], lambda k: entries.add(k, load(b, other, k), total))
        target = b.mul(j, count) if of_marked else b.mul(chosen(j), integer(n))
        loop(b, 0, count, lambda i: store(b, load(b, total, i), matrix, b.add(place(i), target)))

    loop(b, 0, count, gather)
    loop(b, 0, count, multiply)

    if active is not None:
        numbers, directions = (left, right, by_row), active.first + n - active.gaps
        slides = partial(_is_set, b, inputs, directions)
        loop(b, active.gaps, n, partial(_move, b, by_left, numbers, slides, (own, other, part), among, mobility))
    b.ret_void()
    return function


def _move(
    b: IRBuilder,
    tables: _Tables,
    numbers: tuple[Value, Value, Value],
    slides: Callable[[Value], Value],
    memory: tuple[Value, Value, Value],
    among: _Places,
    mobility: Value,
    row: Value,
) -> None:
    """Emit the mobility of a row: without friction, the coefficients of R are those of L."""
    left, right, coefficients = numbers
    own, other, part = memory
    store(b, number(0.0), mobility, row)

    def add(k: Value) -> None:
        store(b, b.fma(load(b, own, k), load(b, other, k), load(b, mobility, row)), mobility, row)

    with b.if_then(slides(row)):
        among.begin([own, other])
        _column(b, tables, left, coefficients, row, own, part, among)
        _column(b, tables, right, coefficients, row, other, part, among)
        among.each([own, other], add)


def _is_set(b: IRBuilder, inputs: Value, first: int, index: Value) -> Value:
    return b.fcmp_unordered("!=", load(b, inputs, b.add(index, integer(first))), number(0.0))


def _is_needed(b: IRBuilder, tables: _Tables, row: Value) -> Value:
    """Whether a row is not that of a slot of a pool that is not in use."""
    if tables.of_pools is None:
        return TRUE
    (in_pools, _, blocks), two = tables.of_pools, b.mul(row, integer(2))
    slot = b.add(two, integer(1))
    first = b.mul(_entry(b, in_pools, slot), integer(2))
    is_own = b.icmp_signed("<", first, integer(0))
    place = b.select(is_own, integer(0), first)
    moves = [b.icmp_signed("<", _entry(b, blocks, b.add(place, integer(end))), integer(tables.parts)) for end in (0, 1)]
    return b.or_(is_own, b.or_(*moves))


def _chosen(
    b: IRBuilder, n: int, inputs: Value, active: ActiveRows | None, is_needed: Callable[[Value], Value]
) -> tuple[Callable[[Value], Value], Value]:
    """The rows that are needed, see `emit_product`, and their number.

    :param is_needed: of those without masks.
    """
    chosen, count = b.alloca(INT, integer(max(n, 1))), b.alloca(INT)
    b.store(integer(0), count)

    def choose(i: Value, masks: tuple[int, ...]) -> None:
        found, needed = b.load(count, typ=INT), FALSE if masks else is_needed(i)
        b.store(i, b.gep(chosen, found, INT))
        for first in masks:
            needed = b.or_(needed, _is_set(b, inputs, first, i))
        b.store(b.select(needed, b.add(found, integer(1)), found), count)

    if active is None:
        loop(b, 0, n, lambda i: choose(i, ()))
    else:
        masks = active.first, active.given
        loop(b, 0, active.gaps, lambda i: choose(i, (*masks, active.first - active.gaps)))
        loop(b, active.gaps, n, lambda i: choose(i, masks))
    return lambda index: b.load(b.gep(chosen, index, INT), typ=INT), b.load(count, typ=INT)
