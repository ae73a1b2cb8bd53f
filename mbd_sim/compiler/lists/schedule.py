"""Instruction lists arranged to shorten their critical path: sums and products in the order in which terms are ready.

An evaluation of the rates spends most of its time waiting for results: a processor could execute two dozen operations
at once, and a recursion along a chain offers three. CasADi adds from left to right. Here the terms of a sum that has no
other use are added in the order in which they become ready, and a product is fused into a multiply-add where that is
not later. Results differ in the last place from those of the original list, but are the same on every machine: the
arrangement depends only on the list and on fixed latencies, and IEEE 754 defines fused operations like all others.
"""

from __future__ import annotations

import heapq
from collections import Counter
from dataclasses import dataclass

import casadi as ca

from mbd_sim.compiler.lists.instruction_list import (
    MULTIPLY_ADD,
    MULTIPLY_SUBTRACT,
    SUBTRACT_PRODUCT,
    Graph,
    InstructionList,
    Instructions,
    Node,
    graph_of,
    is_leaf,
)

# Latencies in cycles, about those of current x86 cores. They affect the order of operations, not their correctness.
ADD, MULTIPLY, FUSED, DIVIDE, SQUARE_ROOT, SINE, CALL = 3, 3, 4, 13, 20, 45, 100
SATURATED = 5  # operations for each cycle of the critical path, beyond which a processor is always busy
_LATENCY = {
    ca.OP_INPUT: 0,
    ca.OP_CONST: 0,
    ca.OP_ASSIGN: 0,
    ca.OP_NEG: 1,
    ca.OP_FABS: 1,
    ca.OP_DIV: DIVIDE,
    ca.OP_INV: DIVIDE,
    ca.OP_SQRT: SQUARE_ROOT,
    ca.OP_SIN: SINE,
    ca.OP_COS: SINE,
    MULTIPLY_ADD: FUSED,
    MULTIPLY_SUBTRACT: FUSED,
    SUBTRACT_PRODUCT: FUSED,
    **dict.fromkeys((ca.OP_EXP, ca.OP_LOG, ca.OP_TAN, ca.OP_ASIN, ca.OP_ACOS, ca.OP_ATAN), CALL),
    **dict.fromkeys((ca.OP_TANH, ca.OP_POW, ca.OP_CONSTPOW, ca.OP_ATAN2), CALL),
}
_SUMS = frozenset({ca.OP_ADD, ca.OP_SUB})
_PRODUCTS = frozenset({ca.OP_MUL, ca.OP_SQ, ca.OP_TWICE})


def arranged(function: Instructions, *, fused: bool = True) -> InstructionList:
    """A copy of a function with its sums and products arranged, and its instructions in critical-path order.

    If not `fused`, every product is rounded by itself, so that a b − b a is exactly zero. Functions that detect what
    vanishes need that.
    """
    graph = _Rebuilding(graph_of(function), fused).graph()
    return InstructionList(function, graph, critical_path_order(graph))


def latency(node: Node) -> int:
    """Cycles from the operands of a node to its value."""
    return _LATENCY.get(node.operation, ADD)


def critical_path_order(graph: Graph) -> list[int]:
    """The nodes on which outputs depend, those with the longest path to an output first (list scheduling).

    A graph with enough independent operations that a processor is always busy keeps its order: it would gain nothing,
    and more values would wait in memory.
    """
    paths = dict.fromkeys((output.node for output in graph.outputs), 0)  # cycles from a node to the last output
    for number in reversed(range(len(graph.nodes))):
        node = graph.nodes[number]
        if number in paths and not is_leaf(node):
            path = paths[number] + max(latency(node), 1)
            for operand in node.operands:
                paths[operand] = max(paths.get(operand, 0), path)
    if len(paths) > SATURATED * max(paths.values(), default=0):
        return sorted(paths)
    return sorted(paths, key=lambda number: (-paths[number], number))


