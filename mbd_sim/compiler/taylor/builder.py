"""The Taylor series of the values of an instruction list.

With y' = f(t, y) each value of f is a function of time, and its series follows from those of its operands. Coefficient
k of y is coefficient k − 1 of f, divided by k.
"""

from __future__ import annotations

import casadi as ca

from mbd_sim.compiler.lists.instruction_list import (
    Graph,
    InstructionList,
    Instructions,
    Output,
    graph_of,
    is_leaf,
    zero_components,
)
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.compiler.taylor.rules import SeriesRules, guarded_pivot
from mbd_sim.compiler.taylor.series import SeriesList


class NotAnalyticError(Exception):
    """An operation whose value is no analytic function of time: its name, and the first result that depends on it."""

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
