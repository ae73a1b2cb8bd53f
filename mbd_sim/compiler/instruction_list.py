"""Instruction lists of our own, which read as a CasADi function's: scalar operations on a work vector."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import casadi as ca

# x y + z, x y − z and z − x y of the operands (x, y, z), rounded once. CasADi has no such operations.
MULTIPLY_ADD, MULTIPLY_SUBTRACT, SUBTRACT_PRODUCT = -1, -2, -3


Instructions: TypeAlias = "ca.Function | Program"


@dataclass(frozen=True)
class Node:
    """An operation on the values of earlier nodes, named by their numbers.

    An input has its argument and component for `operands`, a constant its `value`.
    """

    operation: int
    operands: tuple[int, ...] = ()
    value: float = 0.0


@dataclass(frozen=True)
class Output:
    """The component of a result that a node is stored to."""

    node: int
    result: int
    component: int


@dataclass(frozen=True, eq=False)
class Graph:
    """The operations of a function, each after its operands, and its outputs."""

    nodes: Sequence[Node]
    outputs: Sequence[Output]


def is_leaf(node: Node) -> bool:
    """Whether a node is an input or a constant, which has no operands that are nodes."""
    return node.operation in (ca.OP_INPUT, ca.OP_CONST)


def graph_of(function: Instructions) -> Graph:
    """The instructions without the places of the work vector; what is the same is there once."""
    numbers: dict[tuple[int, tuple[int, ...], str], int] = {}
    nodes: list[Node] = []
    outputs: list[Output] = []
    holds = [-1] * function.sz_w()
    for index in range(function.n_instructions()):
        operation = function.instruction_id(index)
        target, source = function.instruction_output(index), function.instruction_input(index)
        if operation == ca.OP_OUTPUT:
            outputs.append(Output(holds[source[0]], target[0], target[1]))
            continue
        operands: tuple[int, ...] = ()
        value = function.instruction_constant(index) if operation == ca.OP_CONST else 0.0
        if operation == ca.OP_INPUT:
            operands = (source[0], source[1])
        elif operation != ca.OP_CONST:
            operands = tuple(holds[place] for place in source)
        node = Node(operation, operands, value)
        key = operation, operands, float(value).hex()
        if key not in numbers:
            numbers[key] = len(nodes)
            nodes.append(node)
        holds[target[0]] = numbers[key]
    return Graph(nodes, outputs)


class Program:
    """A graph in a given order, its values in as few places as that order allows."""

    def __init__(self, like: Instructions, graph: Graph, order: Sequence[int]) -> None:
        """Take the name and the number of arguments of `like`; `order` has the nodes that are needed."""
        self._name, self._in, self._out = like.name(), like.n_in(), like.n_out()
        self._list: list[tuple[int, tuple[int, ...], tuple[int, ...], float]] = []
        ends: dict[int, list[Output]] = {}
        for output in graph.outputs:
            ends.setdefault(output.node, []).append(output)
        last = {number: step for step, number in enumerate(order)}
        for step, number in enumerate(order):
            if not is_leaf(graph.nodes[number]):
                for operand in graph.nodes[number].operands:
                    last[operand] = step
        places: dict[int, int] = {}
        free: list[int] = []
        self._places = 0
        for step, number in enumerate(order):
            node = graph.nodes[number]
            source = node.operands if is_leaf(node) else tuple(places[operand] for operand in node.operands)
            if not is_leaf(node):
                for operand in set(node.operands):
                    if last[operand] == step:
                        heapq.heappush(free, places[operand])
            if free:
                places[number] = heapq.heappop(free)
            else:
                places[number], self._places = self._places, self._places + 1
            self._list.append((node.operation, source, (places[number],), node.value))
            for output in ends.get(number, ()):
                self._list.append((ca.OP_OUTPUT, (places[number],), (output.result, output.component), 0.0))
            if last[number] == step:
                heapq.heappush(free, places[number])

    def name(self) -> str:
        """The function's name."""
        return self._name

    def n_in(self) -> int:
        """How many arguments."""
        return self._in

    def n_out(self) -> int:
        """How many results."""
        return self._out

    def sz_w(self) -> int:
        """The length of the work vector."""
        return self._places

    def n_instructions(self) -> int:
        """How many instructions, with loads and stores."""
        return len(self._list)

    def instruction_id(self, index: int) -> int:
        """The operation: one of CasADi's or of this module's."""
        return self._list[index][0]

    def instruction_input(self, index: int) -> tuple[int, ...]:
        """The places that are read, or the argument and its component."""
        return self._list[index][1]

    def instruction_output(self, index: int) -> tuple[int, ...]:
        """The place that is set, or the result and its component."""
        return self._list[index][2]

    def instruction_constant(self, index: int) -> float:
        """The number that is loaded."""
        return self._list[index][3]
