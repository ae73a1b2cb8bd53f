"""Functions with a linear system in the middle, of which only the active rows are solved, as IR.

The system of a mechanism with one-sided rows is one of them, with its guards.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca

from mbd_sim.compiler.ir.builder import IRBuilder, local_array, number
from mbd_sim.compiler.ir.dense_solver import emit_dense_solver
from mbd_sim.compiler.ir.module import POINTER, VOID, Function, FunctionType, Module, Value
from mbd_sim.compiler.ir.vectors import load, loop, store
from mbd_sim.compiler.lists.instruction_list import Instructions, zero_components
from mbd_sim.compiler.lists.lowering import instruction_count, lower
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.compiler.steps.emitter import Prepare, System
from mbd_sim.compiler.steps.guarded import Guards, emit_one_sided_advance
from mbd_sim.compiler.steps.shared_rows import ActiveRows, emit_active_solver

ITERATIONS = 8  # of Newton's method for the directions of loads; each doubles the number of digits


@dataclass(frozen=True)
class Load:
    """A row in which friction is proportional to the size of a force N (k,) that is affine in the solution λ.

    Its numbers follow one another: c, a start direction (k,), N without λ (k,), and the slopes of N (k, rows) column by
    column. Where c is not 0, the row becomes λ_row + c |N| = 0.
    """

    row: int
    components: int


def emit_solved(
    module: Module,
    name: str,
    system: ca.Function,
    result: ca.Function,
    active: ActiveRows,
    *,
    loads: Sequence[Load] = (),
    fused: bool = True,
    reports_margin: bool = False,
    adds_given: bool = False,
    watches: bool = False,
) -> Function:
    """Emit `system`, if it is not there yet, `result`, and `void name(t, y, inputs, out[, margin])` of double pointers.

    `system(t, y, inputs)` gives a memory, a matrix (n, n), right sides (n, k) one after the other, and perhaps a
    margin; `result(memory, solution)`, or `result(t, y, inputs, solution)`, takes the solution, zero for all other
    rows. The margin is an argument if it is to be reported. For `adds_given` and `watches` see `emit_active_solver`.

    :param loads: whose numbers the system has as one more output.
    """
    has_loads = bool(loads)
    has_margin, takes_memory = system.n_out() > 3 + has_loads, result.n_in() == 2
    columns = system.nnz_out(2) // max(active.rows, 1)
    emitted_system = module.functions.get(system.name())
    if emitted_system is None:
        emitted_system = lower(module, arranged(system, fused=fused), inline=False)
    emitted_result = lower(module, arranged(result, fused=fused), inline=False)
    solve = emit_active_solver(module, f"{name}.solve", active, columns, adds_given=adds_given, watches=watches)
    function = Function(module, FunctionType(VOID, [POINTER] * (4 + reports_margin)), name)
    function.linkage = "internal"
    b = IRBuilder(function.append_basic_block("entry"))
    t, y, inputs, out, *margin = function.args
    memory = local_array(b, system.nnz_out(0))
    matrix, right = local_array(b, active.rows**2), local_array(b, active.rows * columns)
    solution = local_array(b, active.rows * columns)
    numbers = [local_array(b, system.nnz_out(3))] if has_loads else []
    if has_margin and not margin:
        margin = [local_array(b, 1)]
    b.call(emitted_system, [t, y, inputs, memory, matrix, right, *numbers, *margin])
    arguments = [inputs, matrix, right, solution]
    if has_loads:
        _emit_loaded(b, active.rows, loads, solve, arguments, numbers[0])
    else:
        b.call(solve, arguments)
    given = [memory] if takes_memory else [t, y, inputs]
    b.call(emitted_result, [*given, solution, out])
    b.ret_void()
    return function


def _emit_loaded(
    b: IRBuilder, n: int, loads: Sequence[Load], solve: Function, arguments: list[Value], numbers: Value
) -> None:
    """Solve with the rows of loads along the directions of their forces, until these do not turn any more.

    Newton's method for λ_row + c |N| = 0 is the linear equation λ_row + c n N = 0 with the direction n of the last N.
    """
    _, matrix, right, solution = arguments
    turns, starts, position = local_array(b, 1), [], 0
    for load_ in loads:
        starts.append(position)
        position += 1 + 2 * load_.components + load_.components * n

    def write_row(load_: Load, start: int) -> None:
        factor, k = load(b, numbers, start), load_.components
        with b.if_then(b.fcmp_unordered("!=", factor, number(0.0))):
            for j in range(n):
                total = number(1.0 if j == load_.row else 0.0)
                for a in range(k):
                    slope = load(b, numbers, start + 1 + 2 * k + j * k + a)
                    total = b.fma(b.fmul(factor, load(b, numbers, start + 1 + a)), slope, total)
                store(b, total, matrix, load_.row + j * n)
            sum_ = number(0.0)
            for a in range(k):
                sum_ = b.fma(b.fmul(factor, load(b, numbers, start + 1 + a)), load(b, numbers, start + 1 + k + a), sum_)
            store(b, b.fneg(sum_), right, load_.row)

    def turn(load_: Load, start: int) -> None:
        k = load_.components
        values, square = [], number(0.0)
        for a in range(k):
            value = load(b, numbers, start + 1 + k + a)
            for j in range(n):
                value = b.fma(load(b, numbers, start + 1 + 2 * k + j * k + a), load(b, solution, j), value)
            values.append(value)
            square = b.fma(value, value, square)
        size = b.intrinsic("llvm.sqrt", square)
        with b.if_then(b.fcmp_ordered(">", size, number(0.0))):
            for a, value in enumerate(values):
                part = b.fdiv(value, size)
                with b.if_then(b.fcmp_unordered("!=", part, load(b, numbers, start + 1 + a))):
                    store(b, number(1.0), turns, 0)
                store(b, part, numbers, start + 1 + a)

    def once(_: Value) -> None:
        with b.if_then(b.fcmp_unordered("!=", load(b, turns, 0), number(0.0))):
            store(b, number(0.0), turns, 0)
            for load_, start in zip(loads, starts, strict=True):
                write_row(load_, start)
            b.call(solve, arguments)
            for load_, start in zip(loads, starts, strict=True):
                if load_.components > 1:
                    turn(load_, start)

    store(b, number(1.0), turns, 0)
    loop(b, 0, ITERATIONS if any(load_.components > 1 for load_ in loads) else 1, once)


INLINED_GUARDS = 300  # instructions up to which the guards of open contacts are inlined


@dataclass(frozen=True, eq=False)
class OneSidedSystem:
    """The functions of a system with `gaps` and `rows`, of which the gaps come first.

    `rates`, `project` and `readings` are pairs of a system and its result, see `emit_solved`; `open_guards(t, y,
    inputs)` gives the gaps and their rates; `event_readers` are further readers, which events need. Inputs from
    `first_mode` on are the `modes`: which gaps are closed, which rows are active, and the directions of sliding; those
    from `first_given` on are the given forces. `slips` are the pairs of rows with friction along two directions, at
    rest up to a `slow` speed. `gap_units` are those of the tolerance of open gaps.
    """

    gaps: int
    rows: int
    guards: int
    rates: tuple[ca.Function, ca.Function]
    project: tuple[ca.Function, ca.Function]
    readings: tuple[ca.Function, ca.Function]
    open_guards: ca.Function
    event_readers: Mapping[str, ca.Function]
    first_mode: int
    modes: int
    first_given: int
    tolerance: float
    gap_units: tuple[float, ...]
    slow: float
    loads: tuple[Load, ...] = ()
    slips: tuple[tuple[int, int], ...] = ()


def emit_one_sided(
    module: Module, system: System, program: Instructions, prepare: Prepare, one_sided: OneSidedSystem
) -> Function:
    """Emit all functions and return `estimating_advance`.

    `system` is the one with everything open, and `program` are its rates. Energies of which it changes none are left
    out of its steps.
    """
    rows = one_sided.rows
    solver = emit_dense_solver(module, rows, counted=True)
    active = ActiveRows(rows, one_sided.first_mode + one_sided.gaps, one_sided.first_given, solver)
    rates = emit_solved(
        module,
        "solved_rates",
        *one_sided.rates,
        active,
        loads=one_sided.loads,
        reports_margin=system.reports_conditioning,
        adds_given=True,
    )
    contact_project = emit_solved(module, "solved_projection", *one_sided.project, active, fused=False)
    readings = emit_solved(
        module, "solved_readings", *one_sided.readings, active, loads=one_sided.loads, adds_given=True, watches=True
    )
    closed = replace(
        system,
        rates=rates,
        projection=_both(module, system, contact_project),
        projection_takes_inputs=True,
        unmoved=frozenset(),
        in_registers=False,
    )
    open_guards = arranged(one_sided.open_guards)
    guards = Guards(
        gaps=one_sided.gaps,
        rows=rows,
        count=one_sided.guards,
        readings=readings,
        open_guards=lower(module, open_guards, inline=instruction_count(open_guards) <= INLINED_GUARDS),
        first_mode=one_sided.first_mode,
        modes=one_sided.modes,
        tolerance=one_sided.tolerance,
        gap_units=one_sided.gap_units,
        slow=one_sided.slow,
        slips=one_sided.slips,
    )
    exported = Function(module, FunctionType(VOID, [POINTER] * 4), "read_contacts")
    builder = IRBuilder(exported.append_basic_block("entry"))
    builder.call(readings, exported.args)
    builder.ret_void()
    still = frozenset(component for component in zero_components(program) if component >= system.error_size)
    return emit_one_sided_advance(module, replace(system, still=still), closed, prepare, guards)


def _both(module: Module, system: System, contact_project: Function) -> Function:
    """The projection onto the two-sided constraints, then that onto the active rows."""
    if system.projection is None:
        return contact_project
    function = Function(module, FunctionType(VOID, [POINTER] * 4), "project_all")
    function.linkage = "internal"
    t, y, inputs, out = function.args
    b = IRBuilder(function.append_basic_block("entry"))
    between = local_array(b, system.size)
    for index in sorted(system.unmoved):
        store(b, load(b, y, index), between, index)
    b.call(system.projection, [t, y, *([inputs] if system.projection_takes_inputs else []), between])
    b.call(contact_project, [t, between, inputs, out])
    b.ret_void()
    return function
