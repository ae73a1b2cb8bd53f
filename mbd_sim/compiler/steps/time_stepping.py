"""What time stepping needs of a mechanism with one-sided rows, as IR: steps without contacts, and the projection."""

from __future__ import annotations

from mbd_sim.compiler.ir.builder import DOUBLE, INT, IRBuilder, integer, number
from mbd_sim.compiler.ir.module import POINTER, Function, FunctionType, Module
from mbd_sim.compiler.ir.vectors import copy
from mbd_sim.compiler.steps.emitter import StepEmitter, System
from mbd_sim.compiler.steps.guarded import GuardedSteps, call_loop, emit_part, internal, is_finite
from mbd_sim.compiler.steps.loop import emit_advance


def emit_time_stepping(
    module: Module, open_system: System, closed_system: System, steps: GuardedSteps, modes: range
) -> Function:
    """Emit the functions below and return `estimating_advance`, see `emit_advance`, which takes free steps.

    `i64 part_step(y, inputs, double t, double h)` takes one free step from t on. `i64 project(y, inputs, double t)`
    moves a state to the closed gaps and to the speeds of the active rows. Both return 1 if the state is finite,
    otherwise -1.

    :param modes: the inputs that are the modes.
    """
    part = emit_part(module, "part_open", open_system, steps.part)
    exported = Function(module, FunctionType(INT, [POINTER, POINTER, DOUBLE, DOUBLE]), "part_step")
    b = IRBuilder(exported.append_basic_block("entry"))
    b.ret(b.call(part, exported.args))
    projections = (
        _emit_projection(module, "project_closed", closed_system),
        _emit_projection(module, "project_open", open_system),
    )
    exported = Function(module, FunctionType(INT, [POINTER, POINTER, DOUBLE]), "project")
    b = IRBuilder(exported.append_basic_block("entry"))
    b.ret(call_loop(b, projections, modes, exported.args))
    return emit_advance(module, open_system, steps.whole)


def _emit_projection(module: Module, name: str, system: System) -> Function:
    """Emit `i64 name(y, inputs, double t)`: see `project`."""
    function = internal(module, name, [POINTER, POINTER, DOUBLE])
    state, inputs, t = function.args
    b = IRBuilder(function.append_basic_block("entry"))
    emitter = StepEmitter(b, system, inputs, number(0.0), estimates=False, short=True)
    sum_of_zeros = emitter.scalar()
    copy(b, system.size, state, emitter.y)
    emitter.project(t, emitter.y)
    copy(b, system.size, emitter.y, state)
    b.ret(b.select(is_finite(b, system.size, emitter.y, sum_of_zeros), integer(1), integer(-1)))
    return function
