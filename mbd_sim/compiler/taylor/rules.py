"""The Taylor series of the values of an instruction list: a recurrence for the result of each operation.

With y' = f(t, y) each value of f is a function of time, and its series follows from those of its operands. Coefficient
k of y is coefficient k − 1 of f, divided by k (Moore, *Methods and Applications of Interval Analysis*; Griewank &
Walther, *Evaluating Derivatives*, ch. 13).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca

from mbd_sim.compiler.lists.instruction_list import (
    Graph,
    InstructionList,
    Instructions,
    Node,
    Output,
    graph_of,
    is_leaf,
    zero_components,
)
from mbd_sim.compiler.lists.schedule import arranged


@dataclass(frozen=True, slots=True)
class Sum:
    """The sum of factor x_j y_{k−j} over j from `first` to k − `less`; with j x_j for x_j if x is `derived`."""

    x: int
    y: int
    first: int = 0
    less: int = 0
    derived: bool = False
    factor: float = 1.0


@dataclass(frozen=True, slots=True)
class Recurrence:
    """Coefficient k ≥ 1 of a series: (Σ factor x_k + Σ sums) factor / d_0.

    The `terms` are pairs of a factor and a series x. If `by_order`, the sums are divided by k; without a `divisor`,
    d_0 is 1.
    """

    terms: tuple[tuple[float, int], ...] = ()
    sums: tuple[Sum, ...] = ()
    by_order: bool = False
    divisor: int | None = None
    factor: float = 1.0


@dataclass(frozen=True, slots=True)
class Integral:
    """Coefficient k ≥ 1 of a series that is the integral of a result: that result's coefficient k − 1, divided by k."""

    result: int


@dataclass(frozen=True, slots=True)
class Series:
    """A series: the operation whose value is its coefficient 0, on those of other series, and the others' `rule`.

    Without a rule they are zero.
    """

    start: Node
    rule: Recurrence | Integral | None = None


@dataclass(frozen=True, eq=False)
class SeriesList:
    """Series in an order in which coefficients k can be computed one after the other, and those of the `results`."""

    series: Sequence[Series]
    results: Sequence[int]

    @property
    def divisors(self) -> list[int]:
        """The series by whose coefficients 0 others are divided."""
        rules = (series.rule for series in self.series)
        return sorted({r.divisor for r in rules if isinstance(r, Recurrence) and r.divisor is not None})

    @property
    def has_exponentials(self) -> bool:
        """Whether values may decay exponentially, so that coefficients may say nothing of what follows.

        An example is tanh((t − 1) / 0.001) at t = 0.
        """
        return any(
            series.start.operation in (ca.OP_EXP, ca.OP_TANH)
            # x^a has the divisor x, and exp(y log x) has none.
            or (series.start.operation == ca.OP_POW and series.rule.divisor is None)
            for series in self.series
            if isinstance(series.rule, Recurrence)
        )

    def products(self, order: int) -> int:
        """About how many products the coefficients up to an order take."""
        sums = sum(len(series.rule.sums) for series in self.series if isinstance(series.rule, Recurrence))
        return sums * order * (order + 1) // 2


LARGEST_POWER = 16  # integer exponents up to this one become products, which are analytic at zero too


def guarded_pivot(graph: Graph, node: Node) -> int | None:
    """The pivot p of (c < p) / max(p, c), the inverse of a pivot that counts only if it is large enough.

    c is a constant, or a constant multiplied by a maximum.
    """
    if node.operation != ca.OP_DIV:
        return None
    condition, bounded = (graph.nodes[operand] for operand in node.operands)
    if condition.operation != ca.OP_LT or bounded.operation != ca.OP_FMAX:
        return None
    floor, pivot = condition.operands
    return pivot if _is_floor(graph, graph.nodes[floor]) and set(bounded.operands) == {floor, pivot} else None


def _is_floor(graph: Graph, node: Node) -> bool:
    factors = {graph.nodes[operand].operation for operand in node.operands} if node.operation == ca.OP_MUL else set()
    return node.operation == ca.OP_CONST or factors == {ca.OP_CONST, ca.OP_FMAX}


