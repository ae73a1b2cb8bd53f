"""Which operations of like branches are alike: four legs take the same steps on numbers of their own.

The branches of a mechanism that have the same joints have the same recursion, with constants, coordinates and efforts
of their own. An operation belongs to a branch if its operands belong to that branch or to none. It is like one of
another branch if both do the same with operands that are alike (superword-level parallelism: Larsen & Amarasinghe,
PLDI 2000, where the seeds are adjacent stores; here they are the inputs of the branches).
"""

from __future__ import annotations

import operator
from collections.abc import Iterable, Mapping, Sequence
from typing import TypeAlias

import casadi as ca

from mbd_sim.compiler.lists.instruction_list import (
    MULTIPLY_ADD,
    MULTIPLY_SUBTRACT,
    SUBTRACT_PRODUCT,
    Graph,
    Node,
    is_leaf,
)

# Of one branch, the inputs that belong to it, by argument and component, in an order that is the same in like branches.
Branch: TypeAlias = Sequence[tuple[int, ...]]
Traits: TypeAlias = Sequence[tuple[int, ...]]  # of each node: DEPTH numbers of its uses, and one of its constants
Pack: TypeAlias = tuple[int, ...]  # the nodes of the lanes of a vector
WIDEST, WIDTHS = 4, (2, 4)  # lanes of a vector
ROUNDS = 2  # of the search: by operands, then also by uses
DEPTH = 4  # of the uses that nodes are compared by
_PAIRS = ((0, 1, 2, 3), (0, 2, 1, 3), (0, 3, 1, 2))  # the three ways in which four branches form two pairs
# Operations that differ in signs only are alike: x - y is x + (-y), and z - x y is (-x) y + z, to the bit.
SUMS = {
    ca.OP_ADD: (ca.OP_ADD, (False, False)),
    ca.OP_SUB: (ca.OP_ADD, (False, True)),
    MULTIPLY_ADD: (MULTIPLY_ADD, (False, False, False)),
    MULTIPLY_SUBTRACT: (MULTIPLY_ADD, (False, False, True)),
    SUBTRACT_PRODUCT: (MULTIPLY_ADD, (True, False, False)),
}


def like_operations(graph: Graph, likes: Sequence[Sequence[Branch]]) -> list[Pack]:
    """The operations that are alike in four or in two branches.

    :param likes: groups of branches that are like each other. A group of more than four is divided.
    :return: each with a node for each lane; of several ways to divide groups, the one that saves most operations.
    """
    traits = _traits(graph)
    return max((_packs(graph, sets, traits) for sets in _sets(likes)), key=saved)


def saved(packs: Sequence[Pack]) -> int:
    """How many operations fewer there are if those of a pack are one."""
    return sum(len(pack) - 1 for pack in packs)


def can_exchange(node: Node) -> bool:
    """Whether the first two operands can be exchanged, with their signs."""
    return node.operation in SUMS or node.operation == ca.OP_MUL


