"""Compiles a system of differential equations to a kernel: its steps, and functions of its state.

What a method keeps of earlier steps is in memory behind the inputs of the system.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import casadi as ca

from mbd_sim.base.disk_cache import casadi_version, folder, records_digest
from mbd_sim.compiler.code.host_module import compile_module, compiled_before, new_module
from mbd_sim.compiler.code.machine_code import MachineCode
from mbd_sim.compiler.ir.module import Function, Module
from mbd_sim.compiler.lists.instruction_list import Instructions, passed_on
from mbd_sim.compiler.lists.like_operations import Branch
from mbd_sim.compiler.lists.lowering import export, instruction_count, lower
from mbd_sim.compiler.lists.packed_lowering import lower_packed
from mbd_sim.compiler.lists.packing import Packing, packed
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.compiler.python.bound_kernel import Kernel, KernelSignature
from mbd_sim.compiler.python.step_call import emit_call
from mbd_sim.compiler.steps.adams import adams_step
from mbd_sim.compiler.steps.emitter import Emit, Prepare, System, emit_samples
from mbd_sim.compiler.steps.loop import emit_advance
from mbd_sim.compiler.steps.runge_kutta import explicit_step
from mbd_sim.integrators.between_steps import BetweenSteps
from mbd_sim.integrators.explicit import Adams, Tableau
from mbd_sim.integrators.implicit import Gauss, Rosenbrock, RosenbrockW
from mbd_sim.integrators.method import Method, Scales

if TYPE_CHECKING:
    from mbd_sim.compiler.steps.active_rows import OneSidedSystem
    from mbd_sim.integrators.explicit import Taylor


INLINED = 2200  # instructions of all stages together up to which the rates are inlined into the stepping loop
# Instructions of the rates up to which the arrays of a step are kept in registers: that saves up to 40 % of a step.
# Longer rates need the registers themselves: some get faster by 15 %, but others slower by 20 %.
FEW = 20
MOVED = 40  # components that a projection changes, up to which they are copied one by one, and others are left alone
STATE = 1  # the argument of a projection that it moves
# How long a kernel takes to compile, in s for each instruction of its rates and readers: within a factor of three.
WITH_CONTACTS, WITHOUT_CONTACTS = 2.5e-3, 0.5e-3
LONG = 10.0  # s from which on that is said beforehand
# Readers are called rarely, and in one block without loops LLVM finds little to improve: not optimized, they compile in
# half the time and take 1.0 to 1.1 of the time.
NOT_OPTIMIZED = ("noinline", "optnone")

_log = logging.getLogger(__name__)

PartialSystem: TypeAlias = tuple[ca.Function, ca.Function]


def compile_kernel(
    rates: ca.Function,
    projection: ca.Function | None,
    readers: Mapping[str, ca.Function],
    method: Method,
    core: slice | None = None,
    trace_partial_system: Callable[[], PartialSystem | None] = lambda: None,
    one_sided: OneSidedSystem | None = None,
    between_steps: BetweenSteps | None = None,
    like_branches: Sequence[Sequence[Branch]] = (),
    scales: Scales = (),
) -> Kernel:
    """Compile y' = rates(t, y, inputs) with a method of integration: see `System`.

    :param readers: further functions of the state, with one output each.
    :param core: the components that `emit_linearized` solves for together, by default all. No rate depends on the
        components after them, which do not count in error estimates either.
    :param trace_partial_system: for methods that use joints: see `emit_partial_system`.
    :param one_sided: the one-sided rows of the system; without them all of its rows are two-sided.
    :param between_steps: what changes in the state at the start of a step.
    :param like_branches: groups of branches whose operations may be alike: see `like_operations`.
    :param scales: of the errors: see `System`.
    """
    core = slice(0, rates.nnz_out(0)) if core is None else core

    def compile_all() -> tuple[MachineCode, KernelSignature]:
        _announce(sum(each.n_instructions() for each in (rates, *readers.values())), one_sided is not None)
        module = new_module()
        needs = StepNeeds(rates, core, trace_partial_system, lambda function, *_: lower(module, function, inline=False))
        signature = _emit_kernel(
            module, needs, projection, readers, method, one_sided, between_steps, like_branches, scales
        )
        return compile_module(module), signature

    if one_sided is None or method.uses_joints:
        return Kernel(*compile_all())
    everything = (rates, projection, dict(readers), method, core, one_sided, between_steps, like_branches, scales)
    return Kernel(*compiled_before(compile_all, records_digest(everything), casadi_version()))


def _announce(instructions: int, has_contacts: bool) -> None:
    """Say that compiling will take long, if it will."""
    seconds = instructions * (WITH_CONTACTS if has_contacts else WITHOUT_CONTACTS)
    if seconds >= LONG:
        kept = folder() is not None
        later = "later starts find them in the cache" if kept else "without a cache (MBD_SIM_CACHE), at each start"
        _log.info("compiling the equations may take %.0f s; %s", float(f"{seconds:.1g}"), later)


def _emit_kernel(
    module: Module,
    needs: StepNeeds,
    projection: ca.Function | None,
    readers: Mapping[str, ca.Function],
    method: Method,
    one_sided: OneSidedSystem | None,
    between_steps: BetweenSteps | None,
    like_branches: Sequence[Sequence[Branch]],
    scales: Scales,
) -> KernelSignature:
    """Emit the functions of a kernel, and say what is known of it: see `compile_kernel`."""
    rates = needs.rates
    program = arranged(rates)
    system = emit_system(
        module,
        rates,
        program,
        projection,
        method,
        needs.core.stop,
        between_steps=between_steps,
        packing=packed(program, like_branches) if module.fast else None,
        scales=scales,
    )
    if one_sided is None:
        advance = _emit_advance(module, system, method, needs)
    else:
        advance = _emit_guarded(module, system, method, program, needs, one_sided, like_branches)
    emit_call(module, advance, ("state", "inputs", "first", "h", "steps", "estimate"))
    counts = {name: function.n_in() for name, function in readers.items()}
    if one_sided is not None:
        from mbd_sim.compiler.steps.active_rows import emit_event_readers

        counts |= emit_event_readers(module, one_sided, NOT_OPTIMIZED)
    for name, function in readers.items():
        export(module, f"read_{name}", lower(module, function, inline=True), NOT_OPTIMIZED)
    return KernelSignature(
        readers=counts,
        instructions=instruction_count(program),
        one_sided=one_sided is not None,
    )


def unfit(method: Method, rates: ca.Function, name_of: Callable[[int], str]) -> str:
    """Why a method cannot integrate these rates, such as "cannot treat …", or ""; `name_of` names a row of them."""
    if not method.uses_series:
        return ""
    from mbd_sim.compiler.taylor.step import without_expansion

    return without_expansion(rates, method.order, name_of)


def _emit_advance(module: Module, system: System, method: Method, needs: StepNeeds) -> Function:
    """Emit the loop over steps."""
    if not method.uses_series:
        return emit_advance(module, system, step_of(method, needs))
    from mbd_sim.compiler.taylor.step import emit_taylor_advance

    if system.samples is not None:
        raise ValueError(f"method {method.name} cannot treat samples")
    return emit_taylor_advance(module, system, cast("Taylor", method), needs.rates)


def _emit_guarded(
    module: Module,
    system: System,
    method: Method,
    program: Instructions,
    needs: StepNeeds,
    one_sided: OneSidedSystem,
    like_branches: Sequence[Sequence[Branch]],
) -> Function:
    """Emit the loop over steps that end at events."""
    if not method.treats_events:
        raise ValueError(f"method {method.name} cannot treat one-sided rows")
    from mbd_sim.compiler.steps.active_rows import emit_one_sided
    from mbd_sim.compiler.steps.guarded import GuardedSteps

    history = method.history_size(system.size, system.inputs_size)
    steps = GuardedSteps(step_of(method, needs), step_of(method.one_step, needs), history)
    return emit_one_sided(module, system, program, steps, one_sided, like_branches)


def emit_system(
    module: Module,
    rates: ca.Function,
    program: Instructions,
    projection: ca.Function | None,
    method: Method,
    error_size: int,
    lanes: int = 1,
    between_steps: BetweenSteps | None = None,
    packing: Packing | None = None,
    scales: Scales = (),
) -> System:
    """Emit the functions of a system for `lanes` members at once; `program` are the arranged rates.

    :param packing: of a single member, the operations of the program in packs.
    """
    reports_conditioning = rates.n_out() > 1
    instructions = instruction_count(program)
    inline = module.fast and instructions * method.stages <= INLINED
    emitted, unmoved = None, frozenset[int]()
    if projection is not None:
        moves = arranged(projection, fused=False)
        unmoved = passed_on(moves, STATE)
        if projection.nnz_out(0) - len(unmoved) > MOVED:
            unmoved = frozenset()
        emitted = lower(module, moves.without(unmoved), inline=not reports_conditioning, lanes=lanes)
    return System(
        size=rates.nnz_out(0),
        error_size=error_size,
        rates=lower(module, program, inline, lanes)
        if packing is None
        else lower_packed(module, program, packing, inline),
        projection=emitted,
        reports_conditioning=reports_conditioning,
        projection_takes_inputs=projection is not None and projection.n_in() > 2,
        unmoved=unmoved,
        samples=emit_samples(module, between_steps, lanes),
        held=frozenset() if between_steps is None else between_steps.held,
        unread=frozenset() if between_steps is None else between_steps.unread,
        in_registers=module.fast and lanes == 1 and instructions <= FEW,
        inputs_size=rates.nnz_in(2),
        instructions=instructions,
        scales=scales,
    )


@dataclass(frozen=True, eq=False)
class StepNeeds:
    """What the emitters of steps may need besides the `System`: see `compile_kernel` for `core` and the partial one."""

    rates: ca.Function
    core: slice
    trace_partial_system: Callable[[], PartialSystem | None]
    emit: Emit


def _rosenbrock(method: Rosenbrock, needs: StepNeeds) -> Prepare:
    from mbd_sim.compiler.steps.rosenbrock import emit_linearized, rosenbrock_step

    return rosenbrock_step(method, emit_linearized(needs.rates, needs.core, needs.emit))


def _rosenbrock_w(method: RosenbrockW, needs: StepNeeds) -> Prepare:
    from mbd_sim.compiler.steps.rosenbrock import emit_partial_system, rosenbrock_w_step

    if (system := needs.trace_partial_system()) is None:
        raise ValueError(f"method {method.name} needs a partial system")
    return rosenbrock_w_step(method, emit_partial_system(*system, needs.emit))


def _gauss(method: Gauss, _: StepNeeds) -> Prepare:
    from mbd_sim.compiler.steps.gauss import gauss_step

    return gauss_step(method)


# What emits the steps of the methods of a class. Implicit ones, which few mechanisms need, are imported on demand.
FAMILIES: Mapping[type[Method], Callable[[Any, StepNeeds], Prepare]] = {
    Tableau: lambda method, _: explicit_step(method),
    Adams: lambda method, _: adams_step(method),
    Rosenbrock: _rosenbrock,
    RosenbrockW: _rosenbrock_w,
    Gauss: _gauss,
}


def step_of(method: Method, needs: StepNeeds) -> Prepare:
    """What emits the steps of a method that uses no series."""
    return FAMILIES[type(method)](method, needs)
