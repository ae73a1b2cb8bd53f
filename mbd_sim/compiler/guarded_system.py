"""The system of a mechanism with one-sided rows, with its guards, as IR."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca

from mbd_sim.compiler.active_rows import ActiveRows, Load, emit_solved
from mbd_sim.compiler.dense_solver import emit_dense_solver
from mbd_sim.compiler.guarded_stepping import Guards, emit_one_sided_advance
from mbd_sim.compiler.instruction_list import Instructions, zero_components
from mbd_sim.compiler.ir import POINTER, VOID, Function, FunctionType, Module
from mbd_sim.compiler.ir_builder import IRBuilder
from mbd_sim.compiler.ir_types import local_array
from mbd_sim.compiler.ir_vectors import load, store
from mbd_sim.compiler.lowering import instruction_count, lower
from mbd_sim.compiler.schedule import arranged
from mbd_sim.compiler.step_emitter import Prepare, System

INLINED_GUARDS = 300  # instructions up to which the guards of open contacts are inlined


@dataclass(frozen=True, eq=False)
class OneSidedSystem:
    """The functions of a system with `gaps` and `rows`, of which the gaps come first.

    `rates`, `project` and `readings` are pairs of a system and its result, see `emit_solved`; `open_guards(t, y,
    inputs)` gives the gaps and their rates. Inputs from `first_mode` on are the `modes`: which gaps are closed, which
    rows are active, and the directions of sliding; further ones may follow. `slips` are the pairs of rows with friction
    along two directions, at rest up to a `slow` speed. `gap_units` are those of the tolerance of open gaps.
    """

    gaps: int
    rows: int
    guards: int
    rates: tuple[ca.Function, ca.Function]
    project: tuple[ca.Function, ca.Function]
    readings: tuple[ca.Function, ca.Function]
    open_guards: ca.Function
    first_mode: int
    modes: int
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
    active = ActiveRows(rows, one_sided.first_mode + one_sided.gaps, solver, one_sided.loads)
    rates = emit_solved(module, "solved_rates", *one_sided.rates, active, reports_margin=system.reports_conditioning)
    contact_project = emit_solved(module, "solved_projection", *one_sided.project, active, fused=False)
    readings = emit_solved(module, "solved_readings", *one_sided.readings, active, watches=True)
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
