"""The Taylor coefficients of a state with loops over the order, for lists that would be too long without them.

Coefficient k of a product of two series is x_0 y_k + x_k y_0 + Σ_j x_j y_{k−j} over 0 < j < k. The last sum needs
lower orders only, so all such sums are computed first, in vectors. The rest of order k is a linear list of operations,
about as long as the rates, the same for all k.
"""

from __future__ import annotations

from functools import partial

from mbd_sim.compiler.ir.builder import DOUBLE, INT, IRBuilder, element, integer, local_array, number
from mbd_sim.compiler.ir.module import POINTER, VOID, Function, FunctionType, Module, Value, vector_of
from mbd_sim.compiler.ir.vectors import Index, copy, for_each, load, loop, store
from mbd_sim.compiler.lists.instruction_list import GraphBuilder, InstructionList, Output
from mbd_sim.compiler.lists.lowering import lower
from mbd_sim.compiler.taylor.expansion import listed, start_of
from mbd_sim.compiler.taylor.rules import Integral, Recurrence, SeriesList, Sum

LANES = 4  # terms of a sum in a vector


def stack_size(series: SeriesList, order: int) -> int:
    """The bytes on the stack that the rows of `emit_recursion` take, which are most of what it needs."""
    return 8 * len(_Recursion(series).rows) * sum(_strides(order))


