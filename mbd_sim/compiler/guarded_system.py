"""The system of a mechanism with one-sided rows, with its guards, as IR."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import llvmlite.ir as ir

from mbd_sim.compiler.active_rows import ActiveRows, Load, emit_solved
from mbd_sim.compiler.dense_solver import emit_dense_solver
from mbd_sim.compiler.guarded_stepping import Guards, emit_guarded_advance
from mbd_sim.compiler.ir_types import POINTER, local_array
from mbd_sim.compiler.lowering import lower
from mbd_sim.compiler.schedule import arranged
from mbd_sim.compiler.step_emitter import Prepare, System


@dataclass(frozen=True, eq=False)
class OneSidedSystem:
    """The functions of a system with `gaps` and `rows`, of which the gaps come first.

    `rates`, `project` and `readings` are pairs of a system and its result, see `emit_solved`; `open_guards(t, y,
    inputs)` gives the gaps and their rates. Inputs from `first_mode` on are the `modes`: which gaps are closed, which
    rows are active, and the directions of sliding; further ones may follow. `slips` are the pairs of rows with friction
    along two directions.
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
    loads: tuple[Load, ...] = ()
    slips: tuple[tuple[int, int], ...] = ()


def emit_guarded(module: ir.Module, system: System, prepare: Prepare, one_sided: OneSidedSystem) -> ir.Function:
    """Emit all functions and return `estimating_advance`; `system` is the one with everything open."""
    rows = one_sided.rows
    solver = emit_dense_solver(module, rows, counted=True)
    active = ActiveRows(rows, one_sided.first_mode + one_sided.gaps, solver, one_sided.loads)
    rates = emit_solved(module, "solved_rates", *one_sided.rates, active, reports_margin=system.reports_conditioning)
    contact_project = emit_solved(module, "solved_projection", *one_sided.project, active, fused=False)
    readings = emit_solved(module, "solved_readings", *one_sided.readings, active)
    closed = replace(
        system, rates=rates, projection=_both(module, system, contact_project), projection_takes_inputs=True
    )
    guards = Guards(
        gaps=one_sided.gaps,
        rows=rows,
        count=one_sided.guards,
        readings=readings,
        open_guards=lower(module, arranged(one_sided.open_guards), inline=False),
        first_mode=one_sided.first_mode,
        modes=one_sided.modes,
        tolerance=one_sided.tolerance,
        slips=one_sided.slips,
    )
    exported = ir.Function(module, ir.FunctionType(ir.VoidType(), [POINTER] * 4), "read_contacts")
    builder = ir.IRBuilder(exported.append_basic_block("entry"))
    builder.call(readings, exported.args)
    builder.ret_void()
    return emit_guarded_advance(module, system, closed, prepare, guards)


def _both(module: ir.Module, system: System, contact_project: ir.Function) -> ir.Function:
    """The projection onto the two-sided constraints, then that onto the active rows."""
    if system.projection is None:
        return contact_project
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), [POINTER] * 4), "project_all")
    function.linkage = "internal"
    t, y, inputs, out = function.args
    b = ir.IRBuilder(function.append_basic_block("entry"))
    between = local_array(b, system.size)
    b.call(system.projection, [t, y, *([inputs] if system.projection_takes_inputs else []), between])
    b.call(contact_project, [t, between, inputs, out])
    b.ret_void()
    return function
