"""The algebra of CasADi expressions: six-dimensional vectors and matrices, and functions that keep them short.

A motion vector is [ω; v] and a force vector [moment; force], both expressed in a link's frame at its origin
(Featherstone, *Rigid Body Dynamics Algorithms*, ch. 2). Structural zeros are preserved, so that planar mechanisms cost
no more than planar equations.

A function of matrices can be traced once and then inlined by one call, instead of one call for each operator. An
operator on CasADi's matrices takes 20 to 50 µs in Python, most of it for the types of its operands; a call of a small
function takes 35 to 50 µs. CasADi simplifies each operation when it inlines it, so zeros and ones in the arguments save
the same operations as without. But it traces x * -c as -(x * c), which for a constant c would be one product with the
number -c: a function that changes the sign of an argument before it multiplies may give other expressions.

In a merged function that is not long, equal operations are done once. An expression can also be separated into
what can be computed early and what follows from it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import skew as numeric_skew
from mbd_sim.base.linear_algebra import inverse, product


def sparse(matrix: ca.SX) -> ca.SX:
    """The matrix with its zeros made structural: the same object if it has no others, as most have none."""
    return ca.sparsify(matrix) if matrix.has_zeros() else matrix


def constant(matrix: Array | ca.SX) -> ca.SX:
    """A matrix of numbers, or of numbers and symbols, with its zeros made structural."""
    if isinstance(matrix, ca.SX):
        return sparse(matrix)
    entries = np.asarray(matrix, dtype=float)
    return +_constant(entries.shape, entries.tobytes())


@functools.lru_cache(maxsize=1024)
def _constant(shape: tuple[int, ...], entries: bytes) -> ca.SX:
    """The matrix as a new one of CasADi, which takes much longer than a copy of it, such as +matrix."""
    return ca.SX(ca.sparsify(ca.DM(np.frombuffer(entries).reshape(shape))))


def is_symbolic(*values: object) -> bool:
    """Whether any of these numbers and matrices from a mechanism's records holds symbols."""
    return any(isinstance(value, ca.SX) for value in values)


def is_absent(value: float | ca.SX) -> bool:
    """Whether a number is zero, rather than a symbol whose value may be zero."""
    return not is_symbolic(value) and bool(value == 0.0)


def is_finite(value: float | ca.SX) -> bool:
    """Whether a limit can act: a finite number, or a symbol."""
    return is_symbolic(value) or bool(np.isfinite(value))


def zeros(rows: int, columns: int = 1) -> ca.SX:
    """A matrix of structural zeros."""
    return ca.SX(rows, columns)


def skew(v: ca.SX) -> ca.SX:
    """S (3, 3) with S @ w = v × w."""
    return sparse(ca.skew(v))


def motion_transform(R_AB: ca.SX, p_AB: ca.SX) -> ca.SX:
    """The matrix (6, 6) that takes motion vectors from frame A to frame B (Featherstone, eq. 2.24)."""
    R_BA = R_AB.T
    return sparse(
        ca.vertcat(
            ca.horzcat(R_BA, zeros(3, 3)),
            ca.horzcat(-R_BA @ skew(p_AB), R_BA),
        )
    )


def motion_cross(v: ca.SX) -> ca.SX:
    """C (6, 6) with C @ m = v × m for motion vectors (Featherstone, eq. 2.31)."""
    angular, linear = skew(v[:3]), skew(v[3:])
    return sparse(ca.vertcat(ca.horzcat(angular, zeros(3, 3)), ca.horzcat(linear, angular)))


def inertia_matrix(mass: float, center: Array, inertia: Array) -> Array:
    """Spatial inertia (6, 6) about the frame's origin (Featherstone, eq. 2.63).

    :param mass: kg.
    :param center: (3,) center of mass in m.
    :param inertia: (3, 3) about the center of mass in kg·m².
    """
    c = numeric_skew(center)
    return np.block([[inertia - mass * product(c, c), mass * c], [-mass * c, mass * np.eye(3)]])


def symmetric(matrix: ca.SX) -> ca.SX:
    """The matrix with its lower triangle copied from the upper one, so that each entry is computed once."""
    if matrix.numel() <= 1:
        return matrix
    given = matrix.sparsity()
    pattern, entries = _mirrored(matrix.size1(), tuple(given.colind()), tuple(given.row()))
    return ca.SX(pattern, matrix.nz[entries])


@functools.lru_cache(maxsize=1024)
def _mirrored(size: int, colind: tuple[int, ...], row: tuple[int, ...]) -> tuple[ca.Sparsity, list[int]]:
    """The pattern of a symmetric matrix, and its nonzeros as indices of those of a matrix with another pattern.

    `ca.triu2symm` is not used: it computes an entry x of the diagonal as x + x - x.
    """
    upper = ca.triu(ca.DM(ca.Sparsity(size, size, colind, row), range(1, len(row) + 1)))
    numbers = ca.sparsify(upper + ca.triu(upper, False).T)
    return numbers.sparsity(), [int(number) - 1 for number in numbers.nonzeros()]