class SeriesRules:
    """The construction of the series of a graph's nodes."""

    def __init__(self, graph: Graph, still: frozenset[int]) -> None:
        self.series: list[Series] = []
        self.numbers: dict[int, int] = {}  # of the series of each node
        self._graph, self._still = graph, still
        self._time = sum(output.result == 0 for output in graph.outputs)  # the result of which time is the integral
        self._pairs: dict[int, tuple[int, int]] = {}  # sine and cosine of a series
        self.one = self._constant(1.0)

    def add_node(self, number: int) -> None:
        """Add the series of a node, whose operands have theirs.

        :raises KeyError: its operation has none.
        """
        node = self._graph.nodes[number]
        if is_leaf(node):
            self.numbers[number] = self._leaf(node)
        elif (pivot := guarded_pivot(self._graph, node)) is not None:
            self.numbers[number] = self.inverse(self.numbers[pivot])
        else:
            operands = tuple(self.numbers[operand] for operand in node.operands)
            if all(self.is_constant(operand) for operand in operands):
                self.numbers[number] = self._add(Node(node.operation, operands))
            else:
                self.numbers[number] = _RULES[node.operation](self, *operands)

    def _leaf(self, node: Node) -> int:
        if node.operation == ca.OP_CONST:
            return self._constant(node.value)
        argument, component = node.operands
        if argument == 0:
            return self._add(node, Integral(self._time))
        if argument == 1 and component not in self._still:
            return self._add(node, Integral(component))
        return self._add(node)

    def _add(self, start: Node, rule: Recurrence | Integral | None = None) -> int:
        self.series.append(Series(start, rule))
        return len(self.series) - 1

    def _constant(self, value: float) -> int:
        return self._add(Node(ca.OP_CONST, (), value))

    def is_constant(self, number: int) -> bool:
        """Whether a series is constant in time."""
        return self.series[number].rule is None

    def linear(self, operation: int, *terms: tuple[float, int]) -> int:
        """Σ a x over the terms (a, x); coefficient 0 is the operation on the x."""
        return self._add(Node(operation, tuple(number for _, number in terms)), Recurrence(terms))

    def product(self, x: int, y: int) -> int:
        """z_k = Σ_j x_j y_{k−j}."""
        if self.is_constant(y):
            x, y = y, x
        start = Node(ca.OP_SQ, (x,)) if x == y else Node(ca.OP_MUL, (x, y))
        return self._add(start, Recurrence(sums=(Sum(x, y),)))

    def quotient(self, x: int, y: int) -> int:
        """x_k = Σ_j y_j z_{k−j}."""
        start = Node(ca.OP_DIV, (x, y))
        if self.is_constant(y):
            return self._add(start, Recurrence(((1.0, x),), divisor=y))
        own = len(self.series)
        return self._add(start, Recurrence(((1.0, x),), (Sum(y, own, first=1, factor=-1.0),), divisor=y))

    def inverse(self, y: int) -> int:
        """1 = y z."""
        rule = Recurrence(sums=(Sum(y, len(self.series), first=1, factor=-1.0),), divisor=y)
        return self._add(Node(ca.OP_INV, (y,)), rule)

    def root(self, x: int) -> int:
        """x = z²."""
        own = len(self.series)
        rule = Recurrence(((1.0, x),), (Sum(own, own, 1, 1, factor=-1.0),), divisor=own, factor=0.5)
        return self._add(Node(ca.OP_SQRT, (x,)), rule)

    def absolute(self, x: int) -> int:
        """|x| = sign(x_0) x."""
        sign = self._add(Node(ca.OP_SIGN, (x,)))
        return self._add(Node(ca.OP_FABS, (x,)), Recurrence(sums=(Sum(sign, x),)))

    def sine(self, x: int) -> int:
        """s' = c x' with the cosine c."""
        return self._sine_cosine(x)[0]

    def cosine(self, x: int) -> int:
        """c' = −s x' with the sine s."""
        return self._sine_cosine(x)[1]

    def _sine_cosine(self, x: int) -> tuple[int, int]:
        """s' = c x' and c' = −s x'."""
        if x not in self._pairs:
            sine, cosine = len(self.series), len(self.series) + 1
            self._follow(ca.OP_SIN, x, cosine)
            self._follow(ca.OP_COS, x, sine, -1.0)
            self._pairs[x] = sine, cosine
        return self._pairs[x]

    def _follow(self, operation: int, x: int, slope: int, factor: float = 1.0, of: tuple[int, ...] = ()) -> int:
        """z' = factor w x' with the series w, the `slope`; coefficient 0 is an operation on x, or `of` others."""
        rule = Recurrence(sums=(Sum(x, slope, first=1, derived=True, factor=factor),), by_order=True)
        return self._add(Node(operation, of or (x,)), rule)

    def exponential(self, x: int) -> int:
        """z' = z x'."""
        return self._follow(ca.OP_EXP, x, len(self.series))

    def tangent(self, x: int) -> int:
        """z' = (1 + z²) x'."""
        return self._tangent(ca.OP_TAN, x, 1.0)

    def hyperbolic_tangent(self, x: int) -> int:
        """z' = (1 − z²) x'."""
        return self._tangent(ca.OP_TANH, x, -1.0)

    def _tangent(self, operation: int, x: int, sign: float) -> int:
        own = len(self.series)
        self._follow(operation, x, own + 2)
        square = self.product(own, own)
        self.linear(ca.OP_ADD if sign > 0.0 else ca.OP_SUB, (1.0, self.one), (sign, square))
        return own

    def _divided(self, start: Node, x: int, slope: int) -> int:
        """z' = x' / w with the series w, the `slope`."""
        sums = (Sum(len(self.series), slope, 1, 1, derived=True, factor=-1.0),)
        # x_k is not divided by k: k x_k / k.
        return self._add(start, Recurrence(((1.0, x),), sums, by_order=True, divisor=slope))

    def logarithm(self, x: int) -> int:
        """z' = x' / x."""
        return self._divided(Node(ca.OP_LOG, (x,)), x, x)

    def arc_tangent(self, x: int) -> int:
        """z' = x' / (1 + x²)."""
        slope = self.linear(ca.OP_ADD, (1.0, self.one), (1.0, self.product(x, x)))
        return self._divided(Node(ca.OP_ATAN, (x,)), x, slope)

    def arc_sine(self, x: int) -> int:
        """z' = x' / √(1 − x²)."""
        slope = self.root(self.linear(ca.OP_SUB, (1.0, self.one), (-1.0, self.product(x, x))))
        return self._divided(Node(ca.OP_ASIN, (x,)), x, slope)

    def arc_cosine(self, x: int) -> int:
        """z = π/2 − asin x."""
        arc_sine = self.arc_sine(x)
        return self._add(Node(ca.OP_ACOS, (x,)), Recurrence(((-1.0, arc_sine),)))

    def angle(self, y: int, x: int) -> int:
        """z' = (x y' − y x') / (x² + y²)."""
        square = self.linear(ca.OP_ADD, (1.0, self.product(x, x)), (1.0, self.product(y, y)))
        own = len(self.series)
        sums = (
            Sum(y, x, first=1, derived=True),
            Sum(x, y, first=1, derived=True, factor=-1.0),
            Sum(own, square, 1, 1, derived=True, factor=-1.0),
        )
        return self._add(Node(ca.OP_ATAN2, (y, x)), Recurrence(sums=sums, by_order=True, divisor=square))

    def power(self, x: int, exponent: int) -> int:
        """x z' = a z x' for a constant exponent a, and z = exp(a log x) for others."""
        value = self.series[exponent].start.value
        if self.series[exponent].start.operation == ca.OP_CONST and value in range(1, LARGEST_POWER + 1):
            found = x
            for _ in range(int(value) - 1):
                found = self.product(found, x)
            return found
        if self.is_constant(exponent) and self.series[exponent].start.operation == ca.OP_CONST:
            own = len(self.series)
            sums = (
                Sum(x, own, first=1, derived=True, factor=value),
                Sum(own, x, 1, 1, derived=True, factor=-1.0),
            )
            return self._add(Node(ca.OP_POW, (x, exponent)), Recurrence(sums=sums, by_order=True, divisor=x))
        logarithm = self.product(exponent, self.logarithm(x))
        return self._follow(ca.OP_POW, logarithm, len(self.series), of=(x, exponent))

    def selected(self, condition: int, x: int) -> int:
        """The series x, or zero where a condition that stays does not hold.

        :raises KeyError: the condition changes.
        """
        if not self.is_constant(condition):
            raise KeyError(condition)
        factor = self._add(Node(ca.OP_IF_ELSE_ZERO, (condition, self.one)))
        return self._add(Node(ca.OP_IF_ELSE_ZERO, (condition, x)), Recurrence(sums=(Sum(factor, x),)))


