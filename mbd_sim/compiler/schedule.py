"""Instruction lists arranged so that nothing waits: sums and products by the arrival of their terms, in order of need.

An evaluation of the rates waits for results most of its time: of two dozen operations that a processor could have under
way, a recursion along a chain has three. CasADi adds from left to right; here the terms of a sum that nobody else needs
are added as they arrive, the last one last, and a product goes into a fused multiply-add where that is no
later. Sums and products come out differently in the last place, but the same on every machine: the arrangement
depends on the list and on fixed latencies alone, and fused operations are defined by IEEE 754 as all others.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import casadi as ca

from mbd_sim.compiler.instruction_list import (
    MULTIPLY_ADD,
    MULTIPLY_SUBTRACT,
    SUBTRACT_PRODUCT,
    Graph,
    Instructions,
    Node,
    Program,
    graph_of,
    is_leaf,
)

# Cycles from operands to result, about as on current x86 cores. They decide what is written down, not what is right.
ADD, MULTIPLY, FUSED, DIVIDE, ROOT, TURN, CALL = 3, 3, 4, 13, 20, 45, 100
WIDE = 5  # operations for each cycle of the longest way, beyond which a processor is busy all the time
_LATENCY = {
    ca.OP_ASSIGN: 0,
    ca.OP_NEG: 1,
    ca.OP_FABS: 1,
    ca.OP_DIV: DIVIDE,
    ca.OP_INV: DIVIDE,
    ca.OP_SQRT: ROOT,
    ca.OP_SIN: TURN,
    ca.OP_COS: TURN,
    MULTIPLY_ADD: FUSED,
    MULTIPLY_SUBTRACT: FUSED,
    SUBTRACT_PRODUCT: FUSED,
    **dict.fromkeys((ca.OP_EXP, ca.OP_LOG, ca.OP_TAN, ca.OP_ASIN, ca.OP_ACOS, ca.OP_ATAN), CALL),
    **dict.fromkeys((ca.OP_TANH, ca.OP_POW, ca.OP_CONSTPOW, ca.OP_ATAN2), CALL),
}
_SUMS = frozenset({ca.OP_ADD, ca.OP_SUB})
_PRODUCTS = frozenset({ca.OP_MUL, ca.OP_SQ, ca.OP_TWICE})


def arranged(function: Instructions, *, fused: bool = True) -> Program:
    """The same function with its sums and products arranged, and its instructions in the order of need.

    Not `fused`, every product is rounded by itself, so that a b − b a is zero: for functions that are to find what
    vanishes.
    """
    graph = _Rebuilding(graph_of(function), fused).graph()
    return Program(function, graph, in_order_of_need(graph))


def latency(node: Node) -> int:
    """Cycles from a node's operands to its value."""
    return 0 if is_leaf(node) else _LATENCY.get(node.operation, ADD)


def in_order_of_need(graph: Graph) -> list[int]:
    """The nodes that outputs need, those with the longest way to the end first.

    Where a processor has enough to do at any time, nothing is gained by that, and more values wait in memory. Such a
    graph keeps its order.
    """
    ways = dict.fromkeys((output.node for output in graph.outputs), 0)
    for number in reversed(range(len(graph.nodes))):
        node = graph.nodes[number]
        if number in ways and not is_leaf(node):
            way = ways[number] + max(latency(node), 1)
            for operand in node.operands:
                ways[operand] = max(ways.get(operand, 0), way)
    if len(ways) > WIDE * max(ways.values(), default=0):
        return sorted(ways)
    return sorted(ways, key=lambda number: (-ways[number], number))


@dataclass(frozen=True)
class _Term:
    """A term of a sum, the product of one or two nodes, with its sign; `ready` is when it could be added."""

    factors: tuple[int, ...]
    negative: bool
    ready: int


