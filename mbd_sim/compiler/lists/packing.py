"""Like operations packed into vectors, with one lane for each branch of the mechanism, in an order of all operations.

Each lane takes the same IEEE operation on the same numbers as before. What this saves is mostly code: that of a
quadruped is twice as long as the instruction cache, and so it is fetched and decoded again in each evaluation.

Sines and cosines of angles that are inputs are also computed together, up to four at a time as one vector. An
evaluation of a chain has few other operations that could be done at the same time, and a sine with its cosine takes
some fifty operations, as many as the rest of the equations for one link.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import casadi as ca

from mbd_sim.compiler.lists.instruction_list import Graph, Instruction, Instructions, graph_of, instructions_of, is_leaf
from mbd_sim.compiler.lists.like_operations import SUMS, Branch, Pack, can_exchange, like_operations, saved
from mbd_sim.compiler.lists.schedule import latency

SHORTEST = 1000  # instructions that are packed: shorter code is in the cache in any case
WORTHWHILE = 0.85  # of the operations: how many are left at most
# Units from which on the order is depth first: fewer values wait on the stack, so that the code is shorter. That counts
# if the code is longer than the instruction cache.
LONG = 3000
# In that order, an operation waits while its operands are computed, and a processor holds only few that wait. So
# those that can begin sooner come first.
CANDIDATES = 40  # units of which one is next: any more lengthens lives, and thus code
PATIENCE = 8.0  # cycles that operands may still take when an operation is next
ISSUED = 0.4  # cycles from one operation to the next


@dataclass(frozen=True, slots=True)
class Unit:
    """An operation on one node for each lane; leaves have no operands.

    `operands` are, for each operand, the nodes of the lanes, and `negated` whether the signs of these change before.
    """

    operation: int
    nodes: Pack
    operands: tuple[Pack, ...] = ()
    negated: tuple[tuple[bool, ...], ...] = ()


@dataclass(frozen=True, slots=True)
class Packing:
    """The operations of a graph in order, in packs and alone."""

    graph: Graph
    units: Sequence[Unit]

    @property
    def cost(self) -> int:
        """The number of operations: of scalars, of vectors, and of those that form vectors and take them apart."""
        packs = {unit.nodes for unit in self.units if len(unit.nodes) > 1}
        inside = {node for pack in packs for node in pack}
        moved: dict[Pack, int] = {}
        for unit in self.units:
            for nodes in unit.operands:
                if len(nodes) > 1 and nodes not in packs:
                    moved[nodes] = _moves(self.graph, nodes)
                elif len(nodes) == 1 and nodes[0] in inside:
                    moved[nodes] = 1
        return sum(bool(unit.operands) for unit in self.units) + sum(moved.values())


def packed(program: Instructions, likes: Sequence[Sequence[Branch]]) -> Packing | None:
    """Pack the operations of like branches, or None if the code would not become much shorter.

    :param likes: see `like_operations`.
    """
    if not likes or len(instructions_of(program)) < SHORTEST:
        return None
    graph = graph_of(program)
    if _divides_twice(graph):
        return None  # which `lower` would do by one reciprocal
    packs = like_operations(graph, likes)
    operations = sum(not is_leaf(graph.nodes[node]) for node in graph.used)
    if operations - saved(packs) > WORTHWHILE * operations:
        return None
    packing = in_order(graph, packs)
    return packing if packing.cost <= WORTHWHILE * operations else None


def in_order(graph: Graph, packs: Sequence[Pack]) -> Packing:
    """All nodes that outputs depend on, in packs and alone, each after its operands.

    What is first in the graph comes first, but long lists are in depth-first order from the outputs. A pack that would
    have to precede itself is divided.
    """
    order = _Order(graph, packs).units
    pack_of = {node: number for number, nodes in enumerate(order) if len(nodes) > 1 for node in nodes}
    units = [_unit(graph, nodes, pack_of) for nodes in order]
    return Packing(graph, units if len(units) <= LONG else _staggered(graph, _depth_first(graph, units)))


def _depth_first(graph: Graph, units: Sequence[Unit]) -> list[Unit]:
    """The units in the order in which the outputs need them."""
    unit_of = {node: unit for unit in units for node in unit.nodes}
    order: dict[Pack, Unit] = {}
    waiting = [unit_of[output.node] for output in reversed(graph.outputs)]
    opened: set[Pack] = set()
    while waiting:
        unit = waiting[-1]
        if unit.nodes in opened:
            order.setdefault(unit.nodes, waiting.pop())
            continue
        opened.add(unit.nodes)
        needed = (unit_of[node] for nodes in unit.operands for node in nodes)
        waiting += [other for other in reversed(list(needed)) if other.nodes not in opened]
    return list(order.values())


def _staggered(graph: Graph, units: Sequence[Unit]) -> list[Unit]:
    """The units in nearly the same order, each when its operands are about to be known."""
    number_of = {node: number for number, unit in enumerate(units) for node in unit.nodes}
    users: list[list[int]] = [[] for _ in units]
    missing = [0] * len(units)  # of each unit, operands that are not in the new order yet
    for number, unit in enumerate(units):
        for operand in dict.fromkeys(number_of[node] for nodes in unit.operands for node in nodes):
            users[operand].append(number)
            missing[number] += 1
    known = [0.0] * len(units)  # when the operands in the new order are known
    waiting, following = list(range(min(CANDIDATES, len(units)))), CANDIDATES
    order, now = [], 0.0
    while waiting:
        soon = now + PATIENCE
        place = next((p for p, each in enumerate(waiting) if not missing[each] and known[each] <= soon), None)
        if place is None:
            ready = (p for p, each in enumerate(waiting) if not missing[each])
            place = min(ready, key=lambda p: known[waiting[p]])
        number = waiting.pop(place)
        if following < len(units):
            waiting.append(following)
            following += 1
        unit = units[number]
        order.append(unit)
        begin = max(now, known[number])
        if unit.operands:
            now = max(now + ISSUED, known[number] - PATIENCE)
        end = begin + latency(graph.nodes[unit.nodes[0]])
        for user in users[number]:
            missing[user] -= 1
            known[user] = max(known[user], end)
    return order


class _Order:
    """An order of packs and single nodes, `units`: what is first in the graph comes first."""

    def __init__(self, graph: Graph, packs: Sequence[Pack]) -> None:
        needed = graph.used
        self._unit_of: dict[int, Pack] = {node: pack for pack in packs for node in pack}
        self._users: dict[int, list[int]] = {}
        self._missing: dict[int, int] = {}  # for each node that is not ready, its operands without a place
        self._unready: dict[Pack, int] = {}  # for each pack without a place, its nodes that are not ready
        self._ready: list[tuple[int, Pack]] = []
        self.units: list[Pack] = []
        for pack in packs:
            self._unready[pack] = len(pack)
        for node in needed:
            operands = () if is_leaf(graph.nodes[node]) else dict.fromkeys(graph.nodes[node].operands)
            self._missing[node] = len(operands)
            for operand in operands:
                self._users.setdefault(operand, []).append(node)
        for node in needed:
            if self._missing[node] == 0:
                self._becomes_ready(node)
        self._run()
        for pack in sorted(packs):
            if pack in self._unready:  # it waits for itself, by way of nodes outside
                del self._unready[pack]
                for node in pack:
                    del self._unit_of[node]
                    if self._missing[node] == 0:
                        self._becomes_ready(node)
                self._run()

    def _becomes_ready(self, node: int) -> None:
        unit = self._unit_of.get(node)
        if unit is None:
            heapq.heappush(self._ready, (node, (node,)))
            return
        self._unready[unit] -= 1
        if self._unready[unit] == 0:
            del self._unready[unit]
            heapq.heappush(self._ready, (min(unit), unit))

    def _run(self) -> None:
        """Place all units that are ready, and those that thereby become ready."""
        while self._ready:
            _, unit = heapq.heappop(self._ready)
            self.units.append(unit)
            for node in unit:
                for user in self._users.get(node, ()):
                    self._missing[user] -= 1
                    if self._missing[user] == 0:
                        self._becomes_ready(user)


def _unit(graph: Graph, nodes: Pack, pack_of: Mapping[int, int]) -> Unit:
    """The operation on a pack or on a single node. Operands of the same pack are lined up, and so are constants."""
    first = graph.nodes[nodes[0]]
    if is_leaf(first):
        return Unit(first.operation, nodes)
    if len(nodes) == 1 or not can_exchange(first):
        operands = tuple(zip(*(graph.nodes[node].operands for node in nodes), strict=True))
        return Unit(first.operation, nodes, operands, ((False,) * len(nodes),) * len(operands))

    def place(operand: tuple[int, bool]) -> tuple[bool, int]:
        return graph.nodes[operand[0]].operation != ca.OP_CONST, pack_of.get(operand[0], -1)

    lanes = []
    for node in nodes:
        operation, given, _ = graph.nodes[node]
        kind, signs = SUMS.get(operation, (operation, (False, False)))
        if len(given) == 2:
            lanes.append(sorted(zip(given, signs, strict=True), key=place))
        else:  # the sign is that of the product, and goes to a constant factor if there is one
            (one, _), factor = sorted([(given[0], False), (given[1], False)], key=place)
            lanes.append([(one, signs[0]), factor, (given[2], signs[2])])
    columns = list(zip(*lanes, strict=True))
    return Unit(
        kind,
        nodes,
        tuple([tuple([operand for operand, _ in column]) for column in columns]),
        tuple([tuple([negated for _, negated in column]) for column in columns]),
    )


def _moves(graph: Graph, nodes: Pack) -> int:
    """The operations that form a vector of scalars; constants are free."""
    if all(graph.nodes[node].operation == ca.OP_CONST for node in nodes):
        return 0
    return 1 if len(set(nodes)) == 1 else len(nodes) - 1


def _divides_twice(graph: Graph) -> bool:
    """Whether two operations divide by the same number."""
    divisors = [node.operands[-1] for node in graph.nodes if node.operation in (ca.OP_DIV, ca.OP_INV)]
    return len(set(divisors)) < len(divisors)


LANES = 4
Component: TypeAlias = tuple[int, ...]  # an argument, and one of its components


def angle_groups(instructions: Sequence[Instruction], piece: range) -> dict[Component, Sequence[Component]]:
    """The group of each input that is an angle; what is needed first is in the first group.

    An input that the piece does not load itself belongs to no group, and neither does an angle that is left alone.
    Three of more angles fill a vector of four. Three alone belong to no group: the processor overlaps them in any case,
    and a step of a four-bar linkage took longer by 8 %. A group begins with its last component: of neighbours in
    ascending order LLVM makes one load, and a processor that has just stored them one by one waits for that.
    """
    inputs: dict[int, Component] = {}  # by index in the work vector
    angles: dict[Component, None] = {}
    for index in piece:
        operation, source, target, _ = instructions[index]
        if operation in (ca.OP_SIN, ca.OP_COS) and source[0] in inputs:
            angles[inputs[source[0]]] = None
        if operation == ca.OP_INPUT:
            inputs[target[0]] = source
        elif operation != ca.OP_OUTPUT:
            inputs.pop(target[0], None)
    order = list(angles)
    if len(order) == LANES - 1:
        return {}
    groups = [sorted(order[first : first + LANES], reverse=True) for first in range(0, len(order), LANES)]
    return {angle: group for group in groups if len(group) > 1 for angle in group}


def vector_size(count: int) -> int:
    """The number of lanes for so many angles: two or four."""
    return 2 if count <= 2 else LANES


def packed_angles(packs: Sequence[Component]) -> dict[Component, Sequence[Component]]:
    """For each pack of angles, or a single one, those that are computed with it as one vector.

    Those that are needed first are in the first group that has lanes left. Within a group the last ones are first, as
    in `angle_groups`. A pack that fills a vector or is left alone belongs to no group.
    """
    groups: list[list[Component]] = []
    for pack in dict.fromkeys(packs):
        room = [group for group in groups if sum(map(len, group)) + len(pack) <= LANES]
        if room:
            room[0].append(pack)
        else:
            groups.append([pack])
    ordered = [sorted(group, reverse=True) for group in groups if len(group) > 1]
    return {pack: group for group in ordered for pack in group}
