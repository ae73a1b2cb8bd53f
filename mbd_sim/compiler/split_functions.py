"""Long instruction lists split into several functions, as compile time grows with the square of a function's length.

The derivative of 30 rods, 110,000 instructions, compiles in 60 s as one function and in 6 s split; it runs as fast.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from mbd_sim.compiler.instruction_list import Instruction
from mbd_sim.compiler.ir import Value
from mbd_sim.compiler.ir_builder import IRBuilder
from mbd_sim.compiler.ir_types import DOUBLE, element

PIECE = 4000  # instructions of one function
UNSPLIT = 8000  # instructions up to which a list stays one function


def pieces(count: int) -> Sequence[range]:
    """The ranges of instructions that become functions, in order."""
    if count <= UNSPLIT:
        return [range(count)]
    return [range(first, min(first + PIECE, count)) for first in range(0, count, PIECE)]


def live_out(instructions: Sequence[Instruction], split: Sequence[range]) -> list[set[int]]:
    """The indices in the work vector that each piece sets and a later one reads."""
    needed: set[int] = set()
    found = []
    for piece in reversed(split):
        after, needed = needed, set(needed)
        defined = set()
        for index in reversed(piece):
            operation, source, target, _ = instructions[index]
            if operation != ca.OP_OUTPUT:
                defined.add(target[0])
                needed.discard(target[0])
            if operation not in (ca.OP_INPUT, ca.OP_CONST):
                needed.update(source)
        found.append(after & defined)
    return found[::-1]


class PieceWork(dict[int, Value]):
    """The work vector within a piece: values that the piece has not set are loaded from memory."""

    def __init__(self, builder: IRBuilder, memory: Value) -> None:
        super().__init__()
        self._builder, self._memory = builder, memory

    def __missing__(self, index: int) -> Value:
        self[index] = self._builder.load(element(self._builder, self._memory, index), typ=DOUBLE)
        return self[index]

    def save(self, indices: set[int]) -> None:
        """Store some values to memory, for later pieces."""
        for index in sorted(indices):
            self._builder.store(self[index], element(self._builder, self._memory, index))
