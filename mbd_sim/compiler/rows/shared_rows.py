"""Active rows that depend on each other and share their forces: solutions with the least sum of squares, as IR.

Of the rows of A x = r some form a basis B, and the others D depend on it. With S = A_BB⁻¹ A_BD all solutions are
x_B = A_BB⁻¹ r_B - S x_D; that with the least Σ w x² has (W_D + Sᵀ W_B S) x_D = Sᵀ W_B A_BB⁻¹ r_B. It does not depend on
the rows that are chosen as a basis. With given forces ρ these are x - ρ, and r is that less A ρ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from mbd_sim.compiler.ir.builder import DOUBLE, INT, TRUE, IRBuilder, element, integer, local_array, number
from mbd_sim.compiler.ir.dense_solver import DenseSolver, subtract_product, where_coupled
from mbd_sim.compiler.ir.module import POINTER, VOID, Function, FunctionType, Module, Value
from mbd_sim.compiler.ir.python_functions import emit_function
from mbd_sim.compiler.ir.vectors import Index, for_span, load, loop, store
from mbd_sim.compiler.rows.islands import MANY, find_islands


@dataclass(frozen=True)
class ActiveRows:
    """Row i of `rows` is active if input `first` + i is not zero; `solver` is counted, of the order `rows`.

    The first `gaps` rows are those of gaps, which are closed where the inputs before `first` are not zero.

    Where active rows depend on each other, the inputs are weights w, of which those of rows that depend on the other
    ones are negative. Of all solutions that with the least Σ w (x - ρ)² is taken, with the inputs ρ (rows,) from
    `given` on, which are zero unless rows share their forces.
    """

    rows: int
    first: int
    given: int
    solver: DenseSolver
    gaps: int = 0


def emit_active_solver(
    module: Module, name: str, active: ActiveRows, columns: int, *, adds_given: bool, watches: bool
) -> Function:
    """Emit `void name(inputs, matrix, right, solution)` of double pointers, with right sides one after the other.

    :param adds_given: False: ρ counts as zero.
    :param watches: while rows share their forces, the solution of each closed gap that is not active is w times what
        its force is less than zero: where that is negative, it would bear a force. That is -A_Biᵀ A_BB⁻ᵀ W_B (x - ρ)_B
        with the basis B.
    """
    n = active.rows
    shared = None
    if n > 1:
        shared = _emit_shared(module, f"{name}.shared", active, columns, adds_given=adds_given, watches=watches)
    function = Function(module, FunctionType(VOID, [POINTER] * 4), name)
    function.linkage = "internal"
    inputs, matrix, right, solution = function.args
    b = IRBuilder(function.append_basic_block("entry"))
    small, order, small_right, x, least = (local_array(b, size) for size in (n * n, n, n, n, 1))
    mask = element(b, inputs, active.first)
    if shared is not None:
        b.store(number(0.0), least)

        def fold(i: Value) -> None:
            weight, before = load(b, mask, i), load(b, least, 0)
            store(b, b.select(b.fcmp_ordered("<", weight, before), weight, before), least, 0)

        loop(b, 0, n, fold)
        with b.if_then(b.fcmp_ordered("<", load(b, least, 0), number(0.0)), likely=False):
            _call_for_islands(b, shared, function.args, active, columns)
            b.ret_void()
    chosen_row, (size,) = _choose(b, n, mask, ["!="])
    _gather(b, n, matrix, small, chosen_row, size, size)
    b.call(active.solver.factorize, [small, order, size])

    def solve_column(offset: Value) -> None:
        loop(b, 0, n, lambda i: store(b, number(0.0), solution, b.add(i, offset)))
        loop(b, 0, size, lambda i: store(b, load(b, right, b.add(chosen_row(i), offset)), small_right, i))
        b.call(active.solver.solve, [small, order, small_right, x, size])
        loop(b, 0, size, lambda i: store(b, load(b, x, i), solution, b.add(chosen_row(i), offset)))

    for column in range(columns):
        solve_column(integer(column * n))
    b.ret_void()
    return function


def _call_for_islands(
    b: IRBuilder, shared: Function, arguments: Sequence[Value], active: ActiveRows, columns: int
) -> None:
    """Call the function of `_emit_shared` for each island of rows."""
    n, (inputs, matrix, _, solution) = active.rows, arguments
    loop(b, 0, n * columns, lambda i: store(b, number(0.0), solution, i))
    if n < MANY:
        b.call(shared, arguments)
        return
    islands, first = b.alloca(INT, integer(n)), active.first
    find = emit_function(b.module, find_islands)
    closed, mask = element(b, inputs, first - active.gaps), element(b, inputs, first)
    count = b.call(find, [integer(n), integer(active.gaps), matrix, closed, mask, islands])
    loop(b, 0, count, lambda island: b.call(shared, [*arguments, islands, island]))


def _emit_shared(
    module: Module, name: str, active: ActiveRows, columns: int, *, adds_given: bool, watches: bool
) -> Function:
    """Emit the function of `emit_active_solver` for rows of which some depend on others.

    With many rows it takes the islands (rows,) and the number of one, whose part of the solution it finds.
    """
    n = active.rows
    function = Function(module, FunctionType(VOID, [POINTER] * 4 + [POINTER, INT] * (n >= MANY)), name)
    function.linkage, function.attributes = "internal", ["noinline"]
    inputs, matrix, right, solution, *island = function.args
    b = IRBuilder(function.append_basic_block("entry"))
    share = emit_shared_solver(module, n, active.solver)
    small, order, small_right, x, gains, weights = (local_array(b, size) for size in (n * n, n, n, n, n, n))
    total, mask = local_array(b, 1), element(b, inputs, active.first)
    given = element(b, inputs, active.given)
    belongs = partial(_belongs, b, island)
    chosen_row, (basis, size) = _choose(b, n, mask, [">", "<"], belongs)
    _gather(b, n, matrix, small, chosen_row, basis, size)
    b.call(active.solver.factorize, [small, order, basis])
    loop(b, 0, size, lambda i: store(b, b.intrinsic("llvm.fabs", load(b, mask, chosen_row(i))), weights, i))

    def watch(i: Value, offset: Value) -> None:
        source = b.mul(i, integer(n))
        loop(b, 0, basis, lambda j: store(b, load(b, matrix, b.add(chosen_row(j), source)), small_right, j))
        b.call(active.solver.solve, [small, order, small_right, gains, basis])
        b.store(number(0.0), total)

        def subtract(j: Value) -> None:
            bears = b.fmul(load(b, weights, j), load(b, x, j))
            b.store(b.fma(b.fneg(load(b, gains, j)), bears, b.load(total, typ=DOUBLE)), total)

        loop(b, 0, basis, subtract)
        store(b, b.load(total, typ=DOUBLE), solution, b.add(i, offset))

    closed = element(b, inputs, active.first - active.gaps)

    def watch_unloaded(gap: Value, offset: Value) -> None:
        is_closed = b.fcmp_unordered("!=", load(b, closed, gap), number(0.0))
        is_unloaded = b.and_(is_closed, b.fcmp_ordered("==", load(b, mask, gap), number(0.0)))
        with b.if_then(b.and_(belongs(gap), is_unloaded)):
            watch(gap, offset)

    def solve_column(offset: Value) -> None:
        loop(b, 0, basis, lambda i: store(b, load(b, right, b.add(chosen_row(i), offset)), small_right, i))
        if adds_given:
            loop(b, 0, n, lambda j: _subtract_given(b, n, matrix, given, small_right, chosen_row, basis, j))
        b.call(active.solver.solve, [small, order, small_right, x, basis])
        b.call(share, [small, order, weights, x, basis, size])
        if watches:
            loop(b, 0, active.gaps, lambda gap: watch_unloaded(gap, offset))
        if adds_given:
            loop(b, 0, size, lambda i: store(b, b.fadd(load(b, x, i), load(b, given, chosen_row(i))), x, i))
        loop(b, 0, size, lambda i: store(b, load(b, x, i), solution, b.add(chosen_row(i), offset)))

    for column in range(columns):
        solve_column(integer(column * n))
    b.ret_void()
    return function


def _belongs(b: IRBuilder, island: Sequence[Value], row: Value) -> Value:
    """Whether a row is one of an island, given by the islands (rows,) and its number; all are without."""
    return b.icmp_signed("==", b.load(b.gep(island[0], row, INT), typ=INT), island[1]) if island else TRUE


def _subtract_given(
    b: IRBuilder,
    n: int,
    matrix: Value,
    given: Value,
    right: Value,
    chosen_row: Callable[[Value], Value],
    basis: Value,
    j: Value,
) -> None:
    """Subtract the effect of the given force of row j from the right sides of a basis."""
    force = load(b, given, j)

    def subtract(i: Value) -> None:
        slope = load(b, matrix, b.add(chosen_row(i), b.mul(j, integer(n))))
        store(b, b.fma(b.fneg(slope), force, load(b, right, i)), right, i)

    with b.if_then(b.fcmp_unordered("!=", force, number(0.0))):
        loop(b, 0, basis, subtract)


def _choose(
    b: IRBuilder,
    n: int,
    mask: Value,
    comparisons: Sequence[str],
    belongs: Callable[[Value], Value] = lambda row: TRUE,
) -> tuple[Callable[[Value], Value], list[Value]]:
    """The rows that belong whose inputs compare with zero in the first of some ways, then in the next; their counts."""
    chosen, count, counts = b.alloca(INT, integer(max(n, 1))), b.alloca(INT), list[Value]()
    b.store(integer(0), count)

    def choose(i: Value, comparison: str) -> None:
        with b.if_then(b.and_(belongs(i), b.fcmp_unordered(comparison, load(b, mask, i), number(0.0)))):
            found = b.load(count, typ=INT)
            b.store(i, b.gep(chosen, found, INT))
            b.store(b.add(found, integer(1)), count)

    for comparison in comparisons:
        loop(b, 0, n, partial(choose, comparison=comparison))
        counts.append(b.load(count, typ=INT))
    return lambda index: b.load(b.gep(chosen, index, INT), typ=INT), counts


def _gather(
    b: IRBuilder, n: int, matrix: Value, small: Value, chosen_row: Callable[[Value], Value], rows: Value, columns: Value
) -> None:
    """Emit the copy of the chosen rows and columns of a matrix."""

    def gather_column(j: Value) -> None:
        source, target = b.mul(chosen_row(j), integer(n)), b.mul(j, integer(n))
        loop(b, 0, rows, lambda i: store(b, load(b, matrix, b.add(chosen_row(i), source)), small, b.add(i, target)))

    loop(b, 0, columns, gather_column)


def emit_shared_solver(module: Module, n: int, solver: DenseSolver) -> Function:
    """Emit `void share(matrix, order, weights, x, i64 basis, i64 size)`, if it is not there yet.

    The matrix (n, n), of which `size` rows are used, has those of the basis first, which are factorized with this
    `order`. x (n,) has A_BB⁻¹ r_B before, and the solution after it.
    """
    if (known := module.functions.get("share")) is not None:
        return known
    function = Function(module, FunctionType(VOID, [POINTER] * 4 + [INT] * 2), "share")
    function.linkage = "internal"
    matrix, order, weights, x, basis, size = function.args
    b = IRBuilder(function.append_basic_block("entry"))
    slopes, across, normal, right, found, small_order = (local_array(b, n) for n in (n * n, n * n, n * n, n, n, n))
    count = b.sub(size, basis)

    def at(array: Value, column: Index) -> Value:
        return element(b, array, b.mul(column, integer(n)) if isinstance(column, Value) else integer(column * n))

    def solve_column(j: Value) -> None:
        own = at(slopes, j)
        b.call(solver.solve, [matrix, order, at(matrix, b.add(basis, j)), own, basis])
        loop(b, 0, basis, lambda k: store(b, load(b, own, k), at(across, k), j))

    def add_row(k: Value) -> None:
        """Add what the row k of the basis contributes to the normal equations."""
        row, weight = at(across, k), load(b, weights, k)
        solved = b.fmul(weight, load(b, x, k))
        add_product(right, solved, row)
        loop(b, 0, count, lambda j: add_product(at(normal, j), b.fmul(weight, load(b, row, j)), row))

    def add_product(target: Value, factor: Value, vector: Value) -> None:
        def add(w: IRBuilder, i: Index) -> None:
            store(w, w.fma(factor, load(w, vector, i), load(w, target, i)), target, i)

        with where_coupled(b, n, factor):
            for_span(b, n, 0, count, add)

    def begin(j: Value) -> None:
        for_span(b, n, 0, count, lambda w, i: store(w, number(0.0), at(normal, j), i))
        store(b, load(b, weights, b.add(basis, j)), at(normal, j), j)
        store(b, number(0.0), right, j)

    def finish(j: Value) -> None:
        value = load(b, found, j)
        store(b, value, x, b.add(basis, j))
        subtract_product(b, n, 0, basis, x, value, at(slopes, j))

    loop(b, 0, count, solve_column)
    loop(b, 0, count, begin)
    loop(b, 0, basis, add_row)
    b.call(solver.factorize, [normal, small_order, count])
    b.call(solver.solve, [normal, small_order, right, found, count])
    loop(b, 0, count, finish)
    b.ret_void()
    return function