@dataclass(frozen=True, slots=True)
class _Term:
    """A term of a sum: the product of one or two nodes, and its sign; `ready` is the cycle when it can be added."""

    factors: tuple[int, ...]
    negative: bool
    ready: int


class _Rebuilding:
    """The construction of an arranged graph, node by node, from an old one."""

    def __init__(self, old: Graph, fused: bool) -> None:
        self._old, self._fuses = old, fused
        self._nodes: list[Node] = []
        self._ready: list[int] = []
        self._numbers: dict[tuple[object, ...], int] = {}
        self._new: dict[int, int] = {}
        self._single_use = self._used_once()
        self._shared = self._shared_divisors()

    def graph(self) -> Graph:
        """The arranged graph."""
        absorbed = self._absorbed()
        for number, node in enumerate(self._old.nodes):
            if number not in absorbed:
                self._new[number] = self._rebuilt(number, node)
        outputs = [output._replace(node=self._new[output.node]) for output in self._old.outputs]
        return Graph(self._nodes, outputs)

    def _used_once(self) -> set[int]:
        uses = [0] * len(self._old.nodes)
        for node in self._old.nodes:
            if not is_leaf(node):
                for operand in set(node.operands):
                    uses[operand] += 1
        for output in self._old.outputs:
            uses[output.node] += 2  # outputs are not absorbed: they keep their values to the bit
        return {number for number, count in enumerate(uses) if count == 1}

    def _shared_divisors(self) -> set[int]:
        divisors = Counter(node.operands[-1] for node in self._old.nodes if node.operation in (ca.OP_DIV, ca.OP_INV))
        return {divisor for divisor, count in divisors.items() if count > 1}

    def _is_product(self, node: Node) -> bool:
        return node.operation in _PRODUCTS or (node.operation == ca.OP_DIV and node.operands[1] in self._shared)

    def _absorbed(self) -> set[int]:
        """The nodes that become part of the only sum or product that uses them; the operand of a square does not."""
        absorbed: set[int] = set()
        for node in self._old.nodes:
            into_sum, into_product = node.operation in _SUMS, self._is_product(node)
            if not (into_sum or into_product) or node.operation == ca.OP_SQ:
                continue
            for operand in node.operands:
                other = self._old.nodes[operand]
                is_divisor = node.operation == ca.OP_DIV and operand == node.operands[1]
                if operand not in self._single_use or is_divisor:
                    continue
                is_factor = self._is_product(other) or other.operation == ca.OP_NEG
                if is_factor or (into_sum and other.operation in _SUMS):
                    absorbed.add(operand)
        return absorbed

    def _rebuilt(self, number: int, node: Node) -> int:
        if is_leaf(node):
            return self._add(node)
        if node.operation in _SUMS:
            return self._sum(self._terms(number))
        if self._is_product(node):
            factors, negative = self._factors(number)
            product = self._product(self._reduced(factors))
            return self._add(Node(ca.OP_NEG, (product,))) if negative else product
        if node.operation in (ca.OP_DIV, ca.OP_INV) and node.operands[-1] in self._shared:
            return self._inverse(self._new[node.operands[-1]])
        return self._add(Node(node.operation, tuple(self._new[operand] for operand in node.operands)))

    def _inverse(self, divisor: int) -> int:
        return self._add(Node(ca.OP_INV, (divisor,)))

    def _terms(self, number: int) -> list[_Term]:
        """The terms of a sum, from left to right."""
        found, waiting = [], [(number, False)]
        while waiting:
            number, negative = waiting.pop()
            node = self._old.nodes[number]
            if number in self._new:
                new = self._new[number]
                found.append(_Term((new,), negative, self._ready[new]))
            elif node.operation == ca.OP_NEG:
                waiting.append((node.operands[0], not negative))
            elif node.operation in _SUMS:
                one, other = node.operands
                waiting += [(other, negative != (node.operation == ca.OP_SUB)), (one, negative)]
            else:
                factors, minus = self._factors(number)
                pair = self._reduced(factors)
                ready = max(self._ready[factor] for factor in pair) + MULTIPLY
                found.append(_Term(pair, negative != minus, ready))
        return found

    def _factors(self, number: int) -> tuple[list[int], bool]:
        """The new nodes whose product a node is, and whether the product is to be negated."""
        found, negative, waiting = [], False, [number]
        while waiting:
            number = waiting.pop()
            node = self._old.nodes[number]
            if number in self._new:
                found.append(self._new[number])
            elif node.operation == ca.OP_NEG:
                negative = not negative
                waiting.append(node.operands[0])
            elif node.operation == ca.OP_DIV:
                found.append(self._inverse(self._new[node.operands[1]]))
                waiting.append(node.operands[0])
            elif node.operation == ca.OP_TWICE:
                found.append(self._add(Node(ca.OP_CONST, (), 2.0)))
                waiting.append(node.operands[0])
            else:  # a square names its operand once
                waiting += node.operands * (2 if node.operation == ca.OP_SQ else 1)
        return found, negative

    def _reduced(self, factors: list[int]) -> tuple[int, ...]:
        """At most two factors with the same product: those that are ready first are multiplied first."""
        if len(factors) <= 2:
            return tuple(sorted(factors))
        waiting = [(self._ready[factor], factor) for factor in factors]
        heapq.heapify(waiting)
        while len(waiting) > 2:
            product = self._product((heapq.heappop(waiting)[1], heapq.heappop(waiting)[1]))
            heapq.heappush(waiting, (self._ready[product], product))
        return tuple(sorted(factor for _, factor in waiting))

    def _product(self, factors: tuple[int, ...]) -> int:
        if len(factors) == 1:
            return factors[0]
        one, other = factors
        if one == other:
            return self._add(Node(ca.OP_SQ, (one,)))
        return self._add(Node(ca.OP_MUL, factors if one < other else (other, one)))

    def _sum(self, terms: list[_Term]) -> int:
        """The sum of the terms: the two that are ready first are added first."""
        waiting = [(term.ready, number, term) for number, term in enumerate(terms)]
        heapq.heapify(waiting)
        number = len(terms)
        while len(waiting) > 1:
            total = self._added(heapq.heappop(waiting)[2], heapq.heappop(waiting)[2])
            heapq.heappush(waiting, (total.ready, number, total))
            number += 1
        (last,) = (term for _, _, term in waiting)
        value = self._product(last.factors)
        return self._add(Node(ca.OP_NEG, (value,))) if last.negative else value

    def _added(self, early: _Term, late: _Term) -> _Term:
        """The sum of two terms: a product is fused, the later one first, if that is not later than an addition."""
        for fused, other in ((late, early), (early, late)):
            if self._fuses and len(fused.factors) == 2:
                ready = max(*(self._ready[factor] for factor in fused.factors), other.ready) + FUSED
                if ready <= late.ready + ADD:
                    return self._fused(fused, other)
        one, two = self._product(early.factors), self._product(late.factors)
        if early.negative == late.negative:
            return self._single(Node(ca.OP_ADD, tuple(sorted((one, two)))), early.negative)
        return self._single(Node(ca.OP_SUB, (two, one) if early.negative else (one, two)), False)

    def _fused(self, product: _Term, other: _Term) -> _Term:
        operands = (*product.factors, self._product(other.factors))
        if product.negative == other.negative:
            return self._single(Node(MULTIPLY_ADD, operands), product.negative)
        return self._single(Node(SUBTRACT_PRODUCT if product.negative else MULTIPLY_SUBTRACT, operands), False)

    def _single(self, node: Node, negative: bool) -> _Term:
        number = self._add(node)
        return _Term((number,), negative, self._ready[number])

    def _add(self, node: Node) -> int:
        number = self._numbers.setdefault(node.key if node.operation == ca.OP_CONST else node, len(self._nodes))
        if number == len(self._nodes):
            ready = self._ready
            start = 0 if is_leaf(node) else max([ready[operand] for operand in node.operands])
            self._nodes.append(node)
            ready.append(start + latency(node))
        return number