class _Rebuilding:
    def __init__(self, old: Graph, fused: bool) -> None:
        self._old, self._fuses = old, fused
        self._nodes: list[Node] = []
        self._ready: list[int] = []
        self._numbers: dict[tuple[int, tuple[int, ...], str], int] = {}
        self._new: dict[int, int] = {}
        self._alone = self._used_once()
        self._shared = self._shared_divisors()

    def graph(self) -> Graph:
        """The arranged graph."""
        inside = self._inside()
        for number, node in enumerate(self._old.nodes):
            if number not in inside:
                self._new[number] = self._rebuilt(number, node)
        outputs = [
            type(output)(self._new[output.node], output.result, output.component) for output in self._old.outputs
        ]
        return Graph(self._nodes, outputs)

    def _used_once(self) -> set[int]:
        uses = [0] * len(self._old.nodes)
        for node in self._old.nodes:
            if not is_leaf(node):
                for operand in set(node.operands):
                    uses[operand] += 1
        for output in self._old.outputs:
            uses[output.node] += 2  # what is stored keeps its value to the bit
        return {number for number, count in enumerate(uses) if count == 1}

    def _shared_divisors(self) -> set[int]:
        by: dict[int, int] = {}
        for node in self._old.nodes:
            if node.operation in (ca.OP_DIV, ca.OP_INV):
                divisor = node.operands[-1]
                by[divisor] = by.get(divisor, 0) + 1
        return {divisor for divisor, count in by.items() if count > 1}

    def _is_product(self, node: Node) -> bool:
        return node.operation in _PRODUCTS or (node.operation == ca.OP_DIV and node.operands[1] in self._shared)

    def _inside(self) -> set[int]:
        """The nodes that become part of the only sum or product that uses them; but what is squared stays one."""
        inside: set[int] = set()
        for node in self._old.nodes:
            into_sum, into_product = node.operation in _SUMS, self._is_product(node)
            if not (into_sum or into_product) or node.operation == ca.OP_SQ:
                continue
            for operand in node.operands:
                other = self._old.nodes[operand]
                divisor = node.operation == ca.OP_DIV and operand == node.operands[1]
                if operand not in self._alone or divisor:
                    continue
                absorbed = self._is_product(other) or other.operation == ca.OP_NEG
                if absorbed or (into_sum and other.operation in _SUMS):
                    inside.add(operand)
        return inside

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
        """The new nodes whose product a node is, and whether that is to be turned round."""
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
            else:  # a square has its operand once
                waiting += node.operands * (2 if node.operation == ca.OP_SQ else 1)
        return found, negative

    def _reduced(self, factors: list[int]) -> tuple[int, ...]:
        """Two factors whose product is that of all: the earliest are multiplied first."""
        waiting = [(self._ready[factor], factor) for factor in factors]
        heapq.heapify(waiting)
        while len(waiting) > 2:
            product = self._product((heapq.heappop(waiting)[1], heapq.heappop(waiting)[1]))
            heapq.heappush(waiting, (self._ready[product], product))
        return tuple(sorted(factor for _, factor in waiting))

    def _product(self, factors: tuple[int, ...]) -> int:
        if len(factors) == 1:
            return factors[0]
        one, other = sorted(factors)
        return self._add(Node(ca.OP_SQ, (one,)) if one == other else Node(ca.OP_MUL, (one, other)))

    def _sum(self, terms: list[_Term]) -> int:
        """The terms added, always the two that are ready first."""
        waiting = [(term.ready, place, term) for place, term in enumerate(terms)]
        heapq.heapify(waiting)
        place = len(terms)
        while len(waiting) > 1:
            total = self._added(heapq.heappop(waiting)[2], heapq.heappop(waiting)[2])
            heapq.heappush(waiting, (total.ready, place, total))
            place += 1
        (last,) = (term for _, _, term in waiting)
        value = self._product(last.factors)
        return self._add(Node(ca.OP_NEG, (value,))) if last.negative else value

    def _added(self, early: _Term, late: _Term) -> _Term:
        """Two terms as one: the later of two products is fused, if that is no later than adding it."""
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
        key = node.operation, node.operands, float(node.value).hex()
        if key not in self._numbers:
            self._numbers[key] = len(self._nodes)
            self._nodes.append(node)
            start = 0 if is_leaf(node) else max(self._ready[operand] for operand in node.operands)
            self._ready.append(start + latency(node))
        return self._numbers[key]
