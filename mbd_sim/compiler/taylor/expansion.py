"""The Taylor expansion of a state: its coefficients as a list of scalar operations, and its polynomial as IR.

The list has no loops over the order. The coefficients c (order + 1, n) of the state are in memory, each order after the
other. What is emitted of the polynomial is its value, how long it holds, and its error.
"""

from __future__ import annotations

import math

import casadi as ca

from mbd_sim.compiler.ir.builder import DOUBLE, INT, integer, number
from mbd_sim.compiler.ir.module import Value
from mbd_sim.compiler.ir.vectors import Index, for_each, load, store
from mbd_sim.compiler.lists.instruction_list import Graph, GraphBuilder, InstructionList, Output, is_leaf
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.compiler.steps.emitter import StepEmitter
from mbd_sim.compiler.taylor.rules import Integral, Recurrence, SeriesList, Sum
from mbd_sim.integrators.explicit import Taylor


def expansion(series: SeriesList, size: int, order: int) -> InstructionList:
    """A function of (t, y, inputs); component k n + i of its result (order + 1) n is c_k of component i of y.

    y(t + τ) = Σ_k c_k τᵏ solves y' = rates(t, y, inputs), of which `series` are the series, with n = `size` components.
    """
    coefficients = _Coefficients(series)
    for k in range(1, order):
        coefficients.add_order(k)
    outputs = [
        Output(coefficients.state(component, k), 0, k * size + component)
        for k in range(order + 1)
        for component in range(size)
    ]
    return listed("expansion", 3, 1, coefficients.graph, outputs)


def listed(name: str, arguments: int, results: int, graph: GraphBuilder, outputs: list[Output]) -> InstructionList:
    """A graph as an arranged list of instructions, with a name and numbers of arguments and results."""
    like = ca.Function(name, [ca.SX.sym(f"a{index}") for index in range(arguments)], [ca.SX(1, 1)] * results)
    return arranged(InstructionList(like, Graph(graph.nodes, outputs), range(len(graph.nodes))))


def start_of(graph: GraphBuilder, series: SeriesList) -> list[int]:
    """The nodes of the coefficients 0 of all series."""
    found: list[int] = []
    for one in series.series:
        start = one.start
        operands = start.operands if is_leaf(start) else tuple(found[place] for place in start.operands)
        found.append(graph.node(start._replace(operands=operands)))
    return found


