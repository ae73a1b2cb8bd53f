"""The Taylor coefficients of a state as one list of scalar operations, without loops over the order."""

from __future__ import annotations

import casadi as ca

from mbd_sim.compiler.graph_builder import GraphBuilder
from mbd_sim.compiler.instruction_list import Graph, InstructionList, Output, is_leaf
from mbd_sim.compiler.schedule import arranged
from mbd_sim.compiler.series import Integral, Recurrence, SeriesList, Sum


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
    for start, _ in series.series:
        operands = start.operands if is_leaf(start) else tuple(found[number] for number in start.operands)
        found.append(graph.node(start._replace(operands=operands)))
    return found


class _Coefficients:
    """The coefficients of series, order by order, as nodes of a graph."""

    def __init__(self, series: SeriesList) -> None:
        self.graph = GraphBuilder()
        self._series, self._results = series.series, series.results
        self._of: list[list[int]] = [[number] for number in start_of(self.graph, series)]  # nodes, by series and order
        self._inverses = {number: self.graph.inverse(self._of[number][0]) for number in series.divisors}

    def add_order(self, k: int) -> None:
        """Add the coefficients k of all series; those of lower orders are there."""
        for number, series in enumerate(self._series):
            if isinstance(series.rule, Recurrence):
                value = self._following(series.rule, k)
            elif isinstance(series.rule, Integral):
                value = self._integral(series.rule.result, k)
            else:
                value = self.graph.constant(0.0)
            self._of[number].append(value)

    def state(self, component: int, k: int) -> int:
        """Coefficient k of a component of the state, one order higher than what is there at most."""
        return self._integral(component, k) if k else self.graph.input(1, component)

    def _following(self, rule: Recurrence, k: int) -> int:
        graph = self.graph
        sums = graph.total([graph.scaled(term.factor, self._sum(term, k)) for term in rule.sums])
        if rule.by_order:
            sums = graph.scaled(1.0 / k, sums)
        terms = [graph.scaled(factor, self._of[number][k]) for factor, number in rule.terms]
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

    def _derivative(self, number: int, j: int) -> int:
        """j times coefficient j: of an integral, the coefficient j − 1 of what it is the integral of."""
        rule = self._series[number].rule
        if isinstance(rule, Integral):
            return self._of[self._results[rule.result]][j - 1]
        return self.graph.scaled(float(j), self._of[number][j])
