"""Builds models: traces the equations of a mechanism, chooses the method, and compiles the kernel."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import casadi as ca

from mbd_sim.compiler.kernel import PartialSystem, compile_kernel
from mbd_sim.compiler.python.bound_kernel import Kernel
from mbd_sim.dynamics.equations import Equations
from mbd_sim.dynamics.layouts.vectors import AUDIT_STATES, LOSS_STATES
from mbd_sim.integrators.method import Method
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.model.method_choice import MethodChoice, choose_method, require_one_sided_method
from mbd_sim.simulation.model.prepared import PreparedModel

if TYPE_CHECKING:
    from mbd_sim.simulation.contact.one_sided_model import OneSidedModel


MANY_JOINTS = 10  # from which on the derivation takes a second or more

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class BuiltModel:
    """The equations, the data and the kernel of a model."""

    equations: Equations
    prepared: PreparedModel
    kernel: Kernel


def build(mechanism: Mechanism, method: str, trace: Callable[[], Equations], step: float) -> BuiltModel:
    """Trace and compile a mechanism.

    :param method: its name, which may be `auto`.
    :param trace: derives its equations.
    :param step: in s.
    :raises MechanismError: the method does not fit, or the equations are singular at the start.
    """
    severity = logging.INFO if len(mechanism.all_joints) >= MANY_JOINTS else logging.DEBUG
    _log.log(severity, "deriving the equations of '%s': %d joints", mechanism.name, len(mechanism.all_joints))
    require_one_sided_method(mechanism, method)
    equations = trace()
    centers = [mechanism.parts[part].center for part in equations.inputs.loaded]
    inputs = equations.inputs_at_start(centers)
    choice = choose_method(mechanism, equations, inputs, method, step)
    _log.debug("compiling the equations of '%s'", mechanism.name)
    kernel = _kernel(equations, choice)
    prepared = PreparedModel(
        method=choice.method.name,
        method_remark=choice.remark,
        layout=equations.layout,
        input_layout=equations.inputs,
        start=equations.start_state,
        inputs=inputs,
        history_size=_history_size(equations, choice.method, len(inputs)),
        part_names=equations.part_names,
        row_names=tuple(str(row.owner[1]) for row in equations.rows),
        rank=equations.start.rank,
        signature=kernel.signature,
    )
    return BuiltModel(equations, prepared, kernel)


def can_be_stored(equations: Equations) -> bool:
    """Whether a run needs the equations only on request: contacts and distant springs need them from the start."""
    return equations.one_sided is None and equations.distant_springs is None


def one_sided_model(equations: Equations, kernel: Kernel) -> OneSidedModel | None:
    """The one-sided elements of a model, if there are any."""
    if equations.one_sided is None:
        return None
    from mbd_sim.simulation.contact.one_sided_model import OneSidedModel, guard_tolerance

    size, tolerance = equations.constraints.size, guard_tolerance(equations)
    return OneSidedModel(equations.one_sided, equations.inputs, kernel, size, equations.part_names, tolerance)


def partial_system(equations: Equations, method: Method) -> PartialSystem | None:
    """What a method solves for instead of all rates, if it treats only the forces within joints implicitly."""
    return equations.joint_linearization.partial_system if method.uses_joints else None


def _history_size(equations: Equations, method: Method, inputs_size: int) -> int:
    """The numbers that the kernel keeps behind the inputs from step to step."""
    size = len(equations.start_state)
    kept = method.history_size(size, inputs_size)
    if equations.one_sided is None or not method.keeps_history:
        return kept
    from mbd_sim.compiler.steps.guarded import kept_at_start

    layout = equations.one_sided.equations.layout
    return kept + kept_at_start(size, layout.gaps, layout.rows)


def _kernel(equations: Equations, choice: MethodChoice) -> Kernel:
    one_sided = None
    if equations.one_sided is not None:
        from mbd_sim.simulation.contact.one_sided_model import one_sided_system

        one_sided = one_sided_system(equations, equations.one_sided, time_stepping=choice.method.time_stepping)
    return compile_kernel(
        equations.rates,
        equations.project,
        _readers(equations, choice.method),
        choice.method,
        equations.core,
        partial(partial_system, equations, choice.method),
        one_sided,
        None if equations.actuators is None else equations.actuators.between_steps,
        equations.like_branches,
        equations.scales,
    )


def _readers(equations: Equations, method: Method) -> Mapping[str, ca.Function]:
    """The functions of the state that are compiled with the steps."""
    readers: dict[str, ca.Function] = {
        "energies": equations.energies,
        "poses": equations.poses,
        "drives": equations.drives,
        "violation": equations.violation,
    }
    if equations.distant_springs is not None:
        readers["elongations"] = equations.distant_springs.elongations
    if equations.actuators is not None:
        readers["actuators"] = equations.actuators.readings
    if method.time_stepping and equations.one_sided is not None:
        readers |= _readers_of_time_stepping(equations)
    return readers


def _readers_of_time_stepping(equations: Equations) -> Mapping[str, ca.Function]:
    """(q, displacement) -> the displaced q, and (t, y, inputs) -> the powers in the account, with everything open."""
    rates, displaced = equations.rates, equations.constraints.traced.displaced
    t, y, inputs = (ca.SX.sym(name, rates.size_in(index)) for index, name in enumerate("tye"))
    q, displacement = (ca.SX.sym(name, displaced.size_in(index)) for index, name in enumerate("qd"))
    moved = displaced.call([q, displacement, ca.SX.zeros(displaced.size_in(2))])[0]  # which has no parameters
    first = rates.nnz_out(0) - len(AUDIT_STATES) - len(LOSS_STATES)
    powers = rates.call([t, y, inputs])[0][first:]
    return {
        "displaced": ca.Function("displaced", [q, displacement], [ca.densify(moved)]),
        "powers": ca.Function("powers", [t, y, inputs], [ca.densify(powers)], {"cse": True}),
    }