# Of operations with an operand that changes.
_RULES: dict[int, Callable[..., int]] = {
    ca.OP_ASSIGN: lambda build, x: x,
    ca.OP_NEG: lambda build, x: build.linear(ca.OP_NEG, (-1.0, x)),
    ca.OP_TWICE: lambda build, x: build.linear(ca.OP_TWICE, (2.0, x)),
    ca.OP_ADD: lambda build, x, y: build.linear(ca.OP_ADD, (1.0, x), (1.0, y)),
    ca.OP_SUB: lambda build, x, y: build.linear(ca.OP_SUB, (1.0, x), (-1.0, y)),
    ca.OP_MUL: SeriesRules.product,
    ca.OP_SQ: lambda build, x: build.product(x, x),
    ca.OP_DIV: SeriesRules.quotient,
    ca.OP_INV: SeriesRules.inverse,
    ca.OP_SQRT: SeriesRules.root,
    ca.OP_FABS: SeriesRules.absolute,
    ca.OP_SIN: SeriesRules.sine,
    ca.OP_COS: SeriesRules.cosine,
    ca.OP_TAN: SeriesRules.tangent,
    ca.OP_TANH: SeriesRules.hyperbolic_tangent,
    ca.OP_EXP: SeriesRules.exponential,
    ca.OP_LOG: SeriesRules.logarithm,
    ca.OP_ASIN: SeriesRules.arc_sine,
    ca.OP_ACOS: SeriesRules.arc_cosine,
    ca.OP_ATAN: SeriesRules.arc_tangent,
    ca.OP_ATAN2: SeriesRules.angle,
    ca.OP_POW: SeriesRules.power,
    ca.OP_CONSTPOW: SeriesRules.power,
    ca.OP_IF_ELSE_ZERO: SeriesRules.selected,
}