def _strides(order: int) -> tuple[int, int]:
    """The lengths of forward and backward rows."""
    forward = -(-order // LANES) * LANES
    return forward, forward + LANES


def emit_recursion(module: Module, series: SeriesList, size: int, order: int) -> Function:
    """Emit `void expansion(double* t, double* y, double* inputs, double* c)`: see `expansion`."""
    recursion = _Recursion(series)
    start = lower(module, recursion.start(), inline=False)
    following = lower(module, recursion.following(), inline=False)
    function = Function(module, FunctionType(VOID, [POINTER] * 4), "expansion")
    function.linkage, function.attributes, function.noalias = "internal", ["noinline", "nounwind"], True
    b = IRBuilder(function.append_basic_block("entry"))
    _Emission(b, recursion, size, order).emit(function, start, following)
    b.ret_void()
    return function


class _Recursion:
    """The lists of operations of order 0 and of all others; `pairs` are the rows of coefficients that sums multiply.

    A row is that of a series, or of its derivative: (series, derived).
    """

    def __init__(self, series: SeriesList) -> None:
        self.series = series
        self.rows: dict[tuple[int, bool], int] = {}
        self.pairs: dict[tuple[int, int], int] = {}
        for entry in series.series:
            for term in entry.rule.sums if isinstance(entry.rule, Recurrence) else ():
                if not self._is_linear(term):
                    rows = [self.rows.setdefault(row, len(self.rows)) for row in _rows(term)]
                    self.pairs.setdefault((rows[0], rows[1]), len(self.pairs))

    @property
    def leading(self) -> int:
        """The numbers that order 0 leaves for all others: coefficients 0, and the inverses of divisors."""
        return len(self.series.series) + len(self.series.divisors)

    def start(self) -> InstructionList:
        """A function of (t, y, inputs): the leading numbers, and coefficients 0 of the results."""
        graph, series = GraphBuilder(), self.series
        found = start_of(graph, series)
        leading = [*found, *(graph.inverse(found[divisor]) for divisor in series.divisors)]
        outputs = [Output(node, 0, index) for index, node in enumerate(leading)]
        outputs += [Output(found[result], 1, index) for index, result in enumerate(series.results)]
        return listed("expand_start", 3, 2, graph, outputs)

    def following(self) -> InstructionList:
        """A function of the leading numbers, the sums, the results of order k − 1, and (1 / k, k).

        Its results are the rows and the results of order k.
        """
        graph, series = GraphBuilder(), self.series
        inverses = {divisor: len(series.series) + index for index, divisor in enumerate(series.divisors)}
        by_order, found = graph.input(3, 0), list[int]()
        for entry in series.series:
            rule = entry.rule
            if isinstance(rule, Recurrence):
                sums = graph.total([graph.scaled(term.factor, self._sum(graph, term, found)) for term in rule.sums])
                if rule.by_order:
                    sums = graph.product(by_order, sums)
                value = graph.total([*(graph.scaled(factor, found[x]) for factor, x in rule.terms), sums])
                value = graph.scaled(rule.factor, value)
                if rule.divisor is not None:
                    value = graph.product(value, graph.input(0, inverses[rule.divisor]))
            elif isinstance(rule, Integral):
                value = graph.product(by_order, graph.input(2, rule.result))
            else:
                value = graph.constant(0.0)
            found.append(value)
        order = graph.input(3, 1)
        rows = [graph.product(order, found[row]) if derived else found[row] for row, derived in self.rows]
        outputs = [Output(node, 0, index) for index, node in enumerate(rows)]
        outputs += [Output(found[result], 1, index) for index, result in enumerate(series.results)]
        return listed("expand_order", 4, 2, graph, outputs)

    def _is_linear(self, term: Sum) -> bool:
        return any(self.series.series[number].rule is None for number in (term.x, term.y))

    def _sum(self, graph: GraphBuilder, term: Sum, found: list[int]) -> int:
        """Coefficient k of a sum: the part of lower orders, and the products with coefficients 0."""
        parts = []
        if term.first == 0:
            parts.append(graph.product(graph.input(0, term.x), found[term.y]))
        if term.less == 0:
            newest = graph.product(graph.input(3, 1), found[term.x]) if term.derived else found[term.x]
            parts.append(graph.product(newest, graph.input(0, term.y)))
        if not self._is_linear(term):
            x, y = (self.rows[row] for row in _rows(term))
            parts.append(graph.input(1, self.pairs[x, y]))
        return graph.total(parts)


def _rows(term: Sum) -> tuple[tuple[int, bool], tuple[int, bool]]:
    return (term.x, term.derived), (term.y, False)


def _clear(b: IRBuilder, array: Value, size: int) -> None:
    loop(b, 0, size, lambda i: store(b, number(0.0), array, i))


class _Emission:
    """Emits the loop over the orders. Rows are kept forward, x_1 first, and backward, the newest coefficient first."""

    def __init__(self, b: IRBuilder, recursion: _Recursion, size: int, order: int) -> None:
        self._b, self._recursion, self._size, self._order = b, recursion, size, order
        self._rows, self._results = len(recursion.rows), len(recursion.series.results)
        self._forward_stride, self._backward_stride = _strides(order)
        self._forward = local_array(b, self._rows * self._forward_stride)
        self._backward = local_array(b, self._rows * self._backward_stride)
        self._leading, self._sums = local_array(b, recursion.leading), local_array(b, len(recursion.pairs))
        self._before, self._after = local_array(b, self._results), local_array(b, self._results)
        self._new, self._orders = local_array(b, self._rows), local_array(b, 2)

    def emit(self, function: Function, start: Function, following: Function) -> None:
        """Emit the function's body."""
        b, size, order = self._b, self._size, self._order
        t, y, inputs, coefficients = function.args
        # Beyond the newest coefficients, vectors contain zeros.
        for array, stride in ((self._forward, self._forward_stride), (self._backward, self._backward_stride)):
            _clear(b, array, self._rows * stride)
        copy(b, size, y, coefficients)
        b.call(start, [t, y, inputs, self._leading, self._before])
        for vectors in range(-(-(order - 2) // LANES) + 1):
            first, last = max(1, LANES * (vectors - 1) + 2), min(order - 1, LANES * vectors + 1)
            loop(b, first, last + 1, partial(self._one_order, vectors, following, coefficients))
        self._store_state(integer(order), b.fdiv(number(1.0), number(float(order))), coefficients)

    def _one_order(self, vectors: int, following: Function, coefficients: Value, k: Value) -> None:
        """Coefficients k of the rows, and coefficient k of the state, from what order k − 1 left."""
        b = self._b
        exact = b.sitofp(k, DOUBLE)
        inverse = b.fdiv(number(1.0), exact)
        store(b, inverse, self._orders, 0)
        store(b, exact, self._orders, 1)
        self._store_state(k, inverse, coefficients)
        self._add_sums(k, vectors)
        b.call(following, [self._leading, self._sums, self._before, self._orders, self._new, self._after])
        copy(b, self._results, self._after, self._before)
        ahead, back = b.sub(k, integer(1)), b.sub(integer(self._forward_stride), k)

        def keep(row: Index) -> None:
            place = integer(row) if isinstance(row, int) else row
            value = load(b, self._new, row)
            store(b, value, self._forward, b.add(b.mul(place, integer(self._forward_stride)), ahead))
            store(b, value, self._backward, b.add(b.mul(place, integer(self._backward_stride)), back))

        for_each(b, self._rows, keep)

    def _store_state(self, k: Value, inverse: Value, coefficients: Value) -> None:
        b, size = self._b, self._size
        target = element(b, coefficients, b.mul(k, integer(size)))
        for_each(b, size, lambda i: store(b, b.fmul(inverse, load(b, self._before, i)), target, i))

    def _add_sums(self, k: Value, vectors: int) -> None:
        """The sums of x_j y_{k−j} over 0 < j < k, of all pairs of rows."""
        b, recursion = self._b, self._recursion
        if not vectors:
            _clear(b, self._sums, len(recursion.pairs))
            return
        # y_{k−1} is the element of a backward row that x_1 meets.
        first = b.add(b.sub(integer(self._forward_stride), k), integer(1))
        table = b.module.table("expand_pairs", [
            entry
            for x, y in recursion.pairs
            for entry in (x * self._forward_stride, y * self._backward_stride)
        ])  # fmt: skip

        def one_pair(pair: Value) -> None:
            entry = b.gep(table, b.shl(pair, integer(1)), INT)
            x = element(b, self._forward, b.load(entry, typ=INT))
            second = b.load(b.gep(entry, integer(1), INT), typ=INT)
            y = element(b, self._backward, b.add(second, first))
            store(b, self._dot(x, y, vectors), self._sums, pair)

        loop(b, 0, len(recursion.pairs), one_pair)

    def _dot(self, x: Value, y: Value, vectors: int) -> Value:
        """The sum of products of two arrays, of some vectors."""
        b, type_ = self._b, vector_of(DOUBLE, LANES)
        total: Value | None = None
        for index in range(vectors):
            places = (element(b, array, LANES * index).text for array in (x, y))
            one, other = (b.value(type_, f"load {type_}, ptr {place}, align 8") for place in places)
            total = b.fmul(one, other) if total is None else b.fma(one, other, total)
        assert total is not None
        half = vector_of(DOUBLE, 2)
        low, high = (
            b.value(half, f"shufflevector {type_} {total.text}, {type_} undef, <2 x i32> <i32 {i}, i32 {i + 1}>")
            for i in (0, 2)
        )
        pair = b.fadd(low, high)
        ends = [b.value(DOUBLE, f"extractelement {half} {pair.text}, i32 {i}") for i in (0, 1)]
        return b.fadd(*ends)
