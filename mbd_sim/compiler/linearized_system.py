"""A system linearized for a linearly implicit method, reduced to a dense system for the speeds.

Let z be the components before the core (coordinates), x the core (speeds), and w the components after it, on which no
rate depends (energies). Then (I − g J) U = r is

    (I − g A) z = r_z + g B x,    (I − g D) x = r_x + g C z,    w = r_w + g E z + g F x.

A is zero, or has small blocks for the rates of quaternions, so that z can be eliminated symbolically. That leaves a
dense system for x, half the size of the whole and so an eighth of the work.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True, eq=False)
class Linearized:
    """The three functions of a step.

    `at(t, y, inputs, g)` gives the memory (m,) of the other two, the matrix (n, n) of the core, and ∂f/∂t. Then
    `reduce(memory, r)` gives the right side (n,) of the core, and `expand(memory, r, x)` all of U from its solution x.
    If `timeless`, ∂f/∂t vanishes.
    """

    at: ca.Function
    reduce: ca.Function
    expand: ca.Function
    timeless: bool


def linearize_rates(rates: ca.Function, core: slice) -> Linearized:
    """Differentiate `rates(t, y, inputs)` exactly; `core` are the components of y that are solved for together."""
    t, y, inputs = (ca.SX.sym(name, rates.nnz_in(index)) for index, name in enumerate(("t", "y", "inputs")))
    g, right = ca.SX.sym("g"), ca.SX.sym("right", y.shape[0])
    slopes = rates.call([t, y, inputs])[0]
    jacobian = ca.sparsify(g * ca.jacobian(slopes, y))
    z, x, w = slice(0, core.start), core, slice(core.stop, y.shape[0])
    inverse = unit_inverse(jacobian[z, z])
    memory = Memory()
    b, c, e, f, inverse = (
        memory.keep(block) for block in (jacobian[z, x], jacobian[x, z], jacobian[w, z], jacobian[w, x], inverse)
    )
    matrix = ca.SX.eye(core.stop - core.start) - jacobian[x, x] - memory.substituted(c @ (inverse @ b))
    solution = ca.SX.sym("solution", matrix.shape[0])
    before = inverse @ (right[z] + b @ solution)
    after = right[w] + e @ before + f @ solution
    time_rates = ca.jacobian(slopes, t)
    small = ca.densify(right[x] + c @ (inverse @ right[z]))
    full = ca.densify(ca.vertcat(before, solution, after))
    options = {"cse": True}
    return Linearized(
        at=ca.Function(
            "linearize", [t, y, inputs, g], [memory.values, ca.densify(matrix), ca.densify(time_rates)], options
        ),
        reduce=ca.Function("reduce", [memory.symbols, right], [small], options),
        expand=ca.Function("expand", [memory.symbols, right, solution], [full], options),
        timeless=time_rates.nnz() == 0,
    )


class Memory:
    """Entries of matrices that are computed once in a step and used in every stage; constants are not stored."""

    def __init__(self) -> None:
        self._pairs: list[tuple[ca.SX, ca.SX]] = []

    def keep(self, matrix: ca.SX) -> ca.SX:
        """Keep the entries of a matrix, and return it with symbols in their place."""
        entries = []
        for value in ca.vertsplit(ca.vec(matrix.nz[:])) if matrix.nnz() else []:
            symbol = value if value.is_constant() else ca.SX.sym(f"m{len(self._pairs)}")
            if symbol is not value:
                self._pairs.append((symbol, value))
            entries.append(symbol)
        return ca.SX(matrix.sparsity(), ca.vertcat(ca.SX(0, 1), *entries))

    @property
    def symbols(self) -> ca.SX:
        """The symbols (m,) of the entries."""
        return ca.vertcat(ca.SX(0, 1), *(symbol for symbol, _ in self._pairs))

    @property
    def values(self) -> ca.SX:
        """The values (m,) of the entries."""
        return ca.densify(ca.vertcat(ca.SX(0, 1), *(value for _, value in self._pairs)))

    def substituted(self, expression: ca.SX) -> ca.SX:
        """An expression with the values in place of the symbols."""
        return ca.substitute([expression], [self.symbols], [self.values])[0]


def unit_inverse(blocks: ca.SX) -> ca.SX:
    """(I − `blocks`)⁻¹ by Gauss–Jordan elimination without exchange of rows.

    For the rates of quaternions `blocks` is skew, so that the pivots are never below 1.
    """
    size = blocks.shape[0]
    if blocks.nnz() == 0:
        return ca.SX.eye(size)
    rows = [{j: blocks[i, j] for j in range(size) if blocks.has_nz(i, j)} for i in range(size)]
    left = [{j: -value for j, value in row.items()} for row in rows]
    for i in range(size):
        left[i][i] = 1.0 + left[i].get(i, ca.SX(0))
    right: list[dict[int, ca.SX]] = [{i: ca.SX(1)} for i in range(size)]
    for pivot in range(size):
        inverse = 1.0 / left[pivot].pop(pivot)
        for side in (left, right):
            side[pivot] = {j: inverse * value for j, value in side[pivot].items()}
        for i in range(size):
            if i != pivot and pivot in left[i]:
                factor = left[i].pop(pivot)
                for side in (left, right):
                    for j, value in side[pivot].items():
                        side[i][j] = side[i].get(j, ca.SX(0)) - factor * value
    found = ca.SX(size, size)
    for i, row in enumerate(right):
        for j, value in row.items():
            found[i, j] = value
    return found
