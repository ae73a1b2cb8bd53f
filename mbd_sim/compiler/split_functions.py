"""Long instruction lists cut into pieces: the time that a compiler takes grows with the square of a function's length.

The derivative of 30 rods, 110,000 instructions, compiles in 60 s as one function and in 6 s in pieces; it runs as fast.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import llvmlite.ir as ir

from mbd_sim.compiler.instruction_list import Instructions
from mbd_sim.compiler.ir_types import DOUBLE, element

PIECE = 4000  # instructions
UNCUT = 8000  # instructions up to which a list stays whole


def pieces(function: Instructions) -> Sequence[range]:
    """The instructions of a function, in order."""
    count = function.n_instructions()
    if count <= UNCUT:
        return [range(count)]
    return [range(first, min(first + PIECE, count)) for first in range(0, count, PIECE)]


def handed_on(function: Instructions, cut: Sequence[range]) -> list[set[int]]:
    """The places of the work vector that each piece sets and a later one reads."""
    needed: set[int] = set()
    found = []
    for piece in reversed(cut):
        after, needed = needed, set(needed)
        made = set()
        for index in reversed(piece):
            operation = function.instruction_id(index)
            if operation != ca.OP_OUTPUT:
                made.add(function.instruction_output(index)[0])
                needed.discard(function.instruction_output(index)[0])
            if operation not in (ca.OP_INPUT, ca.OP_CONST):
                needed.update(function.instruction_input(index))
        found.append(after & made)
    return found[::-1]


class Work(dict[int, ir.Value]):
    """The work vector within a piece: what the piece has not set itself comes from memory."""

    def __init__(self, builder: ir.IRBuilder, memory: ir.Value) -> None:
        super().__init__()
        self._builder, self._memory = builder, memory

    def __missing__(self, place: int) -> ir.Value:
        self[place] = self._builder.load(element(self._builder, self._memory, place), typ=DOUBLE)
        return self[place]

    def hand_on(self, places: set[int]) -> None:
        """Write places to memory."""
        for place in sorted(places):
            self._builder.store(self[place], element(self._builder, self._memory, place))
