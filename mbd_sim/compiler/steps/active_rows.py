"""Functions with a linear system in the middle, of which only the active rows are solved, as IR.

The system of a mechanism with one-sided rows is one of them, with its guards.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import casadi as ca

from mbd_sim.compiler.ir.builder import FALSE, INT, IRBuilder, element, integer, local_array, number
from mbd_sim.compiler.ir.dense_solver import emit_dense_solver
from mbd_sim.compiler.ir.module import POINTER, VOID, Function, FunctionType, Module, Value
from mbd_sim.compiler.ir.python_functions import emit_function
from mbd_sim.compiler.ir.python_kinds import Array
from mbd_sim.compiler.ir.vectors import load, loop, store
from mbd_sim.compiler.lists.instruction_list import Instructions, zero_components
from mbd_sim.compiler.lists.like_operations import Branch
from mbd_sim.compiler.lists.lowering import instruction_count
from mbd_sim.compiler.lists.packed_lowering import lower_packed
from mbd_sim.compiler.lists.packing import packed
from mbd_sim.compiler.lists.repeated_lowering import lower_repeated
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.compiler.rows.pooled_rows import PooledCalls
from mbd_sim.compiler.rows.row_factors import Factors, emit_product
from mbd_sim.compiler.rows.shared_rows import ActiveRows, emit_active_solver
from mbd_sim.compiler.rows.slot_values import SlotSystem, emit_slot_values
from mbd_sim.compiler.steps.emitter import System
from mbd_sim.compiler.steps.guarded import GuardedSteps, Guards, emit_one_sided_advance
from mbd_sim.compiler.steps.time_stepping import emit_time_stepping

ITERATIONS = 8  # of Newton's method for the directions of loads; each doubles the number of digits


@dataclass(frozen=True)
class Load:
    """A row in which friction is proportional to the size of a force N (k,) that is affine in the solution λ.

    Its numbers follow one another: c, a start direction (k,), N without λ (k,), and the slopes of N (k, rows) column by
    column. Where c is not 0, the row becomes λ_row + c |N| = 0.
    """

    row: int
    components: int


@dataclass(frozen=True, eq=False)
class FactoredSystem:
    """`function(t, y, inputs, slots)` gives a memory, a matrix (n, n) or numbers of its `factors`, and right sides.

    With factors L and R the matrix is Lᵀ R; without, the output for R is empty. The right sides (n, ·) follow one
    another. Loads and a margin may follow. With pooled rows, the last two outputs are how their forces follow from the
    solution, and the rates of the parts: see `mbd_sim.dynamics.one_sided_functions.SolvedPair`.
    """

    function: ca.Function
    factors: Factors | None


def emit_solved(
    module: Module,
    name: str,
    system: FactoredSystem,
    results: Sequence[ca.Function],
    active: ActiveRows,
    slots: SlotSystem,
    *,
    loads: Sequence[Load] = (),
    fused: bool = True,
    reports_margin: bool = False,
    adds_given: bool = False,
    watches: bool = False,
) -> Function:
    """Emit `void name(t, y, inputs, out…[, margin])` of double pointers, and what it calls, if that is not there yet.

    Each of the `results(memory, solution, slots)` takes the solution of the system, zero for all other rows, and has an
    `out`. The margin is an argument if it is to be reported. For `adds_given` and `watches` see `emit_active_solver`.

    :param loads: whose numbers the system has as one more output.
    """
    has_loads = bool(loads)
    function_of_state, n = system.function, active.rows
    pooled, last = slots.pooled, function_of_state.n_out() - (0 if slots.pooled is None else 2)
    has_margin = last > 4 + has_loads
    columns = function_of_state.nnz_out(3) // max(n, 1)

    emitted_system, *emitted_results = (_lowered(module, each, fused=fused) for each in (function_of_state, *results))
    solve = emit_active_solver(module, f"{name}.solve", active, columns, adds_given=adds_given, watches=watches)
    function = Function(module, FunctionType(VOID, [POINTER] * (3 + len(results) + reports_margin)), name)
    function.linkage = "internal"
    b = IRBuilder(function.append_basic_block("entry"))
    t, y, inputs, *rest = function.args
    out, margin = rest[: len(results)], rest[len(results) :]
    memory, left, factor = (local_array(b, function_of_state.nnz_out(index)) for index in range(3))
    matrix = left if system.factors is None else local_array(b, n * n)
    values = local_array(b, slots.size)
    right, solution = (local_array(b, n * columns) for _ in range(2))
    numbers = [local_array(b, function_of_state.nnz_out(4))] if has_loads else []
    if has_margin and not margin:
        margin = [local_array(b, 1)]
    of_pools = [local_array(b, function_of_state.nnz_out(index)) for index in range(last, function_of_state.n_out())]
    calls = None if pooled is None else PooledCalls(b, pooled)
    if slots.has_values:
        b.call(emit_slot_values(module, slots), [t, y, inputs, values])
    b.call(emitted_system, [t, y, inputs, values, memory, left, factor, right, *numbers, *margin, *of_pools])
    if calls is not None:
        calls.begin(inputs, values, function_of_state, of_pools, right)
    if system.factors is not None:
        product = emit_product(module, f"{function_of_state.name()}.product", system.factors, active, pooled)
        more = [] if calls is None else calls.coefficients.all
        b.call(product, [inputs, left, factor, matrix, element(b, values, slots.size - n), *more])
    _emit_solution(b, n, loads, solve, [inputs, matrix, right, solution], numbers)
    if calls is not None:
        calls.end(solution, n, columns, values)
    for result, into in zip(emitted_results, out, strict=True):
        b.call(result, [memory, solution, values, into])
    b.ret_void()
    return function


def _lowered(module: Module, called: ca.Function, *, fused: bool) -> Function:
    known = module.functions.get(called.name())
    return lower_repeated(module, arranged(called, fused=fused), inline=False) if known is None else known


def _emit_solution(
    b: IRBuilder, n: int, loads: Sequence[Load], solve: Function, arguments: list[Value], numbers: Sequence[Value]
) -> None:
    if loads:
        _emit_loaded(b, n, loads, solve, arguments, numbers[0])
    else:
        b.call(solve, arguments)


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


def emit_event_readers(module: Module, one_sided: OneSidedSystem, attributes: Sequence[str]) -> dict[str, int]:
    """Emit what events read, and say how many arguments each takes before the output.

    `void read_contact_terms(t, y, inputs, out)` gives the whole matrix without friction, column by column, and the
    further numbers of the `terms`. For time stepping, `void read_marked_terms(t, y, inputs, marks, out)` gives these
    numbers, and then the matrix of those rows only whose marks (rows,) are not zero.
    """
    counts, slots = {"contact_terms": 3}, emit_slot_values(module, one_sided.slots)
    _emit_terms(module, one_sided, slots, attributes)
    if one_sided.time_stepping:
        counts["marked_terms"] = 4
        _emit_terms(module, one_sided, slots, attributes, of_marked=True)
    for name, function in one_sided.event_readers.items():
        lowered = lower_repeated(module, function, inline=True, as_interpreted=True)
        takes_slots = function.n_in() > 1  # and a state
        counts[name] = function.n_in() - takes_slots
        exported = Function(module, FunctionType(VOID, [POINTER] * (counts[name] + 1)), f"read_{name}")
        exported.attributes = [*attributes]
        b = IRBuilder(exported.append_basic_block("entry"))
        *given, out = exported.args
        values = []
        if takes_slots:
            values = [local_array(b, one_sided.slots.size)]
            calls = None if one_sided.slots.pooled is None else PooledCalls(b, one_sided.slots.pooled)
            b.call(slots, [*given[:3], *values])
            if calls is not None and len(given) > 3:
                calls.fill(given[2], values[0])
                calls.end(given[3], one_sided.rows, 1, values[0])
        b.call(lowered, [*given, *values, out])
        b.ret_void()
    if one_sided.slots.pooled is not None:
        counts["slot_values"] = 3
        exported = Function(module, FunctionType(VOID, [POINTER] * 4), "read_slot_values")
        b = IRBuilder(exported.append_basic_block("entry"))
        b.call(slots, exported.args)
        b.ret_void()
    return counts


def _emit_terms(
    module: Module, one_sided: OneSidedSystem, slots: Function, attributes: Sequence[str], *, of_marked: bool = False
) -> None:
    n, terms = one_sided.rows, one_sided.terms
    known = module.functions.get(terms.function.name())
    lowered = known or lower_repeated(module, terms.function, inline=True, as_interpreted=True)
    name = "read_marked_terms" if of_marked else "read_contact_terms"
    exported = Function(module, FunctionType(VOID, [POINTER] * (4 + of_marked)), name)
    exported.attributes = [*attributes]
    b = IRBuilder(exported.append_basic_block("entry"))
    t, y, inputs, *marks, out = exported.args
    left, factor = (local_array(b, terms.function.nnz_out(index)) for index in range(2))
    values, pooled = local_array(b, one_sided.slots.size), one_sided.slots.pooled
    matrix, rest = (element(b, out, terms.function.nnz_out(2)), out) if of_marked else (out, element(b, out, n * n))
    whole = local_array(b, n * n) if of_marked and terms.factors is None else matrix
    of_pools = [local_array(b, terms.function.nnz_out(index)) for index in range(3, terms.function.n_out())]
    calls = None if pooled is None else PooledCalls(b, pooled)
    b.call(slots, [t, y, inputs, values])
    b.call(lowered, [t, y, inputs, values, whole if terms.factors is None else left, factor, rest, *of_pools])
    if calls is not None:
        calls.fill(inputs, values)
        calls.gather(of_pools[1], 1.0, rest)
    if terms.factors is not None:
        product_name = "marked_product" if of_marked else "whole_product"
        product = emit_product(module, product_name, terms.factors, None, pooled, of_marked=of_marked)
        more = [] if calls is None else calls.coefficients.all
        b.call(product, [inputs, left, factor, matrix, *(marks or [values]), *more])
    elif marks:
        b.call(emit_function(module, take_marked), [integer(n), whole, *marks, matrix])
    b.ret_void()


def take_marked(n: int, whole: Array, marks: Array, matrix: Array) -> None:
    """Write those rows and columns of a matrix (n, n) whose marks (n,) are not zero to another one."""
    count = 0
    for j in range(n):
        for i in range(n if marks[j] != 0.0 else 0):
            if marks[i] != 0.0:
                matrix[count] = whole[i + j * n]
                count += 1


INLINED_START = 300  # instructions up to which the rates with the guards of open contacts are inlined


@dataclass(frozen=True, eq=False)
class OneSidedSystem:
    """The functions of a system with `gaps` and `rows`, of which the gaps come first.

    `rates` and `project` are pairs of a system and its result, see `emit_solved`, and `readings` a further result of
    the system of rates. Behind the values of the `slots`, readings find the diagonal (rows,) of the matrix without
    friction, see `emit_product`. `open_start(t, y, inputs)` gives what `rates` do while everything is open, then the
    gaps and their rates; `event_readers` are further readers, which events need, besides the `terms`: the factors of
    the matrix without friction, then further numbers. Inputs from `first_mode` on are the `modes`:
    which gaps are closed, which rows are active, and the directions of sliding; those from `first_given` on are the
    given forces. `slips` are the pairs of rows with friction along two directions, at rest up to a `slow` speed.
    `gap_units` are those of the tolerance of open gaps. With `time_stepping`, steps are free. A projection that changes
    one of the first components by more than the `farthest` gives a state that is not finite.
    """

    gaps: int
    rows: int
    guards: int
    rates: tuple[FactoredSystem, ca.Function]
    project: tuple[FactoredSystem, ca.Function]
    readings: ca.Function
    open_start: ca.Function
    event_readers: Mapping[str, ca.Function]
    terms: FactoredSystem
    first_mode: int
    modes: int
    first_given: int
    tolerance: float
    gap_units: tuple[float, ...]
    slow: float
    slots: SlotSystem
    farthest: tuple[float, ...]
    loads: tuple[Load, ...] = ()
    slips: tuple[tuple[int, int], ...] = ()
    time_stepping: bool = False

    @property
    def mode_range(self) -> range:
        """The inputs that are the modes."""
        return range(self.first_mode, self.first_mode + self.modes)


def emit_one_sided(
    module: Module,
    system: System,
    program: Instructions,
    steps: GuardedSteps,
    one_sided: OneSidedSystem,
    like_branches: Sequence[Sequence[Branch]],
) -> Function:
    """Emit all functions and return `estimating_advance`.

    `system` is the one with everything open, and `program` are its rates. Energies of which it changes none are left
    out of its steps.
    """
    rows = one_sided.rows
    solver = emit_dense_solver(module, rows, counted=True)
    first, gaps = one_sided.first_mode + one_sided.gaps, one_sided.gaps
    active = ActiveRows(rows, first, one_sided.first_given, solver, gaps)
    contact, rates, readings = *one_sided.rates, one_sided.readings
    solved = partial(emit_solved, active=active, slots=one_sided.slots, loads=one_sided.loads, adds_given=True)
    read = partial(solved, module, "solved_readings", contact, [readings], watches=True)
    reports, (project_system, project) = system.reports_conditioning, one_sided.project
    contact_project = emit_solved(
        module, "solved_projection", project_system, [project], active, one_sided.slots, fused=False
    )
    closed = replace(
        system,
        rates=system.rates
        if one_sided.time_stepping
        else solved(module, "solved_rates", contact, [rates], reports_margin=reports),
        projection=_both(module, system, _within_reach(module, contact_project, one_sided.farthest)),
        projection_takes_inputs=True,
        unmoved=frozenset(),
        in_registers=False,
        name="closed",
    )
    still = {component for component in zero_components(program) if component >= system.error_size}
    system = replace(system, still=frozenset(still))
    _emit_readings(module, read)
    if one_sided.time_stepping:
        return emit_time_stepping(module, system, closed, steps, one_sided.mode_range)
    open_start = arranged(one_sided.open_start)
    inline = module.fast and instruction_count(open_start) <= INLINED_START
    packing = packed(open_start, like_branches) if module.fast else None
    guards = Guards(
        gaps=one_sided.gaps,
        rows=rows,
        count=one_sided.guards,
        closed_start=solved(module, "solved_start", contact, [rates, readings], reports_margin=reports, watches=True),
        open_start=lower_repeated(module, open_start, inline)
        if packing is None
        else lower_packed(module, open_start, packing, inline),
        first_mode=one_sided.first_mode,
        modes=one_sided.modes,
        tolerance=one_sided.tolerance,
        gap_units=one_sided.gap_units,
        slow=one_sided.slow,
        slips=one_sided.slips,
    )
    _emit_parts_of_steps(module, closed, guards, reports=reports)
    return emit_one_sided_advance(module, system, closed, steps, guards)


def _emit_readings(module: Module, emit: Callable[[], Function]) -> None:
    """Emit `void read_contacts(t, y, inputs, out)`."""
    exported = Function(module, FunctionType(VOID, [POINTER] * 4), "read_contacts")
    b = IRBuilder(exported.append_basic_block("entry"))
    b.call(emit(), exported.args)
    b.ret_void()


def _emit_parts_of_steps(module: Module, closed: System, guards: Guards, *, reports: bool) -> None:
    """Emit what a method needs that is not emitted here: slopes with readings, and the projection.

    `i64 start_contacts(t, y, inputs, slopes, readings)` is -1 where the constraints are ill-conditioned, otherwise 1.
    `void project_contacts(t, y, inputs, out)` moves a state back to all constraints.
    """
    start = Function(module, FunctionType(INT, [POINTER] * 5), "start_contacts")
    b = IRBuilder(start.append_basic_block("entry"))
    margin = local_array(b, 1)
    store(b, number(0.0), margin, 0)
    b.call(guards.closed_start, [*start.args, *([margin] if reports else [])])
    is_good = b.fcmp_ordered(">=", load(b, margin, 0), number(0.0))
    b.ret(b.select(is_good, integer(1), integer(-1)))
    project = Function(module, FunctionType(VOID, [POINTER] * 4), "project_contacts")
    b = IRBuilder(project.append_basic_block("entry"))
    assert closed.projection is not None
    b.call(closed.projection, project.args)
    b.ret_void()


def _within_reach(module: Module, project: Function, farthest: Sequence[float]) -> Function:
    """The projection, with a state that is not finite where it changes a component too far."""
    function = Function(module, FunctionType(VOID, [POINTER] * 4), "project_within_reach")
    function.linkage = "internal"
    _, y, _, out = function.args
    b, lost = IRBuilder(function.append_basic_block("entry")), FALSE
    b.call(project, function.args)
    for index, most in enumerate(farthest):
        change = b.intrinsic("llvm.fabs", b.fsub(load(b, out, index), load(b, y, index)))
        lost = b.or_(lost, b.fcmp_ordered(">", change, number(most)))
    with b.if_then(lost, likely=False):
        store(b, b.fdiv(number(0.0), number(0.0)), out, 0)
    b.ret_void()
    return function


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