class SpdFactors:
    """A symmetric positive definite matrix (n, n) as L D Lᵀ, without pivoting.

    `pivots` (n,) are in the order of the rows, each in the unit of its row. If the matrix is not definite, a pivot is
    not positive.
    """

    def __init__(self, matrix: ca.SX) -> None:
        self._matrix = matrix
        if matrix.is_scalar():
            self.pivots = matrix
        elif matrix.is_empty():
            self.pivots = ca.SX(0, 1)
        elif matrix.is_constant():
            inverse, numbers = inverse_spd(np.array(ca.DM(matrix)))
            self._inverse, self.pivots = constant(inverse), ca.SX(ca.DM(numbers))
        else:
            factors, transposed, order = ca.ldl(matrix)
            self.pivots = ca.SX(matrix.shape[0], 1)
            self.pivots[order] = factors
            self._ldl = factors, transposed, order

    def solve(self, right: ca.SX) -> ca.SX:
        """The solution (n, k) for a right side (n, k)."""
        if self._matrix.shape[0] == 0:
            return ca.SX(*right.shape)
        if self._matrix.shape[0] == 1:
            return right / self._matrix
        if self._matrix.is_constant():
            return sparse(self._inverse @ right)
        return sparse(ca.ldl_solve(right, *self._ldl))


def inverse_spd(matrix: Array) -> tuple[Array, Array]:
    """The inverse (n, n) of a symmetric positive definite matrix by L D Lᵀ, and its pivots (n,).

    Zeros stay zeros, and the units of the rows may differ by any factor. If the matrix is not definite, the first
    pivot that is not positive and all after it are zero, and the inverse is that of the block before it.
    """
    size = len(matrix)
    rest, lower, pivots = matrix.copy(), np.eye(size), np.zeros(size)
    for k in range(size):
        if not rest[k, k] > 0.0:
            break
        pivots[k] = rest[k, k]
        lower[k + 1 :, k] = rest[k + 1 :, k] / pivots[k]
        rest[k + 1 :, k + 1 :] -= np.outer(lower[k + 1 :, k], rest[k, k + 1 :])
    unit = inverse(lower)
    weighted = np.divide(1.0, pivots, where=pivots > 0.0, out=np.zeros(size))[:, None] * unit
    return product(unit.T, weighted), pivots


def inlined(function: Callable[..., ca.SX]) -> Callable[..., ca.SX]:
    """Trace a function of matrices once and inline it; the expressions are equal, with zeros made structural.

    :param function: of matrices, whose number and shapes may differ from call to call.
    """
    several = inlined_results(lambda *arguments: [function(*arguments)])
    return lambda *arguments: several(*arguments)[0]


def inlined_results(function: Callable[..., Sequence[ca.SX]]) -> Callable[..., list[ca.SX]]:
    """`inlined` for a function with several results."""
    traced: dict[tuple[tuple[int, int], ...], ca.Function] = {}

    def call(*arguments: ca.SX) -> list[ca.SX]:
        shapes = tuple([argument.shape for argument in arguments])
        if shapes not in traced:
            symbols = [ca.SX.sym("argument", *shape) for shape in shapes]
            results = [ca.densify(result) for result in function(*symbols)]
            traced[shapes] = ca.Function("inlined", symbols, results)
        return [sparse(result) for result in traced[shapes].call(arguments)]

    return call


# Instructions from which on CasADi does not look for equal operations. That takes 6 µs an instruction, a tenth of the
# time of a first build of a humanoid, and leaves out 2 to 5 % of them: those that the compiler arranges or optimizes it
# merges itself. In short functions CasADi also simplifies what it has merged, which leaves out up to a sixth.
LONG = 4000


def merged_function(name: str, inputs: Sequence[ca.SX], *outputs: ca.SX) -> ca.Function:
    """A function with dense outputs, which does equal operations once if it is not long."""
    arguments = name, list(inputs), [ca.densify(output) for output in outputs]
    function = ca.Function(*arguments)
    return function if function.n_instructions() >= LONG else ca.Function(*arguments, {"cse": True})


def separated(expression: ca.SX, given: ca.SX, right: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Symbols (m,) for all that depends on `given` only, their values, and the expression with these symbols."""
    reduced, symbols, values = ca.extract_parametric(expression, given)
    own = {entry.element_hash() for entry in [*ca.vertsplit(right), *symbols]}
    bare = [entry for entry in ca.symvar(reduced) if entry.element_hash() not in own]
    renamed = [ca.SX.sym(f"given_{index}") for index in range(len(bare))]
    reduced = ca.substitute(reduced, ca.vertcat(ca.SX(0, 1), *bare), ca.vertcat(ca.SX(0, 1), *renamed))
    memory, contents = (ca.vertcat(ca.SX(0, 1), *entries) for entries in ([*symbols, *renamed], [*values, *bare]))
    return memory, ca.densify(contents), reduced


def limited(value: ca.SX, limit: float | ca.SX) -> ca.SX:
    """A value within ± a limit, which may be infinite."""
    return between(value, -limit, limit) if is_finite(limit) else value


def between(value: ca.SX, lower: float | ca.SX, upper: float | ca.SX) -> ca.SX:
    """A value within bounds."""
    return ca.fmin(ca.fmax(value, lower), upper)


def within(value: ca.SX, bounds: tuple[float, float]) -> ca.SX:
    """A value within bounds, each of which may be infinite."""
    lower, upper = bounds
    value = ca.fmax(value, lower) if is_finite(lower) else value
    return ca.fmin(value, upper) if is_finite(upper) else value
