"""Which sines and cosines are computed together, as one vector: those of angles that are inputs, up to four at a time.

An evaluation of a chain has few other operations that could be done at the same time, and a sine with its cosine takes
some fifty operations, as many as the rest of the equations for one link.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import casadi as ca

from mbd_sim.compiler.instruction_list import Instruction

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
