"""The construction of a graph of scalar operations, without those whose result is known."""

from __future__ import annotations

import math
from collections.abc import Iterable

import casadi as ca

from mbd_sim.compiler.instruction_list import Node


class GraphBuilder:
    """The `nodes` of a graph, each of them once; methods return the number of a node. Zeros and ones are left out."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self._numbers: dict[tuple[object, ...], int] = {}

    def node(self, node: Node) -> int:
        """Add an operation."""
        number = self._numbers.setdefault(node.key, len(self.nodes))
        if number == len(self.nodes):
            self.nodes.append(node)
        return number

    def input(self, argument: int, component: int) -> int:
        """A component of an argument."""
        return self.node(Node(ca.OP_INPUT, (argument, component)))

    def constant(self, value: float) -> int:
        """A number; −0 becomes 0."""
        return self.node(Node(ca.OP_CONST, (), value + 0.0))

    def total(self, terms: Iterable[int]) -> int:
        """The sum of the terms."""
        total = self.constant(0.0)
        for term in terms:
            total = self.sum(total, term)
        return total

    def sum(self, x: int, y: int) -> int:
        """Compute x + y."""
        if self._value(x) == 0.0:
            return y
        return x if self._value(y) == 0.0 else self.node(Node(ca.OP_ADD, (x, y)))

    def scaled(self, factor: float, x: int) -> int:
        """A multiple of x."""
        return self.product(self.constant(factor), x)

    def product(self, x: int, y: int) -> int:
        """Compute x y, which is 0 for a factor 0."""
        one, other = self._value(x), self._value(y)
        if one is not None and other is not None:
            return self.constant(one * other)
        if one is not None or other is not None:
            known, unknown = (one, y) if one is not None else (other, x)
            if known == 0.0:
                return self.constant(0.0)
            if known in (1.0, -1.0):
                return unknown if known == 1.0 else self.node(Node(ca.OP_NEG, (unknown,)))
        return self.node(Node(ca.OP_SQ, (x,)) if x == y else Node(ca.OP_MUL, (x, y)))

    def inverse(self, x: int) -> int:
        """Compute 1 / x."""
        known = self._value(x)
        return self.constant(1.0 / known) if known else self.node(Node(ca.OP_INV, (x,)))

    def _value(self, number: int) -> float | None:
        """The value of a constant."""
        node = self.nodes[number]
        return node.value if node.operation == ca.OP_CONST and math.isfinite(node.value) else None