class _Coefficients:
    """The coefficients of series, order by order, as nodes of a graph."""

    def __init__(self, series: SeriesList) -> None:
        self.graph = GraphBuilder()
        self._series, self._results = series.series, series.results
        self._of: list[list[int]] = [[place] for place in start_of(self.graph, series)]  # nodes, by series and order
        self._inverses = {place: self.graph.inverse(self._of[place][0]) for place in series.divisors}

    def add_order(self, k: int) -> None:
        """Add the coefficients k of all series; those of lower orders are there."""
        for place, series in enumerate(self._series):
            if isinstance(series.rule, Recurrence):
                value = self._following(series.rule, k)
            elif isinstance(series.rule, Integral):
                value = self._integral(series.rule.result, k)
            else:
                value = self.graph.constant(0.0)
            self._of[place].append(value)

    def state(self, component: int, k: int) -> int:
        """Coefficient k of a component of the state, one order higher than what is there at most."""
        return self._integral(component, k) if k else self.graph.input(1, component)

    def _following(self, rule: Recurrence, k: int) -> int:
        graph = self.graph
        sums = graph.total([graph.scaled(term.factor, self._sum(term, k)) for term in rule.sums])
        if rule.by_order:
            sums = graph.scaled(1.0 / k, sums)
        terms = [graph.scaled(factor, self._of[place][k]) for factor, place in rule.terms]
        value = graph.scaled(rule.factor, graph.total([*terms, sums]))
        return value if rule.divisor is None else graph.product(value, self._inverses[rule.divisor])

    def _integral(self, result: int, k: int) -> int:
        return self.graph.scaled(1.0 / k, self._of[self._results[result]][k - 1])

    def _sum(self, term: Sum, k: int) -> int:
        graph, y, orders = self.graph, self._of[term.y], range(term.first, k - term.less + 1)
        if term.derived:
            return graph.total([graph.product(self._derivative(term.x, j), y[k - j]) for j in orders])
        x = self._of[term.x]
        if term.x != term.y:
            return graph.total([graph.product(x[j], y[k - j]) for j in orders])
        half = graph.total([graph.product(x[j], x[k - j]) for j in orders if 2 * j < k])
        middle = graph.product(x[k // 2], x[k // 2]) if k % 2 == 0 and k // 2 in orders else graph.constant(0.0)
        return graph.sum(graph.scaled(2.0, half), middle)

    def _derivative(self, place: int, j: int) -> int:
        """j times coefficient j: of an integral, the coefficient j − 1 of what it is the integral of."""
        rule = self._series[place].rule
        if isinstance(rule, Integral):
            return self._of[self._results[rule.result]][j - 1]
        return self.graph.scaled(float(j), self._of[place][j])


# The exponent of a double, and its mantissa as a fraction, as an integer: log2 x + BIAS in units of 1 / UNIT.
UNIT, BIAS = 2.0**52, 1023.0
SAFETY = 0.9375  # a power of two from its bits is too large by up to 6.2 %


class TaylorExpansion:
    """Emits the code that reads the coefficients of expansions, within the step of an emitter.

    `longest` and `estimate` are those of the coefficients that `measure` has read last.
    """

    def __init__(self, emitter: StepEmitter, method: Taylor) -> None:
        self._emitter, self._method, self._count = emitter, method, emitter.system.size
        self._norms = emitter.array(method.compared)

    def evaluate(self, coefficients: Value, tau: Value) -> None:
        """Set y to the polynomial at τ: even and odd orders apart, which takes half the time of Horner's scheme."""
        emitter, order, b = self._emitter, self._method.order, self._emitter.b
        square = b.fmul(tau, tau)

        def coefficient(k: int, i: Index) -> Value:
            place = k * self._count + i if isinstance(i, int) else b.add(integer(k * self._count), i)
            return load(b, coefficients, place)

        def component(i: Index) -> None:
            halves = []
            for last in (order - 1, order):
                value = coefficient(last, i)
                for k in range(last - 2, 0, -2):
                    value = b.fma(value, square, coefficient(k, i))
                halves.append(value)
            odd, even = halves if order % 2 == 0 else halves[::-1]
            change = b.fmul(b.fma(even, tau, odd), tau)
            store(b, b.fadd(coefficient(0, i), change), emitter.y, i)

        for_each(b, self._count, component)

    def measure(self, coefficients: Value) -> None:
        """Set the norms of the last coefficients, that of the highest order first: Σ |c_i| / (s_i + |y_i|)."""
        emitter, method, b = self._emitter, self._method, self._emitter.b
        zero = number(0.0)
        for place in range(method.compared):
            store(b, zero, self._norms, place)

        def component(i: Index) -> None:
            scale = emitter.scale(i)
            for place in range(method.compared):
                k = method.order - place
                at = k * self._count + i if isinstance(i, int) else b.add(integer(k * self._count), i)
                size = b.intrinsic("llvm.fabs", load(b, coefficients, at))
                store(b, b.fma(size, scale, load(b, self._norms, place)), self._norms, place)

        for_each(b, emitter.system.error_size, component)

    def longest(self) -> Value:
        """The longest τ in s at which the terms are small enough; not a number if they are infinite.

        Logarithms and powers to the base 2 are read from the bits of doubles, linear between powers of two: by up to
        0.09 too small, which changes τ by less than 1 %.
        """
        method, b = self._method, self._emitter.b
        rates = []
        for place in range(method.compared):
            bits = b.sitofp(b.bitcast(load(b, self._norms, place), INT), DOUBLE)
            logarithm = b.fsub(b.fmul(bits, number(1.0 / UNIT)), number(BIAS))
            rates.append(b.fmul(logarithm, number(1.0 / (method.order - place))))
        largest = rates[0]
        for rate in rates[1:]:
            largest = b.select(b.fcmp_ordered(">", rate, largest), rate, largest)
        exponent = b.fsub(number(math.log2(method.tolerance) / method.order + BIAS), largest)
        tau = b.bitcast(b.fptosi(b.fmul(exponent, number(UNIT)), INT), DOUBLE)
        total = load(b, self._norms, 0)
        for place in range(1, method.compared):
            total = b.fadd(total, load(b, self._norms, place))
        finite = b.fcmp_ordered("<", total, number(math.inf))
        return b.select(finite, b.fmul(tau, number(SAFETY)), number(math.nan))

    def estimate(self, tau: Value) -> None:
        """Emit the update of the largest error by that of an expansion at τ: its last two terms."""
        emitter, order, b = self._emitter, self._method.order, self._emitter.b
        power, square = None, tau
        for bit in range((order - 1).bit_length()):
            if (order - 1) >> bit & 1:
                power = square if power is None else b.fmul(power, square)
            square = b.fmul(square, square)
        assert power is not None
        error = b.fmul(power, b.fma(tau, load(b, self._norms, 0), load(b, self._norms, 1)))
        error = b.select(b.fcmp_unordered("uno", error, error), number(math.inf), error)
        largest = b.load(emitter.largest_error, typ=DOUBLE)
        b.store(b.select(b.fcmp_ordered(">", error, largest), error, largest), emitter.largest_error)
