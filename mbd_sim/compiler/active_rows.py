"""Functions with a linear system in the middle, of which only the active rows are solved, as IR."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from mbd_sim.compiler.dense_solver import DenseSolver
from mbd_sim.compiler.ir import POINTER, VOID, Function, FunctionType, Module, Value
from mbd_sim.compiler.ir_builder import IRBuilder
from mbd_sim.compiler.ir_types import INT, element, integer, local_array, number
from mbd_sim.compiler.ir_vectors import load, loop, store
from mbd_sim.compiler.lowering import lower
from mbd_sim.compiler.schedule import arranged
from mbd_sim.compiler.shared_rows import emit_shared_solver

ITERATIONS = 8  # of Newton's method for the directions of loads; each doubles the number of digits


@dataclass(frozen=True)
class Load:
    """A row in which friction is proportional to the size of a force N (k,) that is affine in the solution λ.

    Its numbers follow one another: c, a start direction (k,), N without λ (k,), and the slopes of N (k, rows) column by
    column. Where c is not 0, the row becomes λ_row + c |N| = 0.
    """

    row: int
    components: int


@dataclass(frozen=True)
class ActiveRows:
    """Row i of `rows` is active if input `first` + i is not zero; `solver` is counted, of the order `rows`.

    Where active rows depend on each other, inputs are negative: -w, for the solution with the least Σ w x² of these
    rows. After the elimination of the others it is W⁻¹ Aᵀ y with A W⁻¹ Aᵀ y = r, from a factorization of A W⁻¹ Aᵀ + ε I
    and by refinement.

    With `loads`, the system of the rates has their numbers as one more output.
    """

    rows: int
    first: int
    solver: DenseSolver
    loads: tuple[Load, ...] = ()


def emit_solved(
    module: Module,
    name: str,
    system: ca.Function,
    result: ca.Function,
    active: ActiveRows,
    *,
    fused: bool = True,
    reports_margin: bool = False,
    watches: bool = False,
) -> Function:
    """Emit `system`, if it is not there yet, `result`, and `void name(t, y, inputs, out[, margin])` of double pointers.

    `system(t, y, inputs)` gives a memory, a matrix (n, n), right sides (n, k) one after the other, and perhaps a
    margin; `result(memory, solution)`, or `result(t, y, inputs, solution)`, takes the solution, zero for all other
    rows. The margin is an argument if it is to be reported.

    :param watches: while rows share their forces, the solution of each other row is w times what its force is less
        than zero: where that is negative, it would bear a force.
    """
    has_loads = bool(active.loads) and system.n_out() > 3
    has_margin, takes_memory = system.n_out() > 3 + has_loads, result.n_in() == 2
    columns = system.nnz_out(2) // max(active.rows, 1)
    emitted_system = module.functions.get(system.name())
    if emitted_system is None:
        emitted_system = lower(module, arranged(system, fused=fused), inline=False)
    emitted_result = lower(module, arranged(result, fused=fused), inline=False)
    solve = _emit_solve(module, f"{name}.solve", active, columns, watches)
    function = Function(module, FunctionType(VOID, [POINTER] * (4 + reports_margin)), name)
    function.linkage = "internal"
    b = IRBuilder(function.append_basic_block("entry"))
    t, y, inputs, out, *margin = function.args
    memory = local_array(b, system.nnz_out(0))
    matrix, right = local_array(b, active.rows**2), local_array(b, active.rows * columns)
    solution = local_array(b, active.rows * columns)
    loads = [local_array(b, system.nnz_out(3))] if has_loads else []
    if has_margin and not margin:
        margin = [local_array(b, 1)]
    b.call(emitted_system, [t, y, inputs, memory, matrix, right, *loads, *margin])
    arguments = [element(b, inputs, active.first), matrix, right, solution]
    if has_loads:
        _emit_loaded(b, active, solve, arguments, loads[0])
    else:
        b.call(solve, arguments)
    given = [memory] if takes_memory else [t, y, inputs]
    b.call(emitted_result, [*given, solution, out])
    b.ret_void()
    return function


def _emit_loaded(b: IRBuilder, active: ActiveRows, solve: Function, arguments: list[Value], loads: Value) -> None:
    """Solve with the rows of loads along the directions of their forces, until these do not turn any more.

    Newton's method for λ_row + c |N| = 0 is the linear equation λ_row + c n N = 0 with the direction n of the last N.
    """
    _, matrix, right, solution = arguments
    n, starts, position = active.rows, [], 0
    for load_ in active.loads:
        starts.append(position)
        position += 1 + 2 * load_.components + load_.components * n

    def write_row(load_: Load, start: int) -> None:
        factor, k = load(b, loads, start), load_.components
        with b.if_then(b.fcmp_unordered("!=", factor, number(0.0))):
            for j in range(n):
                total = number(1.0 if j == load_.row else 0.0)
                for a in range(k):
                    slope = load(b, loads, start + 1 + 2 * k + j * k + a)
                    total = b.fma(b.fmul(factor, load(b, loads, start + 1 + a)), slope, total)
                store(b, total, matrix, load_.row + j * n)
            sum_ = number(0.0)
            for a in range(k):
                sum_ = b.fma(b.fmul(factor, load(b, loads, start + 1 + a)), load(b, loads, start + 1 + k + a), sum_)
            store(b, b.fneg(sum_), right, load_.row)

    def turn(load_: Load, start: int) -> None:
        k = load_.components
        values, square = [], number(0.0)
        for a in range(k):
            value = load(b, loads, start + 1 + k + a)
            for j in range(n):
                value = b.fma(load(b, loads, start + 1 + 2 * k + j * k + a), load(b, solution, j), value)
            values.append(value)
            square = b.fma(value, value, square)
        size = b.intrinsic("llvm.sqrt", square)
        with b.if_then(b.fcmp_ordered(">", size, number(0.0))):
            for a, value in enumerate(values):
                store(b, b.fdiv(value, size), loads, start + 1 + a)

    def once(_: Value) -> None:
        for load_, start in zip(active.loads, starts, strict=True):
            write_row(load_, start)
        b.call(solve, arguments)
        for load_, start in zip(active.loads, starts, strict=True):
            if load_.components > 1:
                turn(load_, start)

    loop(b, 0, ITERATIONS if any(load_.components > 1 for load_ in active.loads) else 1, once)


def _emit_solve(module: Module, name: str, active: ActiveRows, columns: int, watches: bool) -> Function:
    """Emit `void name(mask, matrix, right, solution)` of double pointers; `watches` is that of `emit_solved`."""
    n = active.rows
    function = Function(module, FunctionType(VOID, [POINTER] * 4), name)
    function.linkage = "internal"
    mask, matrix, right, solution = function.args
    b = IRBuilder(function.append_basic_block("entry"))
    share = emit_shared_solver(module, n, active.solver)
    small, order, small_right, x, duals, weights = (local_array(b, size) for size in (n * n, n, n, n, n, n))
    chosen, count = b.alloca(INT, integer(max(n, 1))), b.alloca(INT)
    b.store(integer(0), count)

    def chosen_row(index: Value) -> Value:
        return b.load(b.gep(chosen, index, INT), typ=INT)

    def choose(i: Value, comparison: str) -> None:
        with b.if_then(b.fcmp_unordered(comparison, load(b, mask, i), number(0.0))):
            found = b.load(count, typ=INT)
            b.store(i, b.gep(chosen, found, INT))
            b.store(b.add(found, integer(1)), count)

    loop(b, 0, n, lambda i: choose(i, "<"))
    sharing = b.load(count, typ=INT)
    loop(b, 0, n, lambda i: choose(i, ">"))
    size = b.load(count, typ=INT)

    def gather_column(j: Value) -> None:
        source, target = b.mul(chosen_row(j), integer(n)), b.mul(j, integer(n))
        loop(b, 0, size, lambda i: store(b, load(b, matrix, b.add(chosen_row(i), source)), small, b.add(i, target)))

    loop(b, 0, size, gather_column)
    shared = b.icmp_signed(">", sharing, integer(0))
    with b.if_then(b.not_(shared)):
        b.call(active.solver.factorize, [small, order, size])

    def subtract(i: Value, j: Value) -> None:
        entry = b.fneg(load(b, matrix, b.add(chosen_row(j), b.mul(i, integer(n)))))
        store(b, b.fma(entry, load(b, duals, j), load(b, solution, i)), solution, i)

    def watch(i: Value) -> None:
        with b.if_then(b.fcmp_ordered("==", load(b, mask, i), number(0.0))):
            loop(b, 0, size, lambda j: subtract(i, j))

    def solve_column(offset: Value) -> None:
        loop(b, 0, n, lambda i: store(b, number(0.0), solution, b.add(i, offset)))
        loop(b, 0, size, lambda i: store(b, load(b, right, b.add(chosen_row(i), offset)), small_right, i))
        with b.if_else(shared, likely=False) as (then, otherwise):
            with then:
                loop(b, 0, size, lambda i: store(b, b.fneg(load(b, mask, chosen_row(i))), weights, i))
                b.call(share, [small, weights, small_right, x, duals, sharing, size])
                if watches:
                    loop(b, 0, n, watch)
            with otherwise:
                b.call(active.solver.solve, [small, order, small_right, x, size])
        loop(b, 0, size, lambda i: store(b, load(b, x, i), solution, b.add(chosen_row(i), offset)))

    for column in range(columns):
        solve_column(integer(column * n))
    b.ret_void()
    return function