def _sets(likes: Sequence[Sequence[Branch]]) -> list[list[Sequence[Branch]]]:
    """Ways to give branches to lanes: by fours, and by pairs."""
    pairs = [[part for group in likes for part in _pairs(group, order)] for order in _PAIRS]
    if all(len(group) < WIDEST for group in likes):
        return pairs[:1]
    fours = [group[first : first + WIDEST] for group in likes for first in range(0, len(group) - WIDEST + 1, WIDEST)]
    rest = [part for group in likes for part in _pairs(group[len(group) // WIDEST * WIDEST :], _PAIRS[0])]
    return [[*fours, *rest], *pairs]


def _pairs(group: Sequence[Branch], order: Sequence[int]) -> list[Sequence[Branch]]:
    """The branches of a group two by two, in an order of each four."""
    complete = len(group) // WIDEST * WIDEST
    rows = [group[first + place] for first in range(0, complete, WIDEST) for place in order] + list(group[complete:])
    return [rows[first : first + 2] for first in range(0, len(rows) - 1, 2)]


def _packs(graph: Graph, sets: Sequence[Sequence[Branch]], traits: Traits) -> list[Pack]:
    """The operations that all branches of a set have: those of its first branch, with their likes."""
    nodes_of: dict[tuple[int, int], list[int]] = {}
    for number, index_and_lane in _lanes(graph, sets).items():
        nodes_of.setdefault(index_and_lane, []).append(number)
    packs: list[Pack] = []
    for index, branches in enumerate(sets):
        places = [{component: -2 - place for place, component in enumerate(branch)} for branch in branches]
        first = nodes_of.get((index, 0), [])
        own = {
            number: places[0][graph.nodes[number].operands] if is_leaf(graph.nodes[number]) else number
            for number in first
        }
        lanes = [{like: number for number, like in own.items()}]
        for lane in range(1, len(branches)):
            found = _matched(graph, own, nodes_of.get((index, lane), []), places[lane], traits)
            lanes.append({like: number for number, like in found.items()})
        packs += [
            tuple([lane[number] for lane in lanes])
            for number in first
            if not is_leaf(graph.nodes[number])
            and all(number in lane and _kind(graph.nodes[lane[number]]) == _kind(graph.nodes[number]) for lane in lanes)
        ]
    return packs


def _lanes(graph: Graph, sets: Sequence[Sequence[Branch]]) -> dict[int, tuple[int, int]]:
    """Of each node that belongs to a branch, the set and the lane of the branch."""
    inputs = {
        component: (index, lane)
        for index, branches in enumerate(sets)
        for lane, branch in enumerate(branches)
        for component in branch
    }
    lanes: dict[int, tuple[int, int]] = {}
    for number in graph.used:
        node = graph.nodes[number]
        if not is_leaf(node):
            own = {lanes[operand] for operand in node.operands if operand in lanes}
            if len(own) == 1:
                (lanes[number],) = own
        elif node.operation == ca.OP_INPUT and node.operands in inputs:
            lanes[number] = inputs[node.operands]
    return lanes


def _matched(
    graph: Graph, own: Mapping[int, int], others: Sequence[int], places: Mapping[tuple[int, ...], int], traits: Traits
) -> dict[int, int]:
    """For the nodes of another branch, those of the first one that are like them.

    Of several, it is the one that has most traits in common, then the first. Where the two branches add terms in
    different orders, nothing is alike until the sums are complete. These are found by their uses and by the inputs on
    which they depend, among the nodes that are like no other.

    :param own: the nodes of the first branch, each with itself; an input with the number of its place.
    :param places: the numbers of the places of the other branch's inputs.
    """
    first = [number for number, like in own.items() if like >= 0]
    depends = _dependencies(graph, own, {number: like for number, like in own.items() if like < 0})
    inputs = {number: places[graph.nodes[number].operands] for number in others if is_leaf(graph.nodes[number])}
    depends |= _dependencies(graph, others, inputs)
    candidates: dict[tuple[int, ...], list[int]] = {}
    for number in first:
        candidates.setdefault(_described(graph.nodes[number], own), []).append(number)
    found: dict[int, int] = {}
    by_use: dict[int, int] = {}  # those that are found by their uses
    for attempt in range(ROUNDS):
        alone: dict[tuple[int, int], list[int]] = {}
        if attempt:
            for number in sorted(set(first) - set(found.values()), reverse=True):
                alone.setdefault((depends[number], traits[number][DEPTH - 1]), []).append(number)
        found, taken = dict(inputs), set[int]()
        for number in others:
            if number in inputs:
                continue
            left = [c for c in candidates.get(_described(graph.nodes[number], found), ()) if c not in taken]
            if left:
                trait = (*traits[number], depends[number])
                common = [sum(map(operator.eq, (*traits[c], depends[c]), trait)) for c in left]
                found[number] = left[common.index(max(common))]
            else:
                same_use = alone.get((depends[number], traits[number][DEPTH - 1]), [])
                if number not in by_use and same_use:
                    by_use[number] = same_use.pop()
                if by_use.get(number, -1) in taken or number not in by_use:
                    continue
                found[number] = by_use[number]
            taken.add(found[number])
    return found


def _dependencies(graph: Graph, numbers: Iterable[int], inputs: Mapping[int, int]) -> dict[int, int]:
    """For each node of a branch, the places of the inputs of the branch on which it depends, as bits."""
    found: dict[int, int] = {}
    for number in numbers:
        if number in inputs:
            found[number] = 1 << -inputs[number]
        else:
            bits = 0
            for operand in graph.nodes[number].operands:
                bits |= found.get(operand, 0)
            found[number] = bits
    return found


def _described(node: Node, likes: Mapping[int, int]) -> tuple[int, ...]:
    """The kind of an operation and the likes of its operands, in the same order where that does not matter."""
    operands = [likes.get(operand, -1) for operand in node.operands]
    free = 2 if can_exchange(node) else 0
    return (_kind(node), *sorted(operands[:free]), *operands[free:])


def _kind(node: Node) -> int:
    """The operation; the same for those that differ in signs only."""
    return SUMS[node.operation][0] if node.operation in SUMS else node.operation


def _traits(graph: Graph) -> Traits:
    """Numbers that are equal for nodes with the same uses, the same uses of these and so on, and the same constants.

    Constants count without their signs, which differ between the left and the right.
    """
    nodes = graph.nodes
    users: list[list[int]] = [[] for _ in nodes]
    for number in graph.used:
        if not is_leaf(nodes[number]):
            for operand in nodes[number].operands:
                users[operand].append(number)
    numbers: dict[object, int] = {}
    stored = {output.node for output in graph.outputs}
    kinds = [(_kind(node), number in stored) for number, node in enumerate(nodes)]
    latest = [numbers.setdefault(kind, len(numbers)) for kind in kinds]
    found = []
    for _ in range(DEPTH):
        latest = [
            numbers.setdefault(
                (kind, latest[using[0]]) if len(using) == 1 else (kind, *sorted([latest[user] for user in using])),
                len(numbers),
            )
            for kind, using in zip(kinds, users, strict=True)
        ]
        found.append(latest)
    constants = [numbers.setdefault(_constants(graph, node), len(numbers)) for node in nodes]
    return list(zip(*found, constants, strict=True))


def _constants(graph: Graph, node: Node) -> tuple[float, ...]:
    """The sizes of the constants among the operands of a node."""
    if is_leaf(node):
        return ()
    operands = (graph.nodes[operand] for operand in node.operands)
    return tuple([abs(operand.value) for operand in operands if operand.operation == ca.OP_CONST])
