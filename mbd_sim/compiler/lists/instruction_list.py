"""Lists of scalar operations on a work vector, with the same interface as a CasADi function.

A list can be read as a graph. A graph is built without the operations whose result is known.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Collection, Iterable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeAlias

import casadi as ca

# x y + z, x y − z and z − x y of the operands (x, y, z), rounded once: operations that CasADi does not have.
MULTIPLY_ADD, MULTIPLY_SUBTRACT, SUBTRACT_PRODUCT = -1, -2, -3

Instructions: TypeAlias = "ca.Function | InstructionList"


_LEAVES = frozenset({ca.OP_INPUT, ca.OP_CONST})


class Instruction(NamedTuple):
    """An operation on entries of the work vector: `source` are the indices that are read, `target` the one that is set.

    Of an input, `source` is the argument and its component; of an output, `target` is the result and its component. A
    constant has a `value`.
    """

    operation: int
    source: tuple[int, ...]
    target: tuple[int, ...]
    value: float = 0.0


class Node(NamedTuple):
    """An operation on the values of earlier nodes, given by their numbers.

    The `operands` of an input are its argument and component; a constant has a `value`.
    """

    operation: int
    operands: tuple[int, ...] = ()
    value: float = 0.0

    @property
    def key(self) -> tuple[object, ...]:
        """Equal for nodes with the same value, to the bit."""
        return (ca.OP_CONST, float(self.value).hex()) if self.operation == ca.OP_CONST else self


class Output(NamedTuple):
    """A node, and the component of a result to which its value is stored."""

    node: int
    result: int
    component: int


@dataclass(frozen=True, eq=False)
class Graph:
    """The operations of a function, each one after its operands, and its outputs."""

    nodes: Sequence[Node]
    outputs: Sequence[Output]

    @cached_property
    def used(self) -> Sequence[int]:
        """The nodes on which outputs depend, in order."""
        nodes = self.nodes
        used = {output.node for output in self.outputs}
        for number in reversed(range(len(nodes))):
            if number in used:
                operation, operands, _ = nodes[number]
                if operation not in _LEAVES:
                    used.update(operands)
        return sorted(used)


def is_leaf(node: Node) -> bool:
    """Whether a node is an input or a constant: its operands are not nodes."""
    return node.operation in _LEAVES


def instructions_of(function: Instructions) -> Sequence[Instruction]:
    """The instructions in order. Those of CasADi are costly to read, so that this is done once for all uses."""
    if isinstance(function, InstructionList):
        return function.instructions
    found = []
    for index in range(function.n_instructions()):
        operation = function.instruction_id(index)
        source, target = function.instruction_input(index), function.instruction_output(index)
        value = function.instruction_constant(index) if operation == ca.OP_CONST else 0.0
        found.append(Instruction(operation, tuple(source), tuple(target), value))
    return found


def graph_of(function: Instructions) -> Graph:
    """The instructions as a graph, without the work vector; equal operations become one node."""
    numbers: dict[tuple[object, ...], int] = {}
    nodes: list[Node] = []
    outputs: list[Output] = []
    stored = [-1] * function.sz_w()  # for each entry of the work vector, the node whose value it has
    for operation, source, target, value in instructions_of(function):
        if operation == ca.OP_OUTPUT:
            outputs.append(Output(stored[source[0]], target[0], target[1]))
            continue
        node = Node(operation, source if operation in _LEAVES else tuple([stored[index] for index in source]), value)
        number = numbers.setdefault(node.key if operation == ca.OP_CONST else node, len(nodes))
        if number == len(nodes):
            nodes.append(node)
        stored[target[0]] = number
    return Graph(nodes, outputs)


def zero_components(function: Instructions) -> list[int]:
    """The components of the first result that are the constant zero."""
    graph = graph_of(function)
    return [
        output.component
        for output in graph.outputs
        if output.result == 0 and graph.nodes[output.node] == Node(ca.OP_CONST, (), 0.0)
    ]


def passed_on(function: Instructions, argument: int) -> frozenset[int]:
    """The components of the first result that are the same components of an argument."""
    graph = graph_of(function)
    return frozenset(
        output.component
        for output in graph.outputs
        if output.result == 0 and graph.nodes[output.node] == Node(ca.OP_INPUT, (argument, output.component))
    )


def _last_uses(graph: Graph, order: Sequence[int]) -> dict[int, int]:
    """For each node, the last position in the order at which its value is used."""
    nodes = graph.nodes
    last = {number: step for step, number in enumerate(order)}
    for step, number in enumerate(order):
        operation, operands, _ = nodes[number]
        if operation not in _LEAVES:
            for operand in operands:
                last[operand] = step
    return last


class InstructionList:
    """The instructions of a graph in a given order, on a work vector that is as short as that order allows."""

    def __init__(self, like: Instructions, graph: Graph, order: Sequence[int]) -> None:
        """Take the name and the number of arguments from `like`; `order` contains the nodes that are needed."""
        self._name, self._in, self._out = like.name(), like.n_in(), like.n_out()
        self.instructions: list[Instruction] = []
        self._size = 0
        outputs: dict[int, list[Output]] = {}
        for output in graph.outputs:
            outputs.setdefault(output.node, []).append(output)
        last_use = _last_uses(graph, order)
        slots: dict[int, int] = {}  # the index in the work vector of each node
        free: list[int] = []
        for step, number in enumerate(order):
            operation, source, value = graph.nodes[number]
            if operation not in _LEAVES:
                for operand in set(source):
                    if last_use[operand] == step:
                        heapq.heappush(free, slots[operand])
                source = tuple([slots[operand] for operand in source])
            if free:
                slots[number] = heapq.heappop(free)
            else:
                slots[number], self._size = self._size, self._size + 1
            self.instructions.append(Instruction(operation, source, (slots[number],), value))
            for output in outputs.get(number, ()):
                stored = Instruction(ca.OP_OUTPUT, (slots[number],), (output.result, output.component))
                self.instructions.append(stored)
            if last_use[number] == step:
                heapq.heappush(free, slots[number])

    def without(self, components: Collection[int]) -> InstructionList:
        """A copy that leaves some components of the first result as they are."""
        result = copy(self)
        result.instructions = [
            instruction
            for instruction in self.instructions
            if instruction.operation != ca.OP_OUTPUT or instruction.target[0] or instruction.target[1] not in components
        ]
        return result

    def with_one_more(self, name: str) -> InstructionList:
        """A copy under another name, with one more argument and one more result."""
        result = copy(self)
        result._name, result._in, result._out = name, self._in + 1, self._out + 1
        return result

    def name(self) -> str:
        """The function's name."""
        return self._name

    def n_in(self) -> int:
        """The number of arguments."""
        return self._in

    def n_out(self) -> int:
        """The number of results."""
        return self._out

    def sz_w(self) -> int:
        """The length of the work vector."""
        return self._size

    def n_instructions(self) -> int:
        """The number of instructions, including loads and stores."""
        return len(self.instructions)

    def instruction_id(self, index: int) -> int:
        """The operation: CasADi's, or one of this module."""
        return self.instructions[index].operation

    def instruction_input(self, index: int) -> tuple[int, ...]:
        """The indices in the work vector that are read, or the argument and its component."""
        return self.instructions[index].source

    def instruction_output(self, index: int) -> tuple[int, ...]:
        """The index in the work vector that is set, or the result and its component."""
        return self.instructions[index].target

    def instruction_constant(self, index: int) -> float:
        """The value of a constant."""
        return self.instructions[index].value


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
