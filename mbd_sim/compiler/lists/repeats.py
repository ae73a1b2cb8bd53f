"""Sections of a function that repeat: the same operations on other values, as for each pair of bodies that may touch.

A section is what is connected among the operations that few results need, or among those that depend on few inputs.
What uses the former is one of them as well, and so are the operands of the latter: no section needs another one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import casadi as ca

from mbd_sim.compiler.lists.instruction_list import Graph, Node, is_leaf

FEWEST = 4  # sections that are worth a loop
FEW = (8, 12, 16, 20, 24, 32)  # results or inputs; what saves most is taken

Section: TypeAlias = tuple[int, ...]  # its nodes, in order
Description: TypeAlias = tuple[tuple[object, ...], ...]


@dataclass(frozen=True)
class LikeSections:
    """Sections that are alike, node by node, with the same number of `operands` from outside."""

    sections: Sequence[Section]
    operands: Sequence[tuple[int, ...]]

    @property
    def saved(self) -> int:
        """How many operations fewer there are in a loop over the sections."""
        return (len(self.sections) - 1) * len(self.sections[0])


@dataclass(frozen=True)
class Repeats:
    """The groups that need nothing but inputs, and those that nothing else needs."""

    first: Sequence[LikeSections]
    last: Sequence[LikeSections]

    @property
    def saved(self) -> int:
        """How many operations fewer there are."""
        return sum(group.saved for group in (*self.first, *self.last))


def find_repeats(graph: Graph) -> Repeats:
    """The sections that repeat; no node is in two of them."""
    last = _best(graph, _needed_by(graph))
    taken = {node for group in last for section in group.sections for node in section}
    first = _best(graph, {node: count for node, count in _depending_on(graph).items() if node not in taken})
    return Repeats(first, last)


def _best(graph: Graph, counts: Mapping[int, int]) -> list[LikeSections]:
    """The groups among the operations that have few results or inputs, whichever number saves most."""
    found, chosen = [], list[int]()
    for few in FEW:
        before, chosen = chosen, [node for node, count in counts.items() if count <= few]
        if few == FEW[0] or len(chosen) > len(before):
            found.append(_groups(graph, _connected(graph, chosen)))
    return max(found, key=lambda groups: sum(group.saved for group in groups))


def _needed_by(graph: Graph) -> dict[int, int]:
    """For each operation that few results need, how many do, in order."""
    needing: dict[int, set[int] | None] = {number: set() for number in graph.used}  # None: too many
    for place, output in enumerate(graph.outputs):
        needing[output.node] = _both(needing[output.node], {place})
    for number in reversed(graph.used):
        if not is_leaf(graph.nodes[number]):
            own = needing[number]
            for operand in graph.nodes[number].operands:
                needing[operand] = _both(needing[operand], own)
    return _counted(graph, needing)


def _depending_on(graph: Graph) -> dict[int, int]:
    """For each operation that depends on few inputs, on how many, in order."""
    needed: dict[int, set[int] | None] = {}  # None: too many
    for number in graph.used:
        operation, operands, _ = graph.nodes[number]
        own: set[int] | None = {number} if operation == ca.OP_INPUT else set()
        if not is_leaf(graph.nodes[number]):
            for operand in operands:
                own = _both(own, needed[operand])
        needed[number] = own
    return _counted(graph, needed)


def _both(one: set[int] | None, other: set[int] | None) -> set[int] | None:
    if one is None or other is None:
        return None
    both = one | other
    return both if len(both) <= FEW[-1] else None


def _counted(graph: Graph, sets: Mapping[int, set[int] | None]) -> dict[int, int]:
    found = ((number, sets[number]) for number in graph.used if not is_leaf(graph.nodes[number]))
    return {number: len(own) for number, own in found if own is not None}


def _connected(graph: Graph, chosen: Sequence[int]) -> list[Section]:
    """The chosen nodes, divided into those that are connected."""
    above = {number: number for number in chosen}

    def root(number: int) -> int:
        while above[number] != number:
            above[number] = above[above[number]]
            number = above[number]
        return number

    for number in chosen:
        for operand in graph.nodes[number].operands:
            if operand in above:
                above[root(operand)] = root(number)
    sections: dict[int, list[int]] = {}
    for number in chosen:
        sections.setdefault(root(number), []).append(number)
    return [tuple(section) for section in sections.values()]


def _groups(graph: Graph, sections: Sequence[Section]) -> list[LikeSections]:
    results: dict[int, list[int]] = {}
    for output in graph.outputs:
        results.setdefault(output.node, []).append(output.result)
    alike: dict[Description, tuple[list[Section], list[tuple[int, ...]]]] = {}
    lengths = Counter(map(len, sections))
    for section in sections:
        if lengths[len(section)] < FEWEST:
            continue
        description, operands = _described(graph, section, results)
        own, given = alike.setdefault(description, ([], []))
        own.append(section)
        given.append(operands)
    return [LikeSections(own, given) for own, given in alike.values() if len(own) >= FEWEST]


def _described(
    graph: Graph, section: Section, results: Mapping[int, Sequence[int]]
) -> tuple[Description, tuple[int, ...]]:
    """What is the same for like sections, and the operands from outside, each once."""
    own, outside = dict[int, int](), dict[int, int]()
    description: list[tuple[object, ...]] = []
    for place, number in enumerate(section):
        operation, operands, _ = graph.nodes[number]
        places = tuple(
            (own[operand],)
            if operand in own
            else (outside.setdefault(operand, len(outside)), *_origin(graph.nodes[operand]))
            for operand in operands
        )
        own[number] = place
        description.append((operation, places, *results.get(number, ())))
    return tuple(description), tuple(outside)


def _origin(node: Node) -> tuple[int, ...]:
    """Where a value comes from: a constant, an argument, or an operation."""
    if node.operation == ca.OP_INPUT:
        return node.operation, node.operands[0]
    return (node.operation if node.operation == ca.OP_CONST else -1,)
