"""Functions with sections that repeat to LLVM IR: a loop for each group of like sections, over tables of what differs.

Each operation is the one of `mbd_sim.compiler.lists.lowering`, so that the results have the same bits. What this saves
is the compilation: of twenty balls that can touch each other, nine tenths of the operations are in such sections.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from typing import TypeAlias

import casadi as ca

from mbd_sim.compiler.ir.builder import DOUBLE, INT, IRBuilder, element, integer, local_array, number
from mbd_sim.compiler.ir.lanes import LaneBuilder
from mbd_sim.compiler.ir.module import Function, Module, Value
from mbd_sim.compiler.ir.vectors import LANES, load, loop, store
from mbd_sim.compiler.lists.instruction_list import (
    Graph,
    InstructionList,
    Instructions,
    Node,
    Output,
    graph_of,
    is_leaf,
)
from mbd_sim.compiler.lists.lowering import Lowering, define, lower
from mbd_sim.compiler.lists.repeats import LikeSections, Repeats, find_repeats

SHORTEST = 4000  # instructions from which on like sections are looked for
WORTHWHILE = 0.4  # of the operations, which loops must save

Column: TypeAlias = tuple["int | None", Sequence[float]]  # an argument, and where in it; or None, and constants


def lower_repeated(module: Module, function: Instructions, inline: bool, *, as_interpreted: bool = False) -> Function:
    """Emit a function as `lower` does, with loops over the sections that repeat if that saves much."""
    if function.n_instructions() < SHORTEST:
        return lower(module, function, inline, as_interpreted=as_interpreted)
    graph = graph_of(function)
    if not as_interpreted:
        graph = _with_reciprocals(graph)
    repeats = find_repeats(graph)
    if repeats.saved < WORTHWHILE * sum(not is_leaf(graph.nodes[node]) for node in graph.used):
        return lower(module, function, inline, as_interpreted=as_interpreted)
    return _Repeated(module, function, graph, repeats, as_interpreted).emit(inline)


def _with_reciprocals(graph: Graph) -> Graph:
    """The graph with one reciprocal for all divisions by the same number, as `lower` computes them."""
    divisors: dict[int, list[int]] = {}
    for node in graph.used:
        operation, operands, _ = graph.nodes[node]
        if operation in (ca.OP_DIV, ca.OP_INV):
            divisors.setdefault(operands[-1], []).append(node)
    shared = {divisor for divisor, nodes in divisors.items() if len(nodes) > 1}
    nodes, moved, inverses = list[Node](), dict[int, int](), dict[int, int]()
    for index in graph.used:
        operation, operands, value = graph.nodes[index]
        if not is_leaf(graph.nodes[index]):
            divides = operation in (ca.OP_DIV, ca.OP_INV) and operands[-1] in shared
            operands = tuple([moved[operand] for operand in operands])
            if divides:
                divisor = operands[-1]
                if divisor not in inverses:
                    inverses[divisor] = len(nodes)
                    nodes.append(Node(ca.OP_INV, (divisor,)))
                if operation == ca.OP_INV:
                    moved[index] = inverses[divisor]
                    continue
                operation, operands = ca.OP_MUL, (operands[0], inverses[divisor])
        moved[index] = len(nodes)
        nodes.append(Node(operation, operands, value))
    return Graph(nodes, [Output(moved[node], result, component) for node, result, component in graph.outputs])


class _Repeated:
    """The emission of a function: the first groups, then what does not repeat, then the last groups.

    What these take from each other is in an array, `shared`: the values of the first groups, then the other ones.
    """

    def __init__(
        self, module: Module, function: Instructions, graph: Graph, repeats: Repeats, as_interpreted: bool
    ) -> None:
        self._module, self._function, self._graph = module, function, graph
        self._repeats, self._as_interpreted = repeats, as_interpreted
        self._inputs, self._arguments = function.n_in(), function.n_in() + function.n_out()
        self._outputs: dict[int, list[Output]] = {}
        for output in graph.outputs:
            self._outputs.setdefault(output.node, []).append(output)
        inside = {node for group in (*repeats.first, *repeats.last) for section in group.sections for node in section}
        self._alone = [node for node in graph.used if node not in inside and not is_leaf(graph.nodes[node])]
        taken = {node for group in repeats.last for operands in group.operands for node in operands}
        needed = taken | {operand for node in self._alone for operand in graph.nodes[node].operands}
        likes = [like for group in repeats.first for like in zip(*group.sections, strict=True)]
        found = [node for like in likes if any(node in needed for node in like) for node in like]
        kept = [node for node in self._alone if node in taken]
        self._places, self._found = {node: place for place, node in enumerate((*found, *kept))}, len(found)

    def emit(self, inline: bool) -> Function:
        """Emit all functions, and return the one that calls the others."""
        emitted, b = define(self._module, self._function.name(), self._arguments, inline, 1)
        shared = local_array(b, len(self._places))
        for group in self._repeats.first:
            b.call(self._emit_group(group), [*emitted.args, shared])
        alone = lower(self._module, self._rest(), inline=False, as_interpreted=self._as_interpreted)
        given, results = emitted.args[: self._inputs], emitted.args[self._inputs :]
        b.call(alone, [*given, shared, *results, element(b, shared, self._found)])
        for group in self._repeats.last:
            b.call(self._emit_group(group), [*emitted.args, shared])
        b.ret_void()
        return emitted

    def _rest(self) -> InstructionList:
        """What does not repeat, with one more argument and one more result: what it takes from groups and gives."""
        graph, nodes, alone = self._graph, [*self._graph.nodes], set(self._alone)
        outputs = [each for each in graph.outputs if each.node in alone or is_leaf(graph.nodes[each.node])]
        for node, place in self._places.items():
            if place < self._found:
                nodes[node] = Node(ca.OP_INPUT, (self._inputs, place))
            else:
                outputs.append(Output(node, self._function.n_out(), place - self._found))
        rest = Graph(nodes, outputs)
        return InstructionList(self._function, rest, rest.used).with_one_more(f"{self._function.name()}.alone")

    def _emit_group(self, group: LikeSections) -> Function:
        """Emit `void group(in…, out…, shared)`: the operations of the first section, for all sections."""
        name = f"{self._function.name()}.each.{group.sections[0][0]}"
        emitted, b = define(self._module, name, self._arguments + 1, False, 1)
        sources = [self._source(operands) for operands in zip(*group.operands, strict=True)]
        targets = [self._targets(nodes) for nodes in zip(*group.sections, strict=True)]
        rows = _PlaceTable(self._module, f"{name}.rows", [*sources, *(target for each in targets for target in each)])
        section, outside = group.sections[0], group.operands[0]

        def compute(block: Value) -> None:
            wide = LaneBuilder(b.block, LANES)
            low = Lowering(self._module, wide, False, self._as_interpreted)
            places = rows.of(b, block)
            values: dict[int, Value] = {}
            for node, (argument, _) in zip(outside, sources, strict=True):
                entries = next(places)
                taken = entries if argument is None else [load(b, emitted.args[argument], entry) for entry in entries]
                values[node] = taken[0] if len(taken) == 1 else wide.gathered(taken)
            for node, stores in zip(section, targets, strict=True):
                operation, operands, _ = self._graph.nodes[node]
                values[node] = low.operation(operation, *[values[operand] for operand in operands])
                for target, _ in stores:
                    for lane, entry in enumerate(next(places)):
                        store(b, wide.lane(wide.widened(values[node]), lane), emitted.args[target], entry)

        loop(b, 0, rows.blocks, compute)
        b.ret_void()
        return emitted

    def _source(self, nodes: Sequence[int]) -> Column:
        """Where like operands from outside are."""
        first = self._graph.nodes[nodes[0]]
        if first.operation == ca.OP_CONST:
            return None, [self._graph.nodes[node].value for node in nodes]
        if first.operation == ca.OP_INPUT:
            return first.operands[0], [self._graph.nodes[node].operands[1] for node in nodes]
        return self._arguments, [self._places[node] for node in nodes]

    def _targets(self, nodes: Sequence[int]) -> list[tuple[int, Sequence[float]]]:
        """Where the values of like operations are stored."""
        outputs = zip(*(self._outputs.get(node, ()) for node in nodes), strict=True)
        found: list[tuple[int, Sequence[float]]] = [
            (self._inputs + like[0].result, [each.component for each in like]) for like in outputs
        ]
        if nodes[0] in self._places:
            found.append((self._arguments, [self._places[node] for node in nodes]))
        return found


class _PlaceTable:
    """A table with a row for each section: where its operands and its results are, and its constants.

    `LANES` rows are a block; the last one is repeated until the last block is full.
    """

    def __init__(self, module: Module, name: str, columns: Sequence[Column]) -> None:
        self._columns = columns
        self._varying = [column for column in columns if len(set(map(_bits, column[1]))) > 1]
        rows = list(zip(*([_bits(entry) for entry in entries] for _, entries in self._varying), strict=True))
        rows += rows[-1:] * (-len(rows) % LANES)
        self.blocks = len(rows) // LANES
        self._table = module.table(name, [entry for row in rows for entry in row])

    def of(self, b: IRBuilder, block: Value) -> Iterator[list[Value]]:
        """For each column, the entries of the rows of a block, constants as numbers; one entry if all are equal."""
        width, varying = len(self._varying), 0
        first = b.gep(self._table, b.mul(block, integer(LANES * width)), INT)
        for column in self._columns:
            argument, entries = column
            if varying < width and column is self._varying[varying]:
                addresses = [b.gep(first, integer(lane * width + varying), INT) for lane in range(LANES)]
                yield [b.load(address, typ=DOUBLE if argument is None else INT) for address in addresses]
                varying += 1
            else:
                yield [number(float(entries[0])) if argument is None else integer(int(entries[0]))]


def _bits(entry: float) -> int:
    """An index, or a number as an integer with the same bits."""
    return entry if isinstance(entry, int) else int(struct.unpack("<q", struct.pack("<d", entry))[0])