class NotAnalyticError(Exception):
    """An operation that is not an analytic function of time: its name, and the first result that depends on it."""

    def __init__(self, operation: str, result: int) -> None:
        self.operation, self.result = operation, result
        super().__init__(f"result {result} depends on the operation {operation}")


_NAMES = {
    ca.OP_SIGN: "sign",
    ca.OP_FLOOR: "floor",
    ca.OP_CEIL: "ceil",
    ca.OP_FMIN: "min",
    ca.OP_FMAX: "max",
    ca.OP_FMOD: "mod",
    ca.OP_IF_ELSE_ZERO: "where",
    **dict.fromkeys((ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE), "comparison"),
    **dict.fromkeys((ca.OP_NOT, ca.OP_AND, ca.OP_OR), "where"),
}


def series_of(rates: Instructions) -> SeriesList:
    """The series of y' = rates(t, y, inputs), whose first output are the results 0 …; the last result is 1, t'.

    Divisions guarded by `GuardedFactors` are those of a pivot that is not vanishing. The series of |x| holds as long as
    x keeps its sign, see `turning_points`.

    :raises NotAnalyticError: a result is not analytic.
    """
    graph, builder = _built(rates)
    results = {o.component: builder.numbers[o.node] for o in graph.outputs if o.result == 0}
    return SeriesList(builder.series, [*(results[index] for index in range(len(results))), builder.one])


def _built(rates: Instructions) -> tuple[Graph, SeriesRules]:
    graph, still = graph_of(rates), frozenset(zero_components(rates))
    builder = SeriesRules(graph, still)
    for number in _needed(graph):
        try:
            builder.add_node(number)
        except KeyError:
            operation = graph.nodes[number].operation
            raise NotAnalyticError(_NAMES.get(operation, f"number {operation}"), _dependent(graph, number)) from None
    return graph, builder


def turning_points(rates: Instructions) -> InstructionList | None:
    """(t, y, inputs) -> the x at whose zeros y' = rates(t, y, inputs) has a kink; None if there are none.

    These are the x of all |x|, and of all powers of x² + ε² or sums of such squares: ε may be tiny, as in the law of a
    damper, and its pole then too weak for the coefficients to announce it.
    """
    graph, builder = _built(rates)
    nodes = [graph.nodes[number] for number in _needed(graph)]
    operands = dict.fromkeys(node.operands[0] for node in nodes if node.operation == ca.OP_FABS)
    for node in nodes:
        if node.operation in (ca.OP_SQRT, ca.OP_POW, ca.OP_CONSTPOW):
            terms = _terms(graph, node.operands[0])
            if len(terms) == 1 or any(builder.is_constant(builder.numbers[term]) for term in terms):
                squares = (graph.nodes[term] for term in terms)
                operands |= dict.fromkeys(one.operands[0] for one in squares if one.operation == ca.OP_SQ)
    found = [operand for operand in operands if not builder.is_constant(builder.numbers[operand])]
    if not found:
        return None
    outputs = [Output(number, 0, index) for index, number in enumerate(found)]
    like = ca.Function("turning", [ca.SX.sym(name) for name in ("t", "y", "inputs")], [ca.SX(1, 1)])
    return arranged(InstructionList(like, Graph(graph.nodes, outputs), range(len(graph.nodes))))


def _terms(graph: Graph, number: int) -> list[int]:
    """The nodes of which a node is the sum."""
    node = graph.nodes[number]
    if node.operation != ca.OP_ADD:
        return [number]
    return [term for operand in node.operands for term in _terms(graph, operand)]


def _needed(graph: Graph) -> list[int]:
    """The nodes on which the first output depends, without conditions of guarded divisions."""
    found: set[int] = set()
    waiting = [output.node for output in graph.outputs if output.result == 0]
    while waiting:
        number = waiting.pop()
        node = graph.nodes[number]
        if number not in found and not is_leaf(node):
            pivot = guarded_pivot(graph, node)
            waiting += node.operands if pivot is None else [pivot]
        found.add(number)
    return sorted(found)


def _dependent(graph: Graph, number: int) -> int:
    """The first component of the first output that depends on a node."""
    dependents = {number}
    for index, node in enumerate(graph.nodes):
        if not is_leaf(node) and not dependents.isdisjoint(node.operands):
            dependents.add(index)
    return min(output.component for output in graph.outputs if output.result == 0 and output.node in dependents)
